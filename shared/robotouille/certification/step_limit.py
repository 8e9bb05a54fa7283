"""Step limits for people, derived from certified plan lengths."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import ceil
from pathlib import Path

from robotouille.certification.certificate import load_certificate
from robotouille.domain.task import Task, Timing
from robotouille.errors import FileError, UnknownTaskError
from robotouille.files.reading import is_file, read_text
from robotouille.planning.plan import Plan, read_plan, replay
from robotouille.planning.policies.policy import Script
from robotouille.world.world import World


def plan_beside(world: World) -> Plan | None:
    """Return the valid plan in the file next to a world's problem file, or None."""
    source = Path(world.task.source)
    for name in (f"{source.stem}@{world.task.seats}.plan", f"{source.stem}.plan"):
        path = source.parent / name
        if not is_file(path):
            continue
        try:
            steps = _without_comments(read_text(path))
            plan = read_plan(steps, world, str(path))
        except (OSError, UnicodeDecodeError, FileError):
            continue
        if replay(plan, world).ok:
            return plan
    return None


def _without_comments(text: str) -> str:
    """Return a plan's steps without its header."""
    # The header may name the task differently from its file.
    return "\n".join(line for line in text.splitlines() if not line.startswith("#"))


PATIENCE = 6
"""Ratio of a beginner's step limit to the certified plan length."""
MIN_SECONDS = 180.0
"""Minimum duration of a game in real time."""
MAX_STRETCH = 100
"""Ratio of steps in another timing to the plan length from which a plan counts as stuck."""


MAX_KEPT = 256
_lengths: dict[str, int | None] = {}
"""Results by digest of the task: a server opens the same tasks again and again."""


def people_step_limit(task: Task, step_rate: float | None) -> int | None:
    """Return the step limit for people in a task's timing, or None without a certificate.

    The limit of a shift is its length.

    Args:
        step_rate: Steps per second; None if steps do not follow the clock.
    """
    if task.problem.shift is not None:
        return task.problem.shift.steps * task.profile.delay_factor
    length = retimed_length(task)
    if length is None:
        return None
    least = 0 if step_rate is None else ceil(MIN_SECONDS * step_rate)
    return max(PATIENCE * length, least)


def needs_simulation(task: Task) -> bool:
    """Return whether `retimed_length` simulates a plan, which can take 0.2 s."""
    simulated = task.timing is not Timing.BENCHMARK and task.problem.shift is None
    return simulated and task.digest not in _lengths


def retimed_length(task: Task) -> int | None:
    """Return the steps of a task's certified plan in the task's own timing, or None.

    The result is None if there is no certified plan, or if it does not reach the goal in this
    timing.
    """
    # Certificates use the timing `benchmark`. In the timing `people`, walks and delays take longer.
    # Another thread may clear the results at any time.
    with suppress(KeyError):
        return _lengths[task.digest]
    length = _find_length(task)
    if len(_lengths) >= MAX_KEPT:
        _lengths.clear()
    _lengths[task.digest] = length
    return length


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
    """Return the steps of a plan in another timing with all seats, or None above a limit."""
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
