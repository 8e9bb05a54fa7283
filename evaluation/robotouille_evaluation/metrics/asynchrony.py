"""What is done while something cooks: asynchronous work first, waiting, idling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robotouille_evaluation.metrics.action_kinds import (
    is_asynchronous,
    is_waiting,
    is_work,
    needs_asynchronous_work,
)
from robotouille_evaluation.metrics.outcomes import success_rate
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.metrics.trajectory import Trajectory

__all__ = [
    "TimeShares",
    "asynchronous_first",
    "success_by_asynchronous_first",
    "time_shares",
]


def asynchronous_first(trajectory: Trajectory) -> bool | None:
    """Whether the first work of the run was asynchronous (paper, finding 6).

    Work is an action with a special effect, or one that puts a thing to another; it is
    asynchronous if it then goes on by itself: cooking, frying, filling, boiling. Walking and
    carrying are none. In a step with several players, one of them is enough. None for tasks whose
    goal needs nothing of the kind; False if no work was done at all.
    """
    if not needs_asynchronous_work(trajectory.world):
        return None
    for joint in trajectory.moves:
        work = [move.action for move in joint if move.applied and is_work(move.action)]
        if work:
            return any(map(is_asynchronous, work))
    return False


def success_by_asynchronous_first(
    rows: Sequence[EpisodeRow],
) -> tuple[float | None, float | None]:
    """The success rates of runs that began with asynchronous work, and of those that did not.

    The paper has 16 % and 6 % (finding 6).
    """
    return (
        success_rate([row for row in rows if row.measures.asynchronous_first is True]),
        success_rate([row for row in rows if row.measures.asynchronous_first is False]),
    )


@dataclass(frozen=True, slots=True)
class TimeShares:
    """Shares of the players' steps, from 0 to 1: `waiting` for something that runs, `idle` while
    nothing runs, `busy` walking or working for longer than a step."""

    waiting: float
    idle: float
    busy: float


def time_shares(trajectory: Trajectory) -> TimeShares | None:
    """How much of the players' time went by without an action of theirs.

    One player's step counts as waiting or idle if no action of theirs was applied, or one that
    does nothing. It is waiting where something runs in that state, or has begun in that step
    before it; else idle. None if there were no steps. (Gantt charts of scheduling tell slack
    from blocked time in this way.)
    """
    waiting = idle = busy = 0
    players = trajectory.world.players
    for before, joint, after in trajectory.each_step():
        runs = any(p.timed and p.running for state in (before, after) for p in state.progress())
        acting = {move.player for move in joint if move.applied and not is_waiting(move.action)}
        for player in players:
            if player in acting:
                continue
            if before.busy_steps(player):
                busy += 1
            elif runs:
                waiting += 1
            else:
                idle += 1
    total = trajectory.steps * len(players)
    return TimeShares(waiting / total, idle / total, busy / total) if total else None
