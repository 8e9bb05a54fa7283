"""The drill's evidence from the frames of a person's pages."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON
from robotouille.protocol.states import StateWriter
from tests.programs.drill.page_witness import PageWitness

WORLD = World(load_task("multi_agent/01_lettuce_burger"))
ADA = WORLD.players[0]
MOVE = {"name": "move", "args": [ADA, "table1", "stove1"]}


class Wire:
    """A connection of a page as the browser reports it."""

    def __init__(self, witness: PageWitness) -> None:
        self._calls: dict[str, Callable[[Any], None]] = {}
        witness.follow(self)
        self._calls["websocket"](self)
        self.receive(messages.Joined(episode="e", code="KQXZB-MHTWA", role="player", seat=ADA))

    def on(self, event: str, call: Callable[[Any], None]) -> None:
        self._calls[event] = call

    def receive(self, message: messages.ServerMessage) -> None:
        self._calls["framereceived"](JSON.encode(message))

    def send(self, **message: Any) -> None:
        self._calls["framesent"](json.dumps(message))

    def act(self, seq: int) -> None:
        self.send(type="act", seq=seq, action=MOVE, basis=0)

    def close(self) -> None:
        self._calls["close"](self)


@pytest.fixture
def told() -> list[str]:
    """Return the reported events of the person's seat and phases of the game."""
    return []


@pytest.fixture
def witness(tmp_path: Path, told: list[str]) -> Iterator[PageWitness]:
    def said(event: str, *, phase: str = "") -> None:
        told.append(phase or event)

    witness = PageWitness("e", ADA, "Ada", tmp_path, said)
    yield witness
    witness.close()


@pytest.fixture
def wire(witness: PageWitness) -> Wire:
    wire = Wire(witness)
    wire.receive(snapshot())
    return wire


def snapshot(**fields: Any) -> messages.Snapshot:
    writer = StateWriter(WORLD)
    seats = [messages.SeatInfo(player=name, name=name, kind="bot") for name in WORLD.players]
    rest = {
        "episode": "e", "step": 0, "phase": "running", "digest": "d", "task": WORLD.task.json,
        "hash": "h", "seats": seats, "clock": {}, **fields,
    }  # fmt: skip
    tables, values = writer.tables(WORLD.initial), writer.values(WORLD.initial)
    return messages.Snapshot.model_validate({**tables, **values, **rest})


def delta(step: int, seq: int, **fields: Any) -> messages.Delta:
    return messages.Delta(step=step, did=[[0, "move", "table1", "stove1"]], seq=[seq], **fields)


def acts(witness: PageWitness, tmp_path: Path) -> list[list[Any]]:
    """Return the evidence of actions."""
    witness.close()
    (path,) = tmp_path.glob("*.jsonl")
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert rows[0] == ["game", "e", ADA, "Ada"]
    return [row[1:] for row in rows if row[0] == "act"]


def test_answers_of_a_page_become_evidence(
    witness: PageWitness, wire: Wire, tmp_path: Path
) -> None:
    move = ["move", *MOVE["args"]]
    wire.act(1)
    wire.receive(delta(1, 1))
    wire.act(2)
    wire.receive(delta(2, 2, unmet={"0": ["no"]}))
    wire.act(3)
    wire.act(4)
    wire.receive(delta(3, 4))
    wire.act(5)
    wire.receive(
        messages.Rejected(seq=5, step=3, action="move", code="action/turn", reasons=["not yours"])
    )
    assert not witness.unanswered
    assert witness.sent == 5
    assert acts(witness, tmp_path) == [
        [1, move, True, 1, ""],
        [2, move, False, 2, ""],
        [3, move, False, 3, "superseded"],
        [4, move, True, 3, ""],
        [5, move, False, 3, "action/turn"],
    ]


def test_repeated_action_counts_once_and_its_answer_may_come_later(
    witness: PageWitness, wire: Wire, told: list[str], tmp_path: Path
) -> None:
    wire.act(1)
    wire.close()
    assert told == ["back", "running", "lost"]
    again = Wire(witness)
    again.act(1)
    again.receive(snapshot(step=4, seq=1, last_seq=1, last_step=3))
    assert witness.sent == 1
    assert [row[0] for row in acts(witness, tmp_path)] == [1]
    assert witness.faults == []


def test_answered_action_that_is_sent_again_is_a_fault(witness: PageWitness, wire: Wire) -> None:
    wire.act(1)
    wire.receive(delta(1, 1))
    wire.act(1)
    assert witness.faults == ["the page sent action 1 again, which had an answer"]


def test_page_that_replaces_an_unanswered_action_by_itself_is_a_fault(
    witness: PageWitness, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such a page does an action twice after a lost connection: the server may have the first."""
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    for seq in (1, 2):
        witness.chose()
        wire.act(seq)
    wire.close()
    now[0] += 3
    again = Wire(witness)
    again.act(2)
    assert witness.faults == []
    again.act(3)
    assert witness.faults == ["action 3 without a choice, and action 2 has no answer"]


def test_action_without_an_answer_is_noticed_only_while_the_server_can_answer(
    witness: PageWitness, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    wire.act(1)
    now[0] += 5
    assert witness.unanswered_seconds == 5
    wire.close()
    now[0] += 60
    assert witness.unanswered_seconds == 0
    again = Wire(witness)
    now[0] += 7
    assert witness.unanswered_seconds == 7
    again.receive(messages.Roster(phase="paused", turn=None, seats=[]))
    assert witness.unanswered_seconds == 0


def test_phases_are_reported_at_once(witness: PageWitness, told: list[str]) -> None:
    assert witness.phase == "entering"
    wire = Wire(witness)
    wire.receive(snapshot(phase="waiting"))
    seats: list[messages.SeatInfo] = []
    wire.receive(messages.Roster(phase="waiting", turn=None, seats=seats, starts_in=3.0))
    for phase in ("running", "running", "paused"):
        wire.receive(messages.Roster(phase=phase, turn=None, seats=seats))
    assert told == ["back", "waiting", "countdown", "running", "paused"]
    assert witness.phase == "paused"


def test_person_cannot_know_the_answer_that_a_closed_page_misses(
    witness: PageWitness, wire: Wire, tmp_path: Path
) -> None:
    wire.act(1)
    witness.forget()
    wire.close()
    Wire(witness).receive(delta(1, 1))
    assert acts(witness, tmp_path) == []
