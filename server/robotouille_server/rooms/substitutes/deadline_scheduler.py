"""Whose turn it is to think: of the stand-ins that have to decide, the one whose step comes first.

A stand-in waits here as itself, not as a question: it is asked for its question when its turn
comes, so that nobody thinks about a state that is over. While nobody waits, kitchens are learnt.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING, Protocol

from robotouille_server.rooms.substitutes.bot_minds import BotAnswer, Question
from robotouille_server.rooms.substitutes.bot_worker import BotWorker, BotWorkerLostError
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["BotClient", "BotScheduler"]

AT_ONCE = 8
"""Questions that are on their way: enough that the answers are not waited for between them."""


class BotClient(Protocol):
    """Somebody who waits to ask."""

    def question(self) -> tuple[Task, Question] | None:
        """The question, now that it is its turn; None if nothing has to be decided any more."""

    def answered(self, answer: BotAnswer) -> None:
        """What the answer is: nothing, where there is none."""


class BotScheduler:
    """The stand-ins of a server that wait for their turn with a thinker."""

    def __init__(self, make: Callable[[], BotWorker]) -> None:
        self._make = make
        self._thinker: BotWorker | None = None
        self._waiting: list[tuple[float, int, BotClient]] = []
        self._order = count()
        self._minds = count(1)
        self._lessons: dict[tuple[str, str], Task] = {}
        self._under_way = 0
        self._closed = False

    def new_mind(self) -> int:
        """The number of a stand-in that has not thought before."""
        return next(self._minds)

    def learn(self, task: Task, player: str) -> None:
        """Get ready to play a seat of a task, when there is time."""
        self._lessons.setdefault((task.digest, player), task)
        self._go_on()

    def want(self, asker: BotClient, deadline: float) -> None:
        """Wait for one's turn; the answer is of use until `deadline`, and perhaps after."""
        heappush(self._waiting, (deadline, next(self._order), asker))
        self._go_on()

    async def close(self) -> None:
        """Think no more."""
        self._closed = True
        self._waiting.clear()
        self._lessons.clear()
        if self._thinker is not None:
            await self._thinker.close()

    def _go_on(self) -> None:
        while self._waiting and self._under_way < AT_ONCE and not self._closed:
            _, _, asker = heappop(self._waiting)
            asked = asker.question()
            if asked is not None:
                self._await(self._there().ask(*asked), partial(_tell, asker))
        if self._lessons and not self._under_way and not self._closed:
            _, player = key = next(iter(self._lessons))
            self._await(self._there().learn(self._lessons.pop(key), player), _learnt)

    def _there(self) -> BotWorker:
        if self._thinker is None:
            self._thinker = self._make()
        return self._thinker

    def _await(
        self, thought: asyncio.Future[BotAnswer], then: Callable[[asyncio.Future[BotAnswer]], None]
    ) -> None:
        self._under_way += 1
        thought.add_done_callback(partial(self._over, then))

    def _over(
        self, then: Callable[[asyncio.Future[BotAnswer]], None], thought: asyncio.Future[BotAnswer]
    ) -> None:
        self._under_way -= 1
        if self._closed:
            _ = thought.cancelled() or thought.exception()  # Nobody wants to know any more.
            return
        try:
            then(thought)
        finally:
            self._go_on()


def _tell(asker: BotClient, thought: asyncio.Future[BotAnswer]) -> None:
    asker.answered(_result(thought))


def _learnt(thought: asyncio.Future[BotAnswer]) -> None:
    _result(thought)


def _result(thought: asyncio.Future[BotAnswer]) -> BotAnswer:
    failure = None if thought.cancelled() else thought.exception()
    if failure is not None and not isinstance(failure, BotWorkerLostError):
        get_logger().error("a stand-in failed", exc_info=failure)
    return None if failure is not None or thought.cancelled() else thought.result()
