"""Events of a game as samples."""

from __future__ import annotations

import json
from typing import Any

import pytest

from robotouille import World
from robotouille.protocol import messages
from robotouille_client.lsl.outlets import Outlets, open_outlets
from robotouille_client.lsl.samples import STEP_CHANNELS, markers, step_sample
from robotouille_client.lsl.stream import Latency
from robotouille_client.sansio.game_events import (
    Announced,
    Changed,
    GameEvent,
    Heard,
    Over,
    RosterChanged,
)

WORLD = World("multi_agent/01")
FIRST, SECOND = WORLD.initial.actions("robot1")[:2]
STEP = Changed(7, WORLD.initial, None, (("robot1", FIRST, True), ("robot2", SECOND, False)))
PAUSE = messages.Pause(reason="absence")


def test_a_phase_is_told_once() -> None:
    told: list[str] = []

    class Kept:
        def push_sample(self, x: list[object], timestamp: float) -> None:
            told.append(json.loads(str(x[0])))

    outlets = Outlets(Kept(), Kept(), lambda: 0.0)
    for phase, pause in (
        ("waiting", None),
        ("running", None),
        ("running", None),
        ("paused", PAUSE),
    ):
        outlets.push(RosterChanged(phase, (), pause), 0, 0.0)
    outlets.push(RosterChanged("running", ()), 0, 0.0)
    assert [(row["phase"], row.get("reason")) for row in told] == [
        ("waiting", None), ("running", None), ("paused", "absence"), ("running", None),
    ]  # fmt: skip


def test_a_step_has_a_number_for_each_channel() -> None:
    assert step_sample(STEP, 0.0015) == [7, 1, 1, 1.5]
    assert len(STEP_CHANNELS) == 4
    assert step_sample(Announced("hello"), 0.0) is None


@pytest.mark.parametrize(
    ("event", "told"),
    [
        (
            STEP,
            [
                {
                    "event": "action",
                    "seat": "robot1",
                    "action": [FIRST.name, *FIRST.arguments],
                    "applied": True,
                },
                {
                    "event": "action",
                    "seat": "robot2",
                    "action": [SECOND.name, *SECOND.arguments],
                    "applied": False,
                },
            ],
        ),
        (
            RosterChanged("paused", (), PAUSE),
            [{"event": "phase", "phase": "paused", "reason": "absence"}],
        ),
        (RosterChanged("running", ()), [{"event": "phase", "phase": "running"}]),
        (Heard("ada", "robot1", "what I say is mine"), [{"event": "said", "seat": "robot1"}]),
        (Announced("hello"), [{"event": "announced"}]),
        (Over({"reason": "goal"}), [{"event": "over", "reason": "goal"}]),
        (Over({}, "sent out"), [{"event": "over", "reason": "sent out"}]),
    ],
)
def test_what_happens_is_told_without_names_and_words(
    event: GameEvent, told: list[dict[str, object]]
) -> None:
    found = [json.loads(marker) for marker in markers(event, 9)]
    assert found == [{"step": 9, **row} for row in told]


class KeptOutlet:
    def __init__(self) -> None:
        self.samples: list[tuple[list[object], float]] = []

    def push_sample(self, x: list[object], timestamp: float) -> None:
        self.samples.append((x, timestamp))


def test_the_stamp_is_when_it_was_sent() -> None:
    steps, events = KeptOutlet(), KeptOutlet()
    Outlets(steps, events, lambda: 100.0).push(STEP, 7, 0.25)
    assert [stamp for _, stamp in steps.samples + events.samples] == [99.75] * 3


def test_messages_are_under_way_for_half_of_the_shortest_round_trip() -> None:
    latency = Latency()
    assert latency.seconds == 0.0
    latency.trips.extend([0.3, 0.02, 0.05])
    assert latency.seconds == 0.01


def test_what_a_server_words_is_text_for_lsl() -> None:
    """Half of a surrogate pair ended the stream; XML has no control characters."""
    (marker,) = markers(Over({"reason": "\ud800\x1b"}, ""), 1)
    marker.encode()
    assert json.loads(marker)["reason"] == "\ud800\x1b"
    described: list[str] = []

    class Element:
        def append_child(self, name: str) -> Element:
            return self

        def append_child_value(self, name: str, value: str) -> None:
            described.append(value)

    class Library:
        IRREGULAR_RATE = cf_double64 = cf_string = 0.0

        @staticmethod
        def local_clock() -> float:
            return 0.0

        class StreamInfo:
            def __init__(self, *about: object) -> None:
                described.extend(str(each) for each in about)

            def desc(self) -> Element:
                return Element()

        class StreamOutlet:
            def __init__(self, info: object) -> None:
                pass

    library: Any = Library
    open_outlets(library, "e\ud800\0", "x" * 10_000, "ws://\x1b", [0.0])
    assert "robotouille-e\ufffd\ufffd-steps" in described
    assert all(each.isprintable() and len(each) <= 600 for each in described)
