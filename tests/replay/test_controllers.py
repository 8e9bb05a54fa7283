"""Controllers of seats by step, and the export as lines of JSON."""

from __future__ import annotations

import json

from robotouille import World
from robotouille.episode import Absence, Clock, Episode, Event, PauseReason, Rules
from robotouille.replay.controllers import EXPORTED, Span, controllers, json_lines, spans
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from tests.support.games import record
from tests.support.random_play import random_stream

TASK = World("multi_agent/01")
STEP = 0.5


class Game:
    """Real-time episode with two steps per second, and its events."""

    def __init__(self, absence: Absence, steps: int = 20) -> None:
        rules = Rules(clock=Clock.REALTIME, step_rate=2.0, absence=absence, max_steps=steps)
        self.now = 0.0
        self.episode = Episode(TASK, rules)
        self.events: list[Event] = []
        self.episode.join("robot1", "ada", "human", 0.0)
        self.episode.join("robot2", "bob", "model", 0.0)

    def steps(self, count: int) -> None:
        for _ in range(count):
            self.now += STEP
            self.episode.tick(self.now)

    def present(self, player: str, present: bool) -> None:
        self.episode.set_present(player, present, self.now)

    def recording(self) -> Recording:
        self.events += self.episode.events()
        return Recording(record(self.episode, self.events))


def of(recording: Recording, player: str) -> list[str]:
    """Return a player's controllers by step."""
    course = controllers(recording)
    assert list(course) == list(range(1, len(recording.steps) + 1))
    return [seats[player] for seats in course.values()]


def test_substitute_controls_the_steps_between_loss_and_return() -> None:
    game = Game(Absence.BOT, steps=9)
    game.steps(3)
    game.present("robot2", False)
    game.steps(2)
    game.present("robot2", True)
    game.steps(4)
    recording = game.recording()
    assert recording.outcome is not None
    assert of(recording, "robot1") == ["human"] * 9
    assert of(recording, "robot2") == ["model"] * 3 + ["substitute"] * 2 + ["model"] * 4
    assert spans(recording)["robot2"] == [
        Span("robot2", "bob", "model", 1, 3),
        Span("robot2", "bob", "substitute", 4, 5),
        Span("robot2", "bob", "model", 6, 9),
    ]


def test_absent_free_and_taken_again() -> None:
    game = Game(Absence.WAIT, steps=8)
    game.steps(1)
    game.present("robot1", False)
    game.steps(2)
    game.episode.leave("robot1", game.now)
    game.steps(2)
    game.episode.join("robot1", "carol", "bot", game.now)
    game.steps(3)
    found = [
        (span.name, span.controller, span.first, span.last)
        for span in spans(game.recording())["robot1"]
    ]
    assert found == [
        ("ada", "human", 1, 1),
        ("ada", "absent", 2, 3),
        ("", "", 4, 5),
        ("carol", "bot", 6, 8),
    ]


def test_controllers_across_a_restart() -> None:
    game = Game(Absence.BOT)
    game.steps(3)
    cut_off = game.recording()
    found = restore(cut_off, now=100.0, patience=10.0)
    game.episode, game.now = found.episode, 100.0
    game.present("robot1", True)
    game.steps(1)
    assert PauseReason.RESTART in found.episode.pauses
    game.now = 110.0
    game.episode.tick(game.now)
    game.steps(2)
    recording = game.recording()
    assert "restarted" in [note["note"] for note in recording.notes()]
    assert of(recording, "robot1") == ["human"] * 5
    assert of(recording, "robot2") == ["model"] * 3 + ["substitute"] * 2


def test_export_has_the_controllers_of_each_step() -> None:
    game = Game(Absence.BOT, steps=4)
    game.steps(2)
    game.present("robot2", False)
    game.steps(2)
    lines = [json.loads(line) for line in json_lines(game.recording())]
    rows = [line["controllers"] for line in lines if line["kind"] == "step"]
    assert [row["robot2"] for row in rows] == ["model", "model", "substitute", "substitute"]
    assert {row["robot1"] for row in rows} == {"human"}
    texts = [json.loads(line) for line in json_lines(game.recording(), texts=True)]
    assert (texts[0]["kind"], texts[-1]["kind"]) == ("header", "outcome")
    steps = [line for line in texts if line["kind"] == "step"]
    assert set(steps[1]["observations"]) == {"robot1", "robot2"}
    assert {*steps[1], "undone"} == {"kind", *EXPORTED["step"]}


def test_every_exported_field_is_documented() -> None:
    for seed in range(4):
        for line in map(json.loads, json_lines(Recording(random_stream(seed)), texts=True)):
            documented = EXPORTED[line["kind"]]
            assert "…" in documented or set(line) <= {"kind", *documented}
