"""Where substitute bots decide: the server asks, and is answered later."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Protocol

from robotouille_server.rooms.substitutes.bots import BotAnswer, Bots, Question

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["BotWorker", "BotWorkerLostError", "ThreadBotWorker"]


class BotWorkerLostError(Exception):
    """There will be no answer to a question: the process is gone."""


class BotWorker(Protocol):
    """Answers questions, one after the other."""

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        """Get ready to play a seat of a task."""

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        """What a bot does in a state; BotWorkerLostError where that will not be known."""

    async def close(self) -> None:
        """Answer no more; what is not answered yet is lost."""


class ThreadBotWorker:
    """Decides in the server's own process, in a thread: where no other process can be had. It
    takes time from all games; in tests `executor` may let time stand still meanwhile, and `bots`
    know worlds already."""

    def __init__(self, executor: Executor | None = None, bots: Bots | None = None) -> None:
        self.bots = bots or Bots()
        self._executor = executor
        self._loop = asyncio.get_running_loop()

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        return self._run(self._learn, task, player)

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        return self._run(self._ask, task, question)

    def _run(
        self, work: Callable[[Task, Any], BotAnswer], task: Task, about: object
    ) -> asyncio.Future[BotAnswer]:
        self._executor = self._executor or ThreadPoolExecutor(1, "stand-ins")
        return self._loop.run_in_executor(self._executor, work, task, about)

    def _learn(self, task: Task, player: str) -> BotAnswer:
        self.bots.show(task)
        self.bots.learn(task.digest, player)
        return None

    def _ask(self, task: Task, question: Question) -> BotAnswer:
        self.bots.show(task)
        return self.bots.answer(task.digest, question)

    def retire(self) -> None:
        """Answer what was asked, and end; nothing is asked any more."""
        if self._executor is not None:
            self._executor.shutdown(wait=False)

    async def close(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=False, cancel_futures=True)
