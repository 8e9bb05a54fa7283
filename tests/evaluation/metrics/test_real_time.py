"""Staleness, late answers and steps lost to thinking, against hand-computed values."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille_evaluation.metrics import Trajectory, measure
from robotouille_evaluation.metrics.measuring import (
    LateAnswers,
    late_answers,
    lost_to_thinking,
    staleness,
)
from robotouille_evaluation.realtime.thoughts import (
    TOPIC,
    AnswerFate,
    Thought,
    begun_note,
    ended_note,
    thoughts,
)
from tests.evaluation.metrics.courses import SANDWICH, refused, solo

THERE, BACK = "Move robot1 from table3 to table1", "Move robot1 from table1 to table3"
AWAY = "Move robot1 from table3 to table5"


def course(*thought: Thought) -> Trajectory:
    """Return a trajectory with moves at the steps 2 and 4 and rejected answers.

    The first move was chosen at step 0 and the second at step 3. At step 4, an answer from step 2
    that was valid then was rejected, and one from step 3 that never was.
    """
    played = solo(SANDWICH, None, None, THERE, None, BACK)
    one, two = (replace(a, basis=b) for a, b in zip(played.answers, (0, 3), strict=True))
    late = replace(refused(played, 4, AWAY)[0], basis=2)
    wrong = replace(refused(played, 4, AWAY)[0], basis=3)
    return replace(played, answers=(one, late, wrong, two), thoughts=thought)


def test_staleness_of_applied_answers() -> None:
    assert staleness(course()) == staleness(course(), "robot1") == 1.5
    assert staleness(course(), "robot2") is None
    assert staleness(solo(SANDWICH, THERE, BACK)) is None, "the basis is not recorded"
    assert staleness(replace(course(), answers=())) is None


def test_late_answers_were_valid_at_their_basis() -> None:
    """Two were applied and one was rejected."""
    assert late_answers(course()) == LateAnswers(3, 2)
    assert late_answers(course()).share == pytest.approx(2 / 3)
    assert late_answers(solo(SANDWICH, THERE)).share is None


def test_dropped_answers_did_not_hold() -> None:
    """The answer from step 3 was invalid there, so it is wrong and not late."""
    dropped = (Thought("robot1", 0, 2, THERE), Thought("robot1", 3, 4, AWAY))
    assert late_answers(course(*dropped)) == LateAnswers(4, 2)


def test_answers_in_the_same_step_are_not_late() -> None:
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
def test_steps_lost_to_thinking(given: list[Thought], lost: int | None) -> None:
    assert lost_to_thinking(course(*given)) == lost


def test_real_time_measures() -> None:
    found = measure(course(Thought("robot1", 0, 2)), 10)
    assert (found.staleness, found.late_answers, found.lost_to_thinking) == (1.5, 3, 2)
    assert found.held_share == pytest.approx(2 / 3)
    old = measure(solo(SANDWICH, THERE), 10)
    assert (old.staleness, old.late_answers, old.held_share) == (None, 0, None)


def note(step: int, text: str, **more: Any) -> dict[str, Any]:
    return {"step": step, "note": "noted", "player": "robot1", "topic": TOPIC, "text": text} | more


def test_notes_round_trip_and_other_notes_are_ignored() -> None:
    notes = [
        note(0, begun_note(0)),
        note(1, begun_note(1), player="robot2"),
        note(2, ended_note(0, AnswerFate.DROPPED, THERE)),
        note(2, begun_note(2)),
        note(3, ended_note(1, AnswerFate.USED)),  # of another's thought
        note(4, ended_note(2, AnswerFate.NONE)),
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
    """Record actions based on step 0, on nothing and on the future, and a rejected one."""
    rules = Rules(clock=Clock.REALTIME, step_rate=1, max_steps=9)
    episode, recorder = Episode(SANDWICH, rules), Recorder(SANDWICH)
    content = recorder.begin(header(SANDWICH.task, rules, episode="e"))
    episode.join("robot1", "m", "model", 0.0)
    episode.tick(2.0)
    episode.submit("robot1", ActionRequest(1, AWAY, basis=1), 2.1)
    episode.submit("robot1", ActionRequest(2, THERE, basis=0), 2.2)
    episode.submit("robot1", ActionRequest(3, "Boil the sea", basis=2), 2.3)
    episode.tick(3.0)
    episode.submit("robot1", ActionRequest(4, BACK), 3.1)
    episode.tick(4.0)
    episode.submit("robot1", ActionRequest(5, THERE, basis=99), 4.1)
    episode.tick(5.0)
    episode.abort(5.0, "enough")
    return Recording(content + recorder.record(episode.events()))
