"""Whose turn it is: the stand-in whose step comes first, with the state that is there by then."""

from __future__ import annotations

import asyncio
from typing import Any

from robotouille.domain.catalogue import load_task
from robotouille.domain.task import Task
from robotouille_server.rooms.substitutes.bot_minds import BotAnswer, Question
from robotouille_server.rooms.substitutes.bot_worker import BotWorkerLostError
from robotouille_server.rooms.substitutes.deadline_scheduler import AT_ONCE, BotScheduler

TASK = load_task("training/03_multi_agent@2")


class Slow:
    """Thinks until it is told the answer."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, asyncio.Future[BotAnswer]]] = []
        self.closed = False

    def _think(self, what: str) -> asyncio.Future[BotAnswer]:
        thought: asyncio.Future[BotAnswer] = asyncio.get_running_loop().create_future()
        self.asked.append((what, thought))
        return thought

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        return self._think(f"learn {player}")

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        return self._think(question.player)

    async def answer(self) -> None:
        """Answer the oldest question."""
        what, thought = self.asked.pop(0)
        thought.set_result((what,))
        await asyncio.sleep(0)

    @property
    def busy_with(self) -> list[str]:
        return [what for what, _ in self.asked]

    async def close(self) -> None:
        self.closed = True


class Seat:
    """A stand-in that always has to decide, unless it is `over`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.over = False
        self.answers: list[BotAnswer] = []

    def question(self) -> tuple[Task, Question] | None:
        if self.over:
            return None
        return TASK, Question(1, self.name, "random", 0, (), ())

    def answered(self, answer: BotAnswer) -> None:
        self.answers.append(answer)


def checked(course: Any) -> None:
    async def main() -> None:
        thinker = Slow()
        thoughts = BotScheduler(lambda: thinker)
        await course(thinker, thoughts)
        await thoughts.close()

    asyncio.run(main())


def test_the_oldest_deadline_comes_first_and_few_are_asked_at_once() -> None:
    async def course(thinker: Slow, thoughts: BotScheduler) -> None:
        first = [Seat(f"first{number}") for number in range(AT_ONCE)]
        for seat in first:
            thoughts.want(seat, 0.0)
        late, soon = Seat("late"), Seat("soon")
        thoughts.want(late, 9.0)
        thoughts.want(soon, 2.0)
        assert thinker.busy_with == [seat.name for seat in first]
        await thinker.answer()
        assert thinker.busy_with[-1] == "soon"
        await thinker.answer()
        assert thinker.busy_with[-1] == "late"
        assert first[0].answers == [("first0",)]

    checked(course)


def test_nobody_thinks_about_what_is_over() -> None:
    async def course(thinker: Slow, thoughts: BotScheduler) -> None:
        for number in range(AT_ONCE):
            thoughts.want(Seat(str(number)), 0.0)
        back, absent = Seat("back"), Seat("absent")
        thoughts.want(back, 1.0)
        thoughts.want(absent, 2.0)
        back.over = True
        await thinker.answer()
        assert thinker.busy_with[-1] == "absent"

    checked(course)


def test_kitchens_are_learnt_once_and_while_nobody_waits() -> None:
    async def course(thinker: Slow, thoughts: BotScheduler) -> None:
        seat = Seat("seat")
        thoughts.want(seat, 0.0)
        for _ in range(3):
            thoughts.learn(TASK, "robot1")
            thoughts.learn(TASK, "robot2")
        assert thinker.busy_with == ["seat"]
        await thinker.answer()
        assert thinker.busy_with == ["learn robot1"], "one at a time"
        thoughts.want(seat, 1.0)
        await thinker.answer()
        assert thinker.busy_with == ["seat"], "a stand-in waits for a lesson"
        await thinker.answer()
        await thinker.answer()
        assert thinker.busy_with == []

    checked(course)


def test_a_thought_that_is_lost_is_answered_by_nothing() -> None:
    async def course(thinker: Slow, thoughts: BotScheduler) -> None:
        seat = Seat("seat")
        thoughts.want(seat, 0.0)
        thinker.asked.pop()[1].set_exception(BotWorkerLostError())
        await asyncio.sleep(0)
        assert seat.answers == [None]

    checked(course)
