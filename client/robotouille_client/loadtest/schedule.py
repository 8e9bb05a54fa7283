"""Precise timers, the schedule of real-time steps, and moves that undo each other."""

from __future__ import annotations

import asyncio
import select
import selectors
from functools import cache
from math import ceil, inf

from robotouille import World
from robotouille.errors import RobotouilleError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

LIMIT = 1024
"""`select` accepts only descriptors below this number."""


def precise_loop() -> asyncio.AbstractEventLoop:
    """Return a new event loop with timers of microseconds, if the system allows it."""
    if not hasattr(selectors, "EpollSelector"):
        return asyncio.new_event_loop()
    selector = _PreciseSelector()
    if selector.fileno() >= LIMIT:
        selector.close()
        return asyncio.new_event_loop()
    return asyncio.SelectorEventLoop(selector)


if hasattr(selectors, "EpollSelector"):

    class _PreciseSelector(selectors.EpollSelector):
        """Selector that waits with `select`, because `epoll` rounds up to milliseconds."""

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            if timeout is None or timeout <= 0:
                return super().select(timeout)
            select.select((self.fileno(),), (), (), timeout)
            return super().select(0)


SETTLED = 5
"""Number of deltas after which the estimate is used."""
WATCHED = 50
"""Number of deltas with at least one that is less than half a period late."""


class StepSchedule:
    """The due times of an episode's steps, estimated on the client's clock.

    A delta does not contain the time at which its step was due, but steps are due at a fixed rate.
    The earliest arrival for its step is therefore taken as punctual: `transit` seconds after the
    step was due. All ages are relative to this best delivery.

    A server that is too far behind may give up its schedule and continue from a later time. The
    estimate notices this when `WATCHED` deltas in a row are late by half a period. These count as
    late, the estimate starts over, and `given_up` increases by one.
    """

    __slots__ = ("_least", "_origin", "_period", "_seen", "_transit", "_watched", "given_up")

    def __init__(self, rate: float, transit: float = 0.0) -> None:
        self._period = 1 / rate
        self._transit = transit
        self.given_up = 0
        self.restart()

    def restart(self) -> None:
        """Forget the estimate, after the episode was paused."""
        self._origin = inf
        self._seen = 0
        self._reset_watch()

    def _reset_watch(self) -> None:
        self._watched = 0
        self._least = inf

    @property
    def settled(self) -> bool:
        """True if enough deltas have arrived for the estimate to be used."""
        return self._seen >= SETTLED

    def arrived(self, step: int, at: float) -> float:
        """Record the arrival of a step's delta and return its age in seconds."""
        origin = at - self._transit - step * self._period
        self._origin = min(self._origin, origin)
        self._seen += 1
        late = origin - self._origin
        self._watch(origin, late)
        return late + self._transit

    def _watch(self, origin: float, late: float) -> None:
        self._watched += 1
        self._least = min(self._least, late)
        if self._watched >= WATCHED:
            if self._least > self._period / 2:
                self.given_up += 1
                self._origin = origin
            self._reset_watch()

    def due(self, step: int) -> float:
        """Return the time at which a step is due."""
        return self._origin + step * self._period

    def next_due(self, at: float) -> float:
        """Return the time of the first step that is due at or after `at`."""
        return self.due(ceil((at - self._origin) / self._period))


NamedMove = dict[str, str | list[str]]
"""An action as in the protocol."""


@cache
def back_and_forth(task: str, player: str) -> tuple[NamedMove, NamedMove]:
    """Return an action that is valid at the start of a task, and the action that undoes it.

    Raises:
        RobotouilleError: The task has no such pair.
    """
    start = World(task).initial
    for there in start.actions(player):
        back = _undoing(start, there, player)
        if back is not None:
            return _named(there), _named(back)
    message = f"{player} of {task} cannot move back and forth; choose another --task"
    raise RobotouilleError(message)


def _undoing(start: State, there: GroundAction, player: str) -> GroundAction | None:
    away = start.step(there)
    if away.goal_reached or away.state == start:
        return None
    for back in away.state.actions(player):
        home = away.state.step(back)
        if home.state == start and not home.goal_reached:
            return back
    return None


def _named(action: GroundAction) -> NamedMove:
    return {"name": action.name, "args": list(action.arguments)}
