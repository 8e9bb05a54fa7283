"""Failures that the paper logs and labels, as they would look in the shipped tasks.

The appendices "Failure Mode Taxonomy Details" and "Qualitative Bad Start Failures" print a few
lines of six logs, with their category. Whole logs are not published. So each case here is a short
episode of our own in which the agent makes the described mistake. Only the categories are the
authors'.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from robotouille import World
from robotouille.errors import UnknownNameError
from robotouille_evaluation.metrics.failures import classify
from robotouille_evaluation.metrics.rows import Category
from robotouille_evaluation.metrics.trajectory import StepAnswer, Trajectory, rejected_answer


@dataclass(frozen=True, slots=True)
class LoggedFailure:
    """Failure of one of the paper's logs: the authors' category and that of the classifier."""

    log: str
    labelled: Category
    classified: Category


def logged_failures() -> list[LoggedFailure]:
    """Return the paper's logged failures with their categories."""
    text = (files(__package__) / "paper_failures.json").read_text(encoding="utf-8")
    return [*map(_classified, json.loads(text))]


def _classified(row: dict[str, Any]) -> LoggedFailure:
    course = _course(World(row["task"]), row["actions"], row["reasoning"])
    failure = classify(course, course.steps)
    if failure is None:
        raise ValueError(f"{row['log']} reaches its goal")
    return LoggedFailure(row["log"], Category(row["category"]), failure.category)


def _course(world: World, sentences: list[str], reasoning: str) -> Trajectory:
    """Return the trajectory of a player; sentences that are not valid actions are rejected."""
    (player,) = world.players
    answers = [*_answers(world, player, sentences, reasoning)]
    applied = [{player: answer.text} for answer in answers if not answer.wrong]
    return Trajectory.played(world, applied, answers)


def _answers(
    world: World, player: str, sentences: list[str], reasoning: str
) -> Iterator[StepAnswer]:
    state, step = world.initial, 0
    for text in sentences:
        try:
            action = world.parse(state, player, text)
        except UnknownNameError:
            wrong = rejected_answer(step, player, text, state)
            yield StepAnswer(
                step, player, text, wrong.verdict, reasoning, wrong.reasons, wrong.unmet
            )
        else:
            yield StepAnswer(step, player, text, reasoning=reasoning, action=action)
            state, step = state.step(action).state, step + 1
