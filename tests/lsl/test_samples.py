"""Conversion of events to LSL samples."""

from __future__ import annotations

import json
from unittest.mock import MagicMock

import pytest

from robotouille import GroundAction, World
from robotouille.protocol import messages
from robotouille_client.lsl import (
    STEP_CHANNELS,
    Latency,
    Outlets,
    markers,
    open_outlets,
    step_sample,
)
from robotouille_client.sansio.game_events import (
    Announced,
    ChatReceived,
    GameEnded,
    GameEvent,
    RosterChanged,
    StateChanged,
)

WORLD = World("multi_agent/01")
FIRST, SECOND = WORLD.initial.actions("robot1")[:2]
STEP = StateChanged(7, WORLD.initial, None, (("robot1", FIRST, True), ("robot2", SECOND, False)))
PAUSE = messages.Pause(reason="absence")


class KeptOutlet:
    def __init__(self) -> None:
        self.samples: list[tuple[list[object], float]] = []

    def push_sample(self, x: list[object], timestamp: float) -> None:
        self.samples.append((x, timestamp))


def test_repeated_phase_is_one_marker() -> None:
    outlets = Outlets(KeptOutlet(), events := KeptOutlet(), lambda: 0.0)
    phases = (("waiting", None), ("running", None), ("running", None), ("paused", PAUSE))
    for phase, pause in (*phases, ("running", None)):
        outlets.push(RosterChanged(phase, (), pause), 0, 0.0)
    expected = [json.loads(str(x[0])) for x, _ in events.samples]
    assert [(row["phase"], row.get("reason")) for row in expected] == [
        ("waiting", None), ("running", None), ("paused", "absence"), ("running", None),
    ]  # fmt: skip


def test_markers_of_a_hostile_server_are_short() -> None:
    long = "x" * 1_000_000
    action = MagicMock(arguments=(long,))
    action.name = long
    step = StateChanged(7, WORLD.initial, None, (("robot1", action, True),))
    reasons: tuple[object, ...] = (long, {"reason": [long] * 3}, [[long]])
    ends = [GameEnded({"reason": reason}, "", "") for reason in reasons]
    for event in (step, *ends):
        (marker,) = markers(event, 7)
        assert len(marker) < 2_000


def test_step_sample_has_a_value_for_each_channel() -> None:
    assert step_sample(STEP, 0.0015) == [7, 1, 1, 1.5]
    assert len(STEP_CHANNELS) == 4
    assert step_sample(Announced("hello"), 0.0) is None


def marked(seat: str, action: GroundAction, applied: bool) -> dict[str, object]:
    row = [action.name, *action.arguments]
    return {"event": "action", "seat": seat, "action": row, "applied": applied}


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        (STEP, [marked("robot1", FIRST, True), marked("robot2", SECOND, False)]),
        (
            RosterChanged("paused", (), PAUSE),
            [{"event": "phase", "phase": "paused", "reason": "absence"}],
        ),
        (RosterChanged("running", ()), [{"event": "phase", "phase": "running"}]),
        (
            ChatReceived("ada", "robot1", "what I say is mine"),
            [{"event": "said", "seat": "robot1"}],
        ),
        (Announced("hello"), [{"event": "announced"}]),
        (GameEnded({"reason": "goal"}), [{"event": "ended", "reason": "goal"}]),
        (GameEnded({}, "sent out"), [{"event": "ended", "reason": "sent out"}]),
    ],
)
def test_markers_contain_no_names_or_texts(
    event: GameEvent, expected: list[dict[str, object]]
) -> None:
    found = [json.loads(marker) for marker in markers(event, 9)]
    assert found == [{"step": 9, **row} for row in expected]


def test_time_stamp_is_the_time_of_sending() -> None:
    steps, events = KeptOutlet(), KeptOutlet()
    Outlets(steps, events, lambda: 100.0).push(STEP, 7, 0.25)
    assert [stamp for _, stamp in steps.samples + events.samples] == [99.75] * 3


def test_latency_is_half_of_the_shortest_round_trip() -> None:
    latency = Latency()
    assert latency.seconds == 0.0
    latency.trips.extend([0.3, 0.02, 0.05])
    assert latency.seconds == 0.01


def test_server_texts_are_safe_for_lsl() -> None:
    """Half of a surrogate pair would end the stream, and XML has no control characters."""
    (marker,) = markers(GameEnded({"reason": "\ud800\x1b"}, ""), 1)
    marker.encode()
    assert json.loads(marker)["reason"] == "\ud800\x1b"
    library = MagicMock(IRREGULAR_RATE=0.0, cf_double64=0.0, cf_string=0.0)
    library.local_clock.return_value = 0.0
    open_outlets(library, "e\ud800\0", "x" * 10_000, "ws://\x1b", [0.0])
    texts = [each for call in library.mock_calls for each in call.args if isinstance(each, str)]
    assert "robotouille-e\ufffd\ufffd-steps" in texts
    assert all(each.isprintable() and len(each) <= 600 for each in texts)


def test_markers_shorten_long_texts() -> None:
    (ended,) = markers(GameEnded({"reason": "x" * 1_000_000}, ""), 1)
    (phase,) = markers(RosterChanged("y" * 1_000_000, ()), 1)
    assert max(len(ended), len(phase)) < 1_000
