"""The step limit of a game that people play: from the shortest plan that is proven of its task."""

from __future__ import annotations

from dataclasses import replace
from math import ceil

from robotouille.certification.certificate import load_certificate
from robotouille.domain.task import Task, Timing
from robotouille.errors import FileError, UnknownTaskError
from robotouille.planning.plan import read_plan
from robotouille.planning.policies.script import Script
from robotouille.world.world import World

__all__ = ["MIN_SECONDS", "PATIENCE", "people_step_limit", "retimed_length"]

PATIENCE = 6
"""How many times as long as the certified plan a beginner may take."""
MIN_SECONDS = 180.0
"""… and for how long any game goes on at least, in real time."""
MAX_STRETCH = 100
"""How many times as many steps a plan may take in another timing: beyond, it is stuck."""


MAX_KEPT = 256
_lengths: dict[str, int | None] = {}
"""What was found out, by the digest of the task: a server opens the same ones again and again."""


def people_step_limit(task: Task, step_rate: float | None) -> int | None:
    """The steps that people get for a task in its timing; None where no certificate is known.

    Args:
        step_rate: Steps a second; None where steps do not follow the wall clock.
    """
    length = retimed_length(task)
    if length is None:
        return None
    least = 0 if step_rate is None else ceil(MIN_SECONDS * step_rate)
    return max(PATIENCE * length, least)


def retimed_length(task: Task) -> int | None:
    """How many steps a task's certified plan takes in the task's own timing; None where there is
    no certificate with a plan, or the plan does not reach the goal in this timing.

    Certificates are of the benchmark's timing; with that of people, walks and delays take longer.
    """
    if task.digest not in _lengths:
        if len(_lengths) >= MAX_KEPT:
            _lengths.clear()
        _lengths[task.digest] = _find_length(task)
    return _lengths[task.digest]


def _find_length(task: Task) -> int | None:
    try:
        certificate = load_certificate(replace(task, timing=Timing.BENCHMARK))
    except (FileError, UnknownTaskError, OSError):
        return None
    if certificate.plan is None or certificate.length is None:
        return None
    if task.timing is Timing.BENCHMARK:
        return certificate.length
    return _carried_out("\n".join(certificate.plan), task, certificate.length * MAX_STRETCH)


def _carried_out(plan: str, task: Task, limit: int) -> int | None:
    """The steps of a plan in another timing, all seats together; None if not within a limit."""
    written = World(replace(task, timing=Timing.BENCHMARK))
    script = Script(written.players[0], read_plan(plan, written), written.initial)
    state = World(task).initial
    for step in range(limit):
        if state.goal_reached:
            return step
        taken = state.step([action for action, _ in script.joint(state).values()])
        script.observe([(a.action.player or "", a.action, a.applied) for a in taken.attempts])
        state = taken.state
    return None
