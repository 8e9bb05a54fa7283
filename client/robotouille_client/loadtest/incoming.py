"""Fields of the server's rare messages that the bots of a load test use.

The models of the protocol would refuse the servers with which `benchmarks` compares this one: they
send no more than these fields. The other messages are too frequent to be checked.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ValidationError

from robotouille.protocol import messages


class _Welcome(BaseModel):
    resume: str
    nodes: list[str] = []


class _Created(BaseModel):
    code: str


class _Joined(BaseModel):
    episode: str
    seat: str | None = None
    resume: str | None = None
    seq: int = 0
    step: int = 0


class _Seat(BaseModel):
    player: str
    present: bool = False


class _Roster(BaseModel):
    seats: list[_Seat]
    phase: str | None = None
    turn: str | None = None


class _Snapshot(_Roster):
    step: int
    seq: int = 0
    last_seq: int = 0


_MODELS: dict[str, type[BaseModel]] = {
    "welcome": _Welcome,
    "created": _Created,
    "joined": _Joined,
    "moved": messages.Moved,
    "roster": _Roster,
    "snapshot": _Snapshot,
}


def check_message(message: dict[str, Any]) -> None:
    """Check the fields of a message, if it is rare; raise ValueError."""
    model = _MODELS.get(message["type"])
    if model is None:
        return
    try:
        # Strict, because the bots use the message itself and not a converted one.
        model.model_validate(message, strict=True)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in (message["type"], *fault["loc"]))
        raise ValueError(f"{where}: {fault['msg']}") from None
