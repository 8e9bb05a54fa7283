"""Text views of the players of a real-time room, at most ten a second for each seat.

Writing a text takes longer than a step, and a player may read those of all seats at sixty steps a
second. In real time, nobody waits for the text of each step, so players receive the newest one when
the event loop has time for it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.audience import DELIVERY_SECONDS
from robotouille_server.runtime.budgets import TEXT_COST
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.timer_queue import TimerQueue
from robotouille_server.transport import LoopBudget


class TextViews:
    """Sends players the newest text view of each of their seats.

    Args:
        timers: The timers of all rooms.
        budget: The event loop's budget of work per turn.
        send: Sends a session the text views of the last step.
    """

    __slots__ = ("_budget", "_delivering", "_due", "_next_at", "_send", "_timers")

    def __init__(
        self, timers: TimerQueue, budget: LoopBudget, send: Callable[[Session], None]
    ) -> None:
        self._timers = timers
        self._budget = budget
        self._send = send
        # The sessions in the order in which they became due.
        self._due: dict[Session, None] = {}
        self._next_at = 0.0
        # True from the time at which a delivery is scheduled until all due sessions have it.
        self._delivering = False

    def add(self, session: Session) -> None:
        """Send a session its views of the last step, or of a later one that is taken first."""
        self._due[session] = None
        self._schedule()

    def discard(self, session: Session) -> None:
        """Send nothing to a session that has left, or has received a newer view."""
        self._due.pop(session, None)

    def deliver_now(self) -> None:
        """Send what is pending, because the episode ends or the server stops."""
        for session in list(self._due):
            self._send_due(session)

    def _schedule(self) -> None:
        if self._delivering:
            return
        self._delivering = True
        if self._next_at <= self._timers.time():
            self._begin(0.0)
        else:
            self._timers.call_at(self._next_at, self._begin)

    def _begin(self, due: float) -> None:
        self._next_at = max(due, self._timers.time()) + DELIVERY_SECONDS
        self._budget.wait(partial(self._deliver, None), self)

    def _deliver(self, targets: list[Session] | None) -> None:
        """Send views until all targets have theirs or the budget of this turn is used up."""
        # The order is reversed, because targets are taken from the end.
        targets = list(reversed(self._due)) if targets is None else targets
        while targets and not self._budget.over:
            session = targets.pop()
            if session in self._due:
                self._budget.spend(TEXT_COST * len(session.views))
                # All seats of a session are shown in the same state: teams decide for all at once.
                self._send_due(session)
        if targets:
            self._budget.wait(partial(self._deliver, targets), self)
            return
        self._delivering = False
        if self._due:
            self._schedule()

    def _send_due(self, session: Session) -> None:
        """Send a session its views; log an error, which must not stop those of the others."""
        self.discard(session)
        try:
            self._send(session)
        except Exception:
            get_logger().exception("a text view failed", session=session.id)
