"""Substitute bots in a thread: where no other process can be had."""

from __future__ import annotations

import asyncio

import pytest

from robotouille.domain.loading import load_task
from robotouille.world.world import shared_world
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from robotouille_server.rooms.substitutes.bots import Bots
from tests.support.executors import ImmediateExecutor
from tests.support.questions import question

TASK = load_task("training/03_multi_agent@2")
START = shared_world(TASK).initial


def test_it_answers_what_the_bots_do() -> None:
    async def main() -> None:
        here = Bots()
        here.show(TASK)
        worker = ThreadBotWorker(ImmediateExecutor())
        assert await worker.learn(TASK, "robot1") is None
        asked = question(START, kind="random")
        assert await worker.ask(TASK, asked) == here.answer(TASK.digest, asked)

    asyncio.run(main())


def test_a_bot_that_fails_is_told_to_who_asked() -> None:
    async def main() -> None:
        worker = ThreadBotWorker(ImmediateExecutor())
        await worker.ask(TASK, question(START))
        with pytest.raises(KeyError, match="no action 'dance'"):
            await worker.ask(TASK, question(START, observed=((("robot1", "dance", (), True),),)))

    asyncio.run(main())


def test_a_thread_ends_when_it_is_closed_and_answers_first_when_it_retires() -> None:
    async def main() -> None:
        worker = ThreadBotWorker()
        answer = worker.ask(TASK, question(START, kind="random"))
        worker.retire()
        assert await answer is not None
        with pytest.raises(RuntimeError):
            worker.ask(TASK, question(START, kind="random"))
        await worker.close()

    asyncio.run(main())
