"""Staleness, late answers and steps lost to thinking, against numbers worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from robotouille.episode import Clock, Episode, Rules
from robotouille.replay.analysis.transitions import transitions
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille_evaluation.metrics import Answer, Trajectory, measure
from robotouille_evaluation.metrics.real_time import (
    LateAnswers,
    late_answers,
    lost_to_thinking,
    staleness,
)
from robotouille_evaluation.realtime.thoughts import (
    TOPIC,
    Fate,
    Thought,
    begun_note,
    ended_note,
    thoughts,
)
from tests.evaluation.metrics.courses import SANDWICH, refused, solo

THERE, BACK = "Move robot1 from table3 to table1", "Move robot1 from table1 to table3"
AWAY = "Move robot1 from table3 to table5"


def course(*thought: Thought) -> Trajectory:
    """Nothing, nothing, to the cheese, nothing, back; the steps are 0 to 4.

    The first was chosen at step 0 and the second at step 3. In between, at step 4, an answer of
    step 2 was refused, which was valid then; and one of step 3, which never was.
    """
    played = solo(SANDWICH, None, None, THERE, None, BACK)
    one, two = (replace(a, basis=b) for a, b in zip(played.answers, (0, 3), strict=True))
    late = replace(refused(played, 4, AWAY)[0], basis=2)
    wrong = replace(refused(played, 4, AWAY)[0], basis=3)
    return replace(played, answers=(one, late, wrong, two), thoughts=thought)


def test_staleness_is_the_mean_of_what_was_applied() -> None:
    """Two steps and one."""
    assert staleness(course()) == staleness(course(), "robot1") == 1.5
    assert staleness(course(), "robot2") is None
    assert staleness(solo(SANDWICH, THERE, BACK)) is None, "it is not recorded"
    assert staleness(replace(course(), answers=())) is None


def test_late_answers_are_those_that_were_valid_once() -> None:
    """Three: two that were applied, and one that was refused."""
    assert late_answers(course()) == LateAnswers(3, 2)
    assert late_answers(course()).share == pytest.approx(2 / 3)
    assert late_answers(solo(SANDWICH, THERE)).share is None


def test_what_was_dropped_did_not_hold() -> None:
    """The one from step 3 was no answer to what was seen there; it is not late, but wrong."""
    dropped = (Thought("robot1", 0, 2, THERE), Thought("robot1", 3, 4, AWAY))
    assert late_answers(course(*dropped)) == LateAnswers(4, 2)


def test_answers_in_their_step_are_not_late() -> None:
    played = course()
    punctual = [replace(answer, basis=answer.step) for answer in played.answers]
    assert late_answers(replace(played, answers=tuple(punctual))) == LateAnswers(0, 0)


@pytest.mark.parametrize(
    ("given", "lost"),
    [
        ([Thought("robot1", 0, 2)], 2),
        ([Thought("robot1", 0, 3)], 2),  # in the third step it acted
        ([Thought("robot1", 0, 2), Thought("robot1", 3, 4)], 3),
        ([Thought("robot1", 1)], 2),  # it never came: steps 1 and 3
        ([Thought("robot1", 0, 2), Thought("robot1", 1, 2)], 2),  # no step is lost twice
        ([Thought("robot1", 3, 99)], 1),
        ([], None),
    ],
)
def test_steps_without_an_action_while_it_thinks_are_lost(
    given: list[Thought], lost: int | None
) -> None:
    assert lost_to_thinking(course(*given)) == lost


def test_they_are_in_the_measures() -> None:
    found = measure(course(Thought("robot1", 0, 2)), 10)
    assert (found.staleness, found.late_answers, found.lost_to_thinking) == (1.5, 3, 2)
    assert found.held_share == pytest.approx(2 / 3)
    old = measure(solo(SANDWICH, THERE), 10)
    assert (old.staleness, old.late_answers, old.held_share) == (None, 0, None)


def note(step: int, text: str, **more: Any) -> dict[str, Any]:
    return {"step": step, "note": "noted", "player": "robot1", "topic": TOPIC, "text": text} | more


def test_notes_are_read_as_they_are_written_and_others_are_left_alone() -> None:
    notes = [
        note(0, begun_note(0)),
        note(1, begun_note(1), player="robot2"),
        note(2, ended_note(0, Fate.DROPPED, THERE)),
        note(2, begun_note(2)),
        note(3, ended_note(1, Fate.USED)),  # of another's thought
        note(4, ended_note(2, Fate.NONE)),
    ]
    assert thoughts(notes) == (
        Thought("robot1", 0, 2, THERE),
        Thought("robot2", 1),
        Thought("robot1", 2, 4),
    )
    strange = ["", "3", "[]", "{}", '{"basis": "1"}', '{"basis": true}', '{"basis": -1}']
    assert thoughts(note(9, text) for text in [*strange, '{"basis": 10}', "{"]) == ()
    assert thoughts([note(1, begun_note(1), topic="mine"), {"note": "started", "step": 0}]) == ()


def recorded() -> Recording:
    """In real time: an action on step 0, one that is refused, one on nothing, one of the future."""
    rules = Rules(clock=Clock.REALTIME, step_rate=1, max_steps=9)
    episode, recorder = Episode(SANDWICH, rules), Recorder(SANDWICH)
    content = recorder.begin(header(SANDWICH.task, rules, episode="e"))
    episode.join("robot1", "m", "model", 0.0)
    episode.tick(2.0)
    episode.submit("robot1", 1, AWAY, 2.1, basis=1)
    episode.submit("robot1", 2, THERE, 2.2, basis=0)
    episode.submit("robot1", 3, "Boil the sea", 2.3, basis=2)
    episode.tick(3.0)
    episode.submit("robot1", 4, BACK, 3.1)
    episode.tick(4.0)
    episode.submit("robot1", 5, THERE, 4.1, basis=99)
    episode.tick(5.0)
    episode.abort(5.0, "enough")
    return Recording(content + recorder.record(episode.events()))


def test_recordings_have_the_basis_of_moves_and_of_what_was_asked_in_vain() -> None:
    recording = recorded()
    assert recording.verify().identical
    moves = [move.get("basis") for step in recording.steps for move in step["moves"]]
    assert moves == [0, None, None], "what is still to come says nothing"
    vain = [(n["reasons"][0], n.get("basis")) for n in recording.notes() if n["note"] == "rejected"]
    assert vain[0] == ("superseded by action 2", 1)
    assert [basis for _, basis in vain] == [1, 2]
    assert [t.basis for t in transitions(recording) if t.seq] == [1, 2, 0, None, None]
    found = Trajectory.recorded(recording)
    assert staleness(found) == 2
    assert [a.basis for a in found.answers] == [2, 0, None, None]
    assert isinstance(found.answers[0], Answer)
    assert json.loads(begun_note(3)) == {"basis": 3}
