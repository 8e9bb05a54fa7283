"""Budget of event loop time that all connections share."""

from __future__ import annotations

import asyncio
from collections import OrderedDict, deque
from collections.abc import Callable
from functools import partial
from math import inf

LOOP_BUDGET = 96.0
"""Frames that all connections together process in one turn of the event loop. An expensive frame
counts as several. A higher budget would delay the steps of episodes."""
TURN_SECONDS = 0.02
"""Time after which a turn ends although its budget is not used up. Some messages take far longer
than their share: a misspelt sentence is compared with all valid ones for milliseconds."""
PAUSE_SECONDS = 0.0002
"""Time between two reads after which a new turn has begun. Within a turn, the event loop calls one
connection after the other."""


class LoopBudget:
    """Budget of work per turn of the event loop, with a fair queue for connections beyond it.

    Groups of connections take turns, and the connections of a group take turns within it. So a
    client waits for one message of each other address, not for all connections of a flood. Between
    two turns, the event loop takes the steps of episodes.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: OrderedDict[object, deque[Callable[[], None]]] = OrderedDict()
        self._count = 0
        self._spent = 0.0
        self._scheduled = False
        self._until = inf
        self._worked = -inf

    @property
    def over(self) -> bool:
        """True if the budget or the time of the current turn is used up."""
        return self._spent >= LOOP_BUDGET or self._loop.time() >= self._until

    def start(self) -> bool:
        """Return whether data that has just arrived may be processed now; then call `done`."""
        now = self._loop.time()
        # The event loop does not tell when a turn begins. A callback for each turn would cost as
        # much as reading a message, so it is used only when half of the budget is spent.
        if not self._scheduled and now - self._worked > PAUSE_SECONDS:
            self._begin(now)
        return not self._waiting and self._spent < LOOP_BUDGET and now < self._until

    def done(self) -> None:
        """Note that the data has been processed."""
        self._worked = self._loop.time()

    def spend(self, cost: float) -> None:
        """Charge work to the current turn."""
        self._spent += cost
        if self._spent >= LOOP_BUDGET / 2:
            self._schedule()

    def wait(self, resume: Callable[[], None], group: object = None) -> None:
        """Call `resume` after all in the queue have had their turn.

        Args:
            group: Connections of one group share its turns. Without one, `resume` has its own.
        """
        # Within a group, the queue is first come, first served, so that a flooding connection
        # cannot overtake others.
        self._waiting.setdefault(resume if group is None else group, deque()).append(resume)
        self._count += 1
        self._schedule()

    def _next(self) -> Callable[[], None]:
        group, queue = self._waiting.popitem(last=False)
        resume = queue.popleft()
        self._count -= 1
        if queue:
            self._waiting[group] = queue
        return resume

    def _schedule(self) -> None:
        if not self._scheduled:
            self._scheduled = True
            # The queue continues in the next turn, which also handles sockets and the timers of due
            # steps.
            self._loop.call_soon(self._turn)

    def _begin(self, now: float) -> None:
        self._spent, self._until = 0.0, now + TURN_SECONDS

    def _turn(self) -> None:
        self._scheduled = False
        self._begin(self._loop.time())
        try:
            # Connections that queue again must not keep the turn going.
            for _ in range(self._count):
                # Without this break, a due step could wait for more than one budget of work.
                if self.over:
                    break
                self._next()()
        finally:
            # The event loop logs the error of a connection; the others must still get their turns.
            if self._waiting:
                self._schedule()
            self.done()


class LoopTurns:
    """Turns of the event loop for work of tasks, one after another.

    Between two turns, episodes take their due steps, and connections of clients get a turn. Without
    these turns, the event loop would do the work of all ready tasks before it takes a step.
    """

    def __init__(self, budget: LoopBudget) -> None:
        self._budget = budget
        self._first = asyncio.Lock()

    async def next(self) -> None:
        """Wait for a turn. The caller may then work until its next `await`."""
        # Only the first waits in the queue of the clients' connections, so that a client waits for
        # one turn of the tasks, not for all of them.
        async with self._first:
            turn = asyncio.get_running_loop().create_future()
            self._budget.wait(partial(self._begin, turn))
            await turn

    def _begin(self, turn: asyncio.Future[None]) -> None:
        if not turn.done():  # The client may have gone.
            self._budget.spend(LOOP_BUDGET)
            turn.set_result(None)
