"""Events of a game as samples."""

from __future__ import annotations

import json

import pytest

from robotouille import World
from robotouille.protocol import messages
from robotouille_client.lsl.outlets import Outlets
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
