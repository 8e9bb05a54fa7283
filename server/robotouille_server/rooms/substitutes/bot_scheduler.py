"""Which substitute bot decides next: the one whose step comes first.

A bot waits here as itself, not as a question: it is asked for its question when its turn comes, so
that none is about a state that is over. While none waits, worlds are learnt.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from itertools import count
from typing import TYPE_CHECKING, Protocol

from robotouille_server.rooms.substitutes.bot_worker import BotWorker, BotWorkerLostError
from robotouille_server.rooms.substitutes.bots import BotAnswer, Question
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["BotClient", "BotScheduler"]

MAX_IN_FLIGHT = 8
"""Questions that are on their way: enough that the answers are not waited for between them."""


class BotClient(Protocol):
    """Somebody who waits to ask."""

    def question(self) -> tuple[Task, Question] | None:
        """The question, now that it is its turn; None if nothing has to be decided any more."""

    def answered(self, answer: BotAnswer) -> None:
        """What the answer is: nothing, where there is none."""


class BotScheduler:
    """The substitute bots of a server that wait for their turn with a worker."""

    def __init__(self, make_worker: Callable[[], BotWorker]) -> None:
        self._make_worker = make_worker
        self._worker: BotWorker | None = None
        self._waiting: list[tuple[float, int, BotClient]] = []
        self._order = count()
        self._numbers = count(1)
        self._to_learn: dict[tuple[str, str], Task] = {}
        self._in_flight = 0
        self._closed = False

    def new_bot(self) -> int:
        """The number of a bot that is new."""
        return next(self._numbers)

    def learn(self, task: Task, player: str) -> None:
        """Get ready to play a seat of a task, when there is time."""
        self._to_learn.setdefault((task.digest, player), task)
        self._dispatch()

    def schedule(self, client: BotClient, deadline: float) -> None:
        """Wait for one's turn; the answer is of use until `deadline`, and perhaps after."""
        heappush(self._waiting, (deadline, next(self._order), client))
        self._dispatch()

    async def close(self) -> None:
        """Ask no more."""
        self._closed = True
        self._waiting.clear()
        self._to_learn.clear()
        if self._worker is not None:
            await self._worker.close()

    def _dispatch(self) -> None:
        while self._waiting and self._in_flight < MAX_IN_FLIGHT and not self._closed:
            _, _, client = heappop(self._waiting)
            asked = client.question()
            if asked is not None:
                self._watch(self._get_worker().ask(*asked), partial(_deliver, client))
        if self._to_learn and not self._in_flight and not self._closed:
            _, player = key = next(iter(self._to_learn))
            self._watch(self._get_worker().learn(self._to_learn.pop(key), player), _learnt)

    def _get_worker(self) -> BotWorker:
        if self._worker is None:
            self._worker = self._make_worker()
        return self._worker

    def _watch(
        self,
        future: asyncio.Future[BotAnswer],
        deliver: Callable[[asyncio.Future[BotAnswer]], None],
    ) -> None:
        self._in_flight += 1
        future.add_done_callback(partial(self._done, deliver))

    def _done(
        self,
        deliver: Callable[[asyncio.Future[BotAnswer]], None],
        future: asyncio.Future[BotAnswer],
    ) -> None:
        self._in_flight -= 1
        if self._closed:
            _ = future.cancelled() or future.exception()  # Nobody wants to know any more.
            return
        try:
            deliver(future)
        finally:
            self._dispatch()


def _deliver(client: BotClient, future: asyncio.Future[BotAnswer]) -> None:
    client.answered(_result(future))


def _learnt(future: asyncio.Future[BotAnswer]) -> None:
    _result(future)


def _result(future: asyncio.Future[BotAnswer]) -> BotAnswer:
    failure = None if future.cancelled() else future.exception()
    if failure is not None and not isinstance(failure, BotWorkerLostError):
        get_logger().error("a stand-in failed", exc_info=failure)
    return None if failure is not None or future.cancelled() else future.result()
