"""Who thinks for the stand-ins: the server asks, and is answered later."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Protocol

from robotouille_server.rooms.substitutes.bot_minds import BotAnswer, Bots, Question

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["BotWorker", "BotWorkerLostError", "ThreadBotWorker"]


class BotWorkerLostError(Exception):
    """There will be no answer to a question: whoever thought about it is gone."""


class BotWorker(Protocol):
    """Answers questions, one after the other."""

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        """Get ready to play a seat of a task."""

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        """What a stand-in does in a state; BotWorkerLostError where that will not be known."""

    async def close(self) -> None:
        """Think no more; what is not answered yet is lost."""


class ThreadBotWorker:
    """Thinks in the server's own process, in a thread: where no other process can be had. It
    takes time from all games; in tests `executor` may let time stand still meanwhile, and `minds`
    know kitchens already."""

    def __init__(self, executor: Executor | None = None, minds: Bots | None = None) -> None:
        self.minds = minds or Bots()
        self._executor = executor
        self._loop = asyncio.get_running_loop()

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        return self._run(self._learn, task, player)

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        return self._run(self._think, task, question)

    def _run(
        self, work: Callable[[Task, Any], BotAnswer], task: Task, about: object
    ) -> asyncio.Future[BotAnswer]:
        self._executor = self._executor or ThreadPoolExecutor(1, "stand-ins")
        return self._loop.run_in_executor(self._executor, work, task, about)

    def _learn(self, task: Task, player: str) -> BotAnswer:
        self.minds.show(task)
        self.minds.learn(task.digest, player)
        return None

    def _think(self, task: Task, question: Question) -> BotAnswer:
        self.minds.show(task)
        return self.minds.think(task.digest, question)

    def retire(self) -> None:
        """Answer what was asked, and end; nothing is asked any more."""
        if self._executor is not None:
            self._executor.shutdown(wait=False)

    async def close(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=False, cancel_futures=True)
