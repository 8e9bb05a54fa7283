"""Stars for finished games, from one to three, by the number of steps, and by points for shifts.

Thresholds of shifts are in their files. All others are here. They follow from the length of the
task's known plan in its own timing (`retimed_length`), which a planner finds without thinking time,
and from the pace of the game. The steps of a game begin after its countdown, so nobody loses a star
by waiting for the start.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

from robotouille.certification.step_limit import retimed_length
from robotouille.domain.schema import ProblemFile
from robotouille.domain.task import Task

THREE, TWO = 2.0, 3.5
"""Largest ratio of a game to the known plan for three and for two stars."""
LOOK_SECONDS = 10.0
"""Time for looking around, which is added to both thresholds in real time."""


class StarLimits(NamedTuple):
    """Largest numbers of steps for three and for two stars. Every other finished game has one."""

    three: int
    two: int

    def stars(self, steps: int) -> int:
        """Return the stars of a game that reached its goal."""
        return 3 if steps <= self.three else 2 if steps <= self.two else 1


class ScoreLimits(NamedTuple):
    """Smallest numbers of points for one, two and three stars in a shift."""

    one: int
    two: int
    three: int

    def stars(self, points: int) -> int:
        """Return the stars of a finished shift, from none to three."""
        return sum(points >= limit for limit in self)


def score_limits(problem: ProblemFile, seats: int) -> ScoreLimits | None:
    """Return the limits of a shift for a number of seats; None if its file has no stars."""
    found = None if problem.shift is None else problem.shift.stars.get(seats)
    return None if found is None else ScoreLimits(*found)


def star_limits(task: Task, step_rate: float | None) -> StarLimits | None:
    """Return the limits of a task, or None without a certified plan.

    Args:
        step_rate: Steps per second; None if steps do not follow the clock.
    """
    length = retimed_length(task)
    return None if length is None else limits_of(length, step_rate)


def limits_of(length: int, step_rate: float | None) -> StarLimits:
    """Return the limits for a known plan of a length."""
    look = ceil(LOOK_SECONDS * (step_rate or 0.0))
    return StarLimits(ceil(THREE * length) + look, ceil(TWO * length) + look)
