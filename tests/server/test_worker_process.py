"""Process of the substitutes, as the server sees it."""

from __future__ import annotations

import asyncio
import errno
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import psutil
import pytest

from robotouille.domain.loading import load_task
from robotouille.domain.task import Timing
from robotouille.world.world import shared_world
from robotouille_server.rooms.substitutes import bot_worker as worker_process
from robotouille_server.rooms.substitutes.bot_worker import (
    BotWorkerLostError,
    ProcessBotWorker,
    ThreadBotWorker,
)
from robotouille_server.rooms.substitutes.bots import Question
from tests.support.executors import ImmediateExecutor
from tests.support.processes import process
from tests.support.questions import question

pytestmark = pytest.mark.process

TASK = load_task("training/03_multi_agent@2")
START = shared_world(TASK).initial
PATIENCE = 30
NONSENSE = ((("robot1", "dance", (), True),),)


@asynccontextmanager
async def bot_worker(*command: str) -> AsyncIterator[ProcessBotWorker]:
    made = ProcessBotWorker(command) if command else ProcessBotWorker()
    try:
        async with asyncio.timeout(PATIENCE):
            yield made
    finally:
        await made.close()


def random_move(bot: int) -> Question:
    """Return a question that is answered quickly."""
    return question(START, bot, kind="random")


async def gone(pid: int) -> None:
    async with asyncio.timeout(PATIENCE):
        while psutil.pid_exists(pid):
            await asyncio.sleep(0.01)


@pytest.mark.slow
async def test_process_answers_like_a_thread() -> None:
    thread = ThreadBotWorker(ImmediateExecutor())
    step = START.step([START.actions("robot1")[0]])
    moves = ((("robot1", "move", START.actions("robot1")[0].arguments, True),),)
    async with bot_worker() as apart:
        assert await apart.learn(TASK, "robot1") is None
        for asked in (
            question(START, 1),
            question(step.state, 1, observed=moves),
            random_move(2),
        ):
            assert await apart.ask(TASK, asked) == await thread.ask(TASK, asked)
        with pytest.raises(RuntimeError, match="no action 'dance'"):
            await apart.ask(TASK, question(START, 1, observed=NONSENSE))
        assert await apart.ask(TASK, random_move(3)) is not None


async def test_forgotten_task_is_sent_again() -> None:
    tasks = [load_task("training/03_multi_agent@2", timing=timing) for timing in Timing]
    program = (
        "from robotouille_server.rooms.substitutes import bots; bots.MAX_WORLDS = 1;"
        "from robotouille_server.rooms.substitutes.bots import main; main()"
    )
    async with bot_worker(sys.executable, "-c", program) as apart:
        for task in (*tasks, *tasks):
            asked = question(shared_world(task).initial, kind="random")
            assert await apart.ask(task, asked) is not None


async def test_dead_process_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Questions are lost until the replacement has started."""
    monkeypatch.setattr(worker_process, "FIRST_BACK_OFF", 0.05)
    async with bot_worker() as apart:
        await apart.ask(TASK, random_move(1))
        assert apart.pid is not None
        os.kill(apart.pid, signal.SIGSTOP)
        under_way = apart.ask(TASK, random_move(1))
        first = apart.pid
        os.kill(first, signal.SIGKILL)
        with pytest.raises(BotWorkerLostError):
            await under_way
        with pytest.raises(BotWorkerLostError):
            await apart.ask(TASK, random_move(1))
        await asyncio.sleep(0.2)
        assert await apart.ask(TASK, random_move(1)) is not None
        assert apart.pid not in (None, first)


async def test_thread_answers_if_no_process_can_be_started(tmp_path: Path) -> None:
    async with bot_worker(str(tmp_path / "nothing")) as apart:
        with pytest.raises(BotWorkerLostError):
            await apart.ask(TASK, random_move(1))
        assert await apart.ask(TASK, random_move(1)) is not None
        assert apart.pid is None


async def test_thread_is_replaced_when_a_process_can_be_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refused: list[int] = []
    async with bot_worker() as apart:
        loop = asyncio.get_running_loop()

        async def refusing(*_: object, **__: object) -> None:
            refused.append(1)
            raise OSError(errno.EMFILE, "too many open files")

        monkeypatch.setattr(worker_process, "FIRST_BACK_OFF", 1000.0)
        monkeypatch.setattr(worker_process, "MAX_BACK_OFF", 1500.0)
        apart._back_off_seconds = worker_process.FIRST_BACK_OFF
        monkeypatch.setattr(loop, "subprocess_exec", refusing)
        with pytest.raises(BotWorkerLostError):
            await apart.ask(TASK, random_move(1))
        for _ in range(3):
            assert await apart.ask(TASK, random_move(1)) is not None
        assert len(refused) == 1, "it is not tried with every question"
        apart._retry_at = 0.0
        assert await apart.ask(TASK, random_move(1)) is not None
        assert len(refused) == 2
        assert apart._retry_at > loop.time() + 1400, "and ever more rarely"
        apart._retry_at = 0.0
        monkeypatch.undo()
        under_way = apart.ask(TASK, random_move(1))
        while apart.pid is None:
            await asyncio.sleep(0.01)
        assert await under_way is not None, "what the thread was asked it answers"
        assert await apart.learn(TASK, "robot1") is None
        assert await apart.ask(TASK, random_move(1)) is not None
        assert psutil.pid_exists(apart.pid)
        assert apart._thread is None


async def test_stuck_process_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_process, "REPLY_SECONDS", 0.05)
    async with bot_worker(sys.executable, "-c", "import time; time.sleep(1000)") as apart:
        with pytest.raises(BotWorkerLostError):
            await apart.ask(TASK, random_move(1))


async def test_process_ignores_signals_and_ends_with_the_server() -> None:
    async with bot_worker() as apart:
        await apart.ask(TASK, random_move(1))
        pid = apart.pid
        assert pid is not None
        assert os.getpgid(pid) != os.getpgid(0), "Ctrl+C would reach it"
        assert psutil.Process(pid).nice() > psutil.Process().nice()
        for number in (signal.SIGINT, signal.SIGTERM):
            os.kill(pid, number)
        assert await apart.ask(TASK, random_move(1)) is not None
        assert apart.pid == pid
    await gone(pid)


async def test_process_gets_no_secrets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTOUILLE_SIGNING_KEYS", "secret")
    async with bot_worker() as apart:
        await apart.ask(TASK, random_move(1))
        environment = psutil.Process(apart.pid).environ()
        assert "ROBOTOUILLE_SIGNING_KEYS" not in environment


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_no_process_is_left_when_the_server_ends(tmp_path: Path, number: int) -> None:
    from robotouille_client import connect

    async def until_it_thinks(url: str, code: str, server: psutil.Process) -> int:
        async with connect(url, name="ada") as ada, connect(url, name="bob") as bob:
            await ada.join(code)
            await bob.join(code)
            while not (children := server.children()):
                await asyncio.sleep(0.01)
            return children[0].pid

    with process(tmp_path, "--task", "multi_agent/02", "--absence", "bot") as (server, url, code):
        pid = asyncio.run(until_it_thinks(url, code, psutil.Process(server.pid)))
        server.send_signal(number)
        server.wait(PATIENCE)
        asyncio.run(gone(pid))
