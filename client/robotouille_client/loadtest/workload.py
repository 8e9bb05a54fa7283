"""The plan of a load test, and the share of each process."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from robotouille.episode.rules import Clock, StepRate
from robotouille.errors import RobotouilleError

Count = Annotated[int, Field(ge=0, le=1_000_000)]
Seconds = Annotated[float, Field(ge=0, le=30 * 86_400)]


class FrozenModel(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LoadPlan(FrozenModel):
    """A load test. `mix` has the weights of the clocks; the other fields are command options."""

    url: str
    rooms: Count = 100
    mix: dict[Clock, Annotated[int, Field(ge=0)]] = {Clock.REALTIME: 1}
    rate: StepRate = 10.0
    task: str = "multi_agent/01"
    ramp: Seconds = 10.0
    duration: Annotated[float, Field(gt=0, le=30 * 86_400)] = 30.0
    processes: Annotated[int, Field(ge=1, le=256)] = 1
    storm: Count = 0
    slow_readers: Count = 0
    spectators: Count = 0
    spectators_per_room: Annotated[int, Field(ge=1)] = 200
    seed: Annotated[int, Field(ge=0)] = 0

    def rooms_by_clock(self) -> dict[Clock, int]:
        """Return the number of rooms with each clock, in proportion to the weights."""
        total = sum(self.mix.values())
        exact = {clock: self.rooms * weight / total for clock, weight in self.mix.items()}
        rooms = {clock: int(share) for clock, share in exact.items()}
        rest = self.rooms - sum(rooms.values())
        for clock in sorted(exact, key=lambda c: rooms[c] - exact[c])[:rest]:
            rooms[clock] += 1
        return rooms

    def shares(self) -> list[WorkerShare]:
        """Return the share of each process, as equal as possible."""
        clocks = [clock for clock, count in self.rooms_by_clock().items() for _ in range(count)]
        return [
            WorkerShare(
                url=self.url,
                index=index,
                processes=self.processes,
                rooms=clocks[index :: self.processes],
                rate=self.rate,
                task=self.task,
                ramp=self.ramp,
                slow_readers=_part(self.slow_readers, index, self.processes),
                spectators=_part(self.spectators, index, self.processes),
                spectators_per_room=self.spectators_per_room,
                storm=_part(self.storm, index, self.processes),
                seed=self.seed + index,
            )
            for index in range(self.processes)
        ]


class WorkerShare(FrozenModel):
    """The share of one process. `rooms` has the clock of each of its rooms."""

    url: str
    index: int
    processes: int
    rooms: list[Clock]
    rate: float
    task: str
    ramp: float
    slow_readers: int
    spectators: int
    spectators_per_room: int
    storm: int
    seed: int


def parse_mix(text: str) -> dict[Clock, int]:
    """Return the weights of a text like `realtime:8,lockstep:1`.

    Raises:
        RobotouilleError: The text is invalid.
    """
    weights: dict[Clock, int] = {}
    for part in text.split(","):
        name, _, weight = part.strip().partition(":")
        if name not in list(Clock):
            known = ", ".join(Clock)
            raise RobotouilleError(f"--mix: unknown clock {name[:40]!r}; expected {known}")
        if not re.fullmatch("[0-9]{0,9}", weight):
            raise RobotouilleError(
                f"--mix: the weight of {name} must be a whole number, found {weight[:40]!r}"
            )
        weights[Clock(name)] = weights.get(Clock(name), 0) + int(weight or "1")
    if not sum(weights.values()):
        raise RobotouilleError("--mix: at least one clock needs a weight above 0")
    return weights


def _part(total: int, index: int, parts: int) -> int:
    return total // parts + (index < total % parts)
