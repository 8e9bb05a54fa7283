"""Every number on the wire is one that JSON has: neither NaN nor Infinity, whoever says it."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgpack
import pytest
from pydantic import BaseModel, ValidationError

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK
from robotouille_server import ServerSettings
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

MEANINGS = json.loads((Path(__file__).parents[2] / "docs/messages.json").read_text("utf-8"))
ENDLESS = (math.inf, -math.inf, math.nan)


def holds_float(annotation: Any) -> bool:
    return annotation is float or any(map(holds_float, get_args(annotation)))


def floats(models: tuple[type[BaseModel], ...]) -> Iterator[tuple[type[BaseModel], str]]:
    """The fields of some messages that can hold a fraction."""
    for model in models:
        for name, field in model.model_fields.items():
            if holds_float(field.annotation):
                yield model, name


SENT = [*floats((*messages.SERVER_MESSAGES, messages.Pause))]
TAKEN = [*floats(messages.CLIENT_MESSAGES)]


def test_there_are_such_fields() -> None:
    assert {f"{model.__name__}.{name}" for model, name in SENT} == {
        "Welcome.grace", "Snapshot.left", "Snapshot.starts_in", "Roster.starts_in", "Pause.left",
    }  # fmt: skip
    assert {name for _, name in TAKEN} == {"step_rate", "move_budget", "grace", "open_for"}


@pytest.mark.parametrize(("model", "name"), SENT)
@pytest.mark.parametrize("number", ENDLESS)
def test_a_servers_message_takes_no_endless_number(
    model: type[BaseModel], name: str, number: float
) -> None:
    kind = model.model_fields["type"].default if "type" in model.model_fields else ""
    example = MEANINGS["messages"][kind]["example"] if kind else {"reason": "absence"}
    model.model_validate({**example, name: 0.5})
    with pytest.raises(ValidationError, match="finite"):
        model.model_validate({**example, name: number})


@pytest.mark.parametrize("number", ENDLESS)
def test_the_json_encoding_writes_none(number: float) -> None:
    """Pictures are made of plain values, past the models."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        JSON.pack({"type": "snapshot", "clock": {"step_rate": number}})


@pytest.mark.parametrize("name", [name for _, name in TAKEN])
@pytest.mark.parametrize("number", ENDLESS)
def test_msgpack_brings_none_in(name: str, number: float) -> None:
    with pytest.raises(ProtocolError) as caught:
        MSGPACK.decode_client(msgpack.packb({"type": "create", name: number}))
    assert (caught.value.code, caught.value.field) == ("message/invalid-field", name)


@pytest.mark.parametrize(
    ("name", "number", "why"),
    [
        ("step_rate", 5e-324, "greater than or equal to 0.01"),
        ("step_rate", 0.009, "greater than or equal to 0.01"),
        ("move_budget", 5e-324, "0 (no limit), or at least 0.01 s"),
        ("move_budget", 0.001, "0 (no limit), or at least 0.01 s"),
    ],
)
def test_numbers_too_small_to_reckon_with_are_refused(name: str, number: float, why: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        MSGPACK.decode_client(msgpack.packb({"type": "create", name: number}))
    assert (caught.value.code, caught.value.field) == ("message/invalid-field", name)
    assert why in caught.value.message


@pytest.mark.parametrize(
    "name",
    [name for name, field in ServerSettings.model_fields.items() if holds_float(field.annotation)],
)
@pytest.mark.parametrize("text", ["inf", "nan"])
def test_no_setting_is_endless(name: str, text: str) -> None:
    with pytest.raises(ValidationError, match="finite"):
        ServerSettings(**{name: text})


def test_the_slowest_game_is_told_in_json(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, text=True) as ada:
            create = {"type": "create", "task": "synchronous/01", "clock": "realtime"}
            created = await ada.ask({**create, "step_rate": 0.01, "grace": 86_400}, "created")
            await ada.send({"type": "join", "episode": created["code"]})
            payload = "{}"
            while json.loads(payload).get("type") != "snapshot":
                payload = str(await ada.socket.recv())
            plain = json.loads(payload, parse_constant=pytest.fail)
            assert plain["left"] == pytest.approx(100, abs=0.1)
            await asyncio.sleep(99.0)
            assert server.lobby.find(created["code"]).episode.step == 0
            await asyncio.sleep(2.0)
            assert server.lobby.find(created["code"]).episode.step == 1

    run(main())
