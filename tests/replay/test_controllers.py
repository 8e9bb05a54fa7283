"""Who moved a seat in which step, from the recording alone."""

from __future__ import annotations

import json
from typing import Any

from robotouille import World
from robotouille.episode import Absence, Clock, Episode, Event, PauseReason, Rules
from robotouille.replay.container import MAGIC, pack_frame, read_frames
from robotouille.replay.controllers import Span, controllers, seatings, spans
from robotouille.replay.export import json_lines
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from tests.support.games import record

TASK = World("multi_agent/01")
STEP = 0.5


class Game:
    """An episode in real time, two steps a second, and all that has happened in it."""

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
    """A player's controllers, step by step."""
    course = controllers(recording)
    assert list(course) == list(range(1, len(recording.steps) + 1))
    return [seats[player] for seats in course.values()]


def test_a_stand_in_controls_exactly_the_steps_between_leaving_and_returning() -> None:
    game = Game(Absence.BOT, steps=9)
    game.steps(3)
    game.present("robot2", False)
    game.steps(2)
    game.present("robot2", True)
    game.steps(4)
    recording = game.recording()
    assert recording.outcome is not None
    assert of(recording, "robot1") == ["human"] * 9
    assert of(recording, "robot2") == ["model"] * 3 + ["stand-in"] * 2 + ["model"] * 4
    assert spans(recording)["robot2"] == [
        Span("robot2", "bob", "model", 1, 3),
        Span("robot2", "bob", "stand-in", 4, 5),
        Span("robot2", "bob", "model", 6, 9),
    ]


def test_a_seat_that_changes_hands_between_two_steps_has_had_nobody_else() -> None:
    """Gone and back before a step was taken: nothing was played without its participant."""
    game = Game(Absence.BOT, steps=4)
    game.steps(2)
    game.present("robot1", False)
    game.present("robot1", True)
    game.steps(2)
    assert spans(game.recording())["robot1"] == [Span("robot1", "ada", "human", 1, 4)]


def test_who_waits_is_absent_and_who_left_leaves_a_free_seat_to_the_next() -> None:
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


def test_before_the_first_step_the_seats_are_those_who_began() -> None:
    game = Game(Absence.WAIT)
    course = list(seatings(game.recording()))
    assert [step for step, _ in course] == [0]
    assert {p: (s.name, s.controller) for p, s in course[0][1].items()} == {
        "robot1": ("ada", "human"),
        "robot2": ("bob", "model"),
    }
    assert controllers(game.recording()) == {}


def test_a_restart_is_seen_and_the_rest_is_added_to_the_same_course() -> None:
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
    assert of(recording, "robot2") == ["model"] * 3 + ["stand-in"] * 2


def test_export_names_the_controllers_of_each_step() -> None:
    game = Game(Absence.BOT, steps=4)
    game.steps(2)
    game.present("robot2", False)
    game.steps(2)
    lines = [json.loads(line) for line in json_lines(game.recording())]
    rows = [line["controllers"] for line in lines if line["kind"] == "step"]
    assert [row["robot2"] for row in rows] == ["model", "model", "stand-in", "stand-in"]
    assert {row["robot1"] for row in rows} == {"human"}


def test_recordings_of_earlier_versions_name_no_controller() -> None:
    game = Game(Absence.WAIT, steps=6)
    game.steps(2)
    game.present("robot2", False)
    game.steps(2)
    game.present("robot2", True)
    game.steps(2)
    old = [_as_before(frame) for frame in read_frames(game.recording().stream)]
    recording = Recording(MAGIC + b"".join(map(pack_frame, old)))
    assert of(recording, "robot2") == ["model"] * 2 + ["absent"] * 2 + ["model"] * 2


def _as_before(frame: dict[str, Any]) -> dict[str, Any]:
    if frame["kind"] != "notes":
        return frame
    kept = ("note", "t", "player", "name", "kind", "present")
    notes = [
        {key: note[key] for key in kept} if note["note"] == "roster" else note
        for note in frame["notes"]
    ]
    assert all("controller" not in note for note in notes)
    return {**frame, "notes": notes}
