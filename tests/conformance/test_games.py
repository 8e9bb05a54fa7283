"""An independent JavaScript client with its own MessagePack library plays whole games."""

from __future__ import annotations

import base64
import json
from typing import Any

import msgpack
import pytest

from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK
from tests.conformance.node import run_node
from tests.conformance.plans import played_plan
from tests.support.server_process import ServerProcess

pytestmark = pytest.mark.process

TASK = "multi_agent/09_two_lettuce_cheeseburgers@2"
"""Task with a plan that can be played in seat order with valid actions only."""
CREATE = {"task": TASK, "clock": "lockstep", "seed": 7, "max_steps": 200, "move_budget": 600.5}
ELSEWHERE = {
    "moved": "with several worker processes",
    "notice": "when an operator says it",
    "picture": "where a server has kitchens of its own",
}
"""Message types that this conversation does not cause."""

PRIVATE = ("session", "resume", "episode", "code")
"""Fields that identify a game or participant."""
OF_TIME = ("left", "seconds")


@pytest.fixture(scope="module")
def talks(server: ServerProcess) -> dict[str, dict[str, Any]]:
    """Return the same conversation in both subprotocols."""
    world, plan, _ = played_plan(TASK)
    options = {"url": server.url, "create": CREATE, "seats": list(world.players), "plan": plan}
    return {
        codec.name: run_node("conversation", subprotocol=codec.name, **options)
        for codec in (JSON, MSGPACK)
    }


def reported(talk: dict[str, Any]) -> list[dict[str, Any]]:
    return [row for rows in talk["transcript"].values() for row in rows]


def test_game_uses_every_type_of_message(talks: dict[str, Any]) -> None:
    sent = {str(model.model_fields["type"].default) for model in messages.CLIENT_MESSAGES}
    received = {str(model.model_fields["type"].default) for model in messages.SERVER_MESSAGES}
    for name, talk in talks.items():
        assert talk["outcome"]["reason"] == "goal", name
        assert sent <= set(talk["sent"])
        assert {row["message"]["type"] for row in reported(talk)} >= received - ELSEWHERE.keys()


def test_deltas_reproduce_the_facts_of_the_world(talks: dict[str, Any]) -> None:
    _, _, facts = played_plan(TASK)
    for talk in talks.values():
        assert talk["states"] == facts


def test_both_subprotocols_have_the_same_messages(talks: dict[str, Any]) -> None:
    """Only identifiers and times may differ, and when rosters come among other messages."""
    one, other = (anonymous(talk["transcript"]) for talk in talks.values())
    for name, rows in one.items():
        assert rows == other[name], name
        assert rows


def test_messagepack_implementations_agree(talks: dict[str, Any]) -> None:
    rows = reported(talks[MSGPACK.name])
    assert len(rows) > 100
    for row in rows:
        raw = base64.b64decode(row["raw"])
        assert row["binary"]
        assert msgpack.unpackb(raw) == row["message"]
        check(MSGPACK.decode_server(raw), row["message"])


def test_json_implementations_agree(talks: dict[str, Any]) -> None:
    for row in reported(talks[JSON.name]):
        assert not row["binary"]
        assert json.loads(row["raw"]) == row["message"]
        check(JSON.decode_server(row["raw"]), row["message"])


def check(message: messages.Message, plain: dict[str, Any]) -> None:
    assert message.model_dump(mode="json", exclude_unset=True) == plain


def test_second_connection_with_a_token_ends_the_first(talks: dict[str, Any]) -> None:
    for talk in talks.values():
        assert talk["resumed"]
        assert talk["bye"]["type"] == "bye"
        assert talk["closed"]["code"] == 1008


def anonymous(transcript: dict[str, Any]) -> dict[str, list[Any]]:
    """Return the plain messages without identifiers and times."""
    names: dict[str, str] = {}
    for row in (row for rows in transcript.values() for row in rows):
        for key in PRIVATE:
            value = row["message"].get(key)
            if isinstance(value, str) and "/" not in value:
                names.setdefault(value, f"<{key}>")
    return {
        person: [scrubbed(row["message"], names) for row in rows if not _depends_on_time(row)]
        for person, rows in transcript.items()
    }


def _depends_on_time(row: dict[str, Any]) -> bool:
    # Rosters about spectators are combined for a fifth of a second.
    return row["message"]["type"] in ("episodes", "roster")


def scrubbed(value: Any, names: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {
            key: type(inner).__name__ if key in OF_TIME else scrubbed(inner, names)
            for key, inner in value.items()
        }
    if isinstance(value, list):
        return [scrubbed(inner, names) for inner in value]
    if isinstance(value, str):
        for name, word in names.items():
            value = value.replace(name, word)
    return value


@pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=["json", "msgpack"])
@pytest.mark.parametrize("seen", [True, False], ids=["what-was-missed", "a-snapshot"])
def test_game_continues_after_each_lost_connection(
    server: ServerProcess, codec: Any, seen: bool
) -> None:
    """The token of the last welcome restores the seat and the missed messages.

    The action in flight is sent again and is executed once.
    """
    world, plan, facts = played_plan("synchronous/01")
    result = run_node(
        "cuts",
        url=server.url,
        subprotocol=codec.name,
        create={"task": world.task.name, "clock": "lockstep"},
        plan=plan,
        every=3,
        seen=seen,
    )
    assert result["outcome"]["reason"] == "goal"
    assert result["outcome"]["steps"] == len(plan)
    assert result["resumed"] >= 3
    assert result["states"] == facts
    assert result["tokens"] == result["resumed"] + 1, "each welcome has another token"
