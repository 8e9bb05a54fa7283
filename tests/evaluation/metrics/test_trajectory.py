"""Trajectories from recordings and actions, and rejected answers."""

from __future__ import annotations

import pytest

from robotouille import ProtocolError, World, load_task
from robotouille.episode import ActionRequest, Clock, Episode, Rules
from robotouille.replay import recording_of
from robotouille.world.unmet import UnmetKind
from robotouille_evaluation.metrics import AnswerVerdict, Trajectory
from robotouille_evaluation.metrics.trajectory import rejected_answer
from tests.evaluation.metrics.courses import SANDWICH, WANDERING, wandering
from tests.support.games import record, recorded_game


def test_trajectory_of_sentences() -> None:
    course = wandering()
    assert course.steps == len(course.moves) == len(course.states) - 1 == 6
    assert [answer.text for answer in course.answers] == list(WANDERING)
    assert [answer.step for answer in course.answers] == [0, 1, 2, 3, 4, 5]
    assert course.goal_step is None


def test_step_without_a_move() -> None:
    course = Trajectory.played(SANDWICH, [{"robot1": None}, {}])
    assert course.moves == ((), ())
    assert course.states[0] == course.states[2]


@pytest.mark.parametrize("task", ["synchronous/02", "asynchronous/06", "multi_agent/01"])
def test_trajectory_of_a_recording(task: str) -> None:
    recording = recording_of(recorded_game(task, steps=60), "test")
    course = Trajectory.recorded(recording)
    assert list(course.states) == [state for _, state in recording.states()]
    joints = [{move.player: move.action for move in joint} for joint in course.moves]
    again = Trajectory.played(recording.world, joints)
    assert again.states == course.states
    assert again.moves == course.moves


def test_recording_keeps_reasoning_and_rejected_answers() -> None:
    world = World(load_task("synchronous/01"))
    episode = Episode(world, Rules(clock=Clock.TURN, max_steps=9))
    episode.join("robot1", "model", "bot", 0.0)
    events = episode.events()
    far = world.action("pick-up-item", "robot1", "cheese1", "table1")
    near = world.parse(world.initial, "robot1", WANDERING[0])
    episode.submit("robot1", ActionRequest(1, far, reasoning="I reach far."), 0.1)
    episode.submit("robot1", ActionRequest(2, near, reasoning="I go there."), 0.2)
    events += episode.events()
    first, second = Trajectory.recorded(recording_of(record(episode, events), "test")).answers
    assert (first.verdict, first.step, first.reasoning) == (
        AnswerVerdict.INVALID,
        0,
        "I reach far.",
    )
    assert first.action == far
    assert [(u.predicate, u.objects) for u in first.unmet] == [("loc", ("robot1", "table1"))]
    assert first.reasons == ("needs: robot1 stands at table1",)
    assert (second.verdict, second.reasoning) == (AnswerVerdict.APPLIED, "I go there.")


def test_unheard_requests_are_not_answers() -> None:
    episode = Episode(SANDWICH, Rules(clock=Clock.TURN, max_steps=9))
    episode.join("robot1", "model", "bot", 0.0)
    episode.refuse(
        "robot1", ActionRequest(1, "walk"), ProtocolError("rate/limited", "one too many"), 0.1
    )
    episode.refuse(
        "robot1", ActionRequest(0, "{"), ProtocolError("message/malformed", "is no JSON"), 0.2
    )
    recording = recording_of(record(episode, episode.events()), "test")
    assert [note["note"] for note in recording.notes()].count("rejected") == 2
    assert Trajectory.recorded(recording).answers == ()


def test_text_without_action_is_malformed() -> None:
    answer = rejected_answer(0, "robot1", "Make me a sandwich", SANDWICH.initial)
    assert (answer.verdict, answer.action, answer.unmet) == (AnswerVerdict.MALFORMED, None, ())
    answer = rejected_answer(0, "robot1", WANDERING[3], SANDWICH.initial)
    assert answer.verdict is AnswerVerdict.INVALID
    assert [unmet.kind for unmet in answer.unmet] == [UnmetKind.CONDITION]
