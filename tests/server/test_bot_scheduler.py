"""Scheduler of substitutes: earliest deadline first, with the present state."""

from __future__ import annotations

import asyncio
from typing import Any

from robotouille.domain.loading import load_task
from robotouille.domain.task import Task
from robotouille_server.rooms.substitutes.bot_worker import BotWorkerLostError
from robotouille_server.rooms.substitutes.bots import BotAnswer, Question
from robotouille_server.rooms.substitutes.substitute import MAX_IN_FLIGHT, BotScheduler

TASK = load_task("training/03_multi_agent@2")


class Slow:
    """Worker that answers on request."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, asyncio.Future[BotAnswer]]] = []
        self.closed = False

    def _ask(self, what: str) -> asyncio.Future[BotAnswer]:
        future: asyncio.Future[BotAnswer] = asyncio.get_running_loop().create_future()
        self.asked.append((what, future))
        return future

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        return self._ask(f"learn {player}")

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        return self._ask(question.player)

    async def answer(self) -> None:
        """Answer the oldest question."""
        what, future = self.asked.pop(0)
        future.set_result((what,))
        await asyncio.sleep(0)

    @property
    def busy_with(self) -> list[str]:
        return [what for what, _ in self.asked]

    async def close(self) -> None:
        self.closed = True


class Seat:
    """Substitute that always has to decide, unless the episode is `over`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.over = False
        self.answers: list[BotAnswer] = []

    def question(self) -> tuple[Task, Question] | None:
        if self.over:
            return None
        return TASK, Question(1, self.name, "random", (b"", (), (), None))

    def answered(self, answer: BotAnswer) -> None:
        self.answers.append(answer)


def checked(course: Any) -> None:
    async def main() -> None:
        worker = Slow()
        scheduler = BotScheduler(lambda: worker)
        await course(worker, scheduler)
        await scheduler.close()

    asyncio.run(main())


def test_earliest_deadline_is_asked_first() -> None:
    async def course(worker: Slow, scheduler: BotScheduler) -> None:
        first = [Seat(f"first{number}") for number in range(MAX_IN_FLIGHT)]
        for seat in first:
            scheduler.schedule(seat, 0.0)
        late, soon = Seat("late"), Seat("soon")
        scheduler.schedule(late, 9.0)
        scheduler.schedule(soon, 2.0)
        assert worker.busy_with == [seat.name for seat in first]
        await worker.answer()
        assert worker.busy_with[-1] == "soon"
        await worker.answer()
        assert worker.busy_with[-1] == "late"
        assert first[0].answers == [("first0",)]

    checked(course)


def test_worlds_are_learnt_once_and_only_when_idle() -> None:
    async def course(worker: Slow, scheduler: BotScheduler) -> None:
        seat = Seat("seat")
        scheduler.schedule(seat, 0.0)
        for _ in range(3):
            scheduler.learn(TASK, "robot1")
            scheduler.learn(TASK, "robot2")
        assert worker.busy_with == ["seat"]
        await worker.answer()
        assert worker.busy_with == ["learn robot1"], "one at a time"
        scheduler.schedule(seat, 1.0)
        await worker.answer()
        assert worker.busy_with == ["seat"], "a substitute waits for a lesson"
        await worker.answer()
        await worker.answer()
        assert worker.busy_with == []

    checked(course)


def test_lost_question_is_answered_by_none() -> None:
    async def course(worker: Slow, scheduler: BotScheduler) -> None:
        seat = Seat("seat")
        scheduler.schedule(seat, 0.0)
        worker.asked.pop()[1].set_exception(BotWorkerLostError())
        await asyncio.sleep(0)
        assert seat.answers == [None]

    checked(course)
