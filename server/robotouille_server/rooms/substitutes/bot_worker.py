"""Workers in which substitutes plan: a thread, or a process that is restarted when it dies."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import msgpack

from robotouille.planning.bot_process import unpacker
from robotouille_server.rooms.substitutes.bots import (
    DONE,
    UNKNOWN,
    BotAnswer,
    Bots,
    Question,
    ask_request,
    learn_request,
    task_request,
)
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from robotouille.domain.task import Task

# `-P` keeps modules in the server's working directory from replacing installed ones.
COMMAND = (sys.executable, "-P", "-m", "robotouille_server.rooms.substitutes.bots")
FIRST_BACK_OFF, MAX_BACK_OFF = 0.1, 5.0
"""Seconds before a dead process is replaced: the first value and the maximum."""
HEALTHY_SECONDS = 10.0
"""Lifetime of a process after which its death no longer increases the back-off."""
REPLY_SECONDS = 60.0
"""Seconds without any reply after which the process counts as stuck and is killed."""
CLOSE_SECONDS = 1.0


class BotWorkerLostError(Exception):
    """The process has died, so a question will not be answered."""


class BotWorker(Protocol):
    """Answers questions one after the other."""

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        """Prepare to play a seat of a task."""

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        """Return a bot's action in a state.

        The future fails with BotWorkerLostError if the question is lost.
        """

    async def close(self) -> None:
        """Stop. Unanswered questions are lost."""


class ThreadBotWorker:
    """Worker in a thread of the server, for systems that cannot start processes.

    It takes time from all episodes. Tests pass an `executor` that stops virtual time while the
    bots plan, and `bots` with known worlds.
    """

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
        self._executor = self._executor or ThreadPoolExecutor(1, "substitutes")
        return self._loop.run_in_executor(self._executor, work, task, about)

    def _learn(self, task: Task, player: str) -> BotAnswer:
        self.bots.show(task)
        self.bots.learn(task.digest, player)
        return None

    def _ask(self, task: Task, question: Question) -> BotAnswer:
        self.bots.show(task)
        return self.bots.answer(task.digest, question)

    def retire(self) -> None:
        """Answer the open questions, then stop. The caller asks no more questions."""
        if self._executor is not None:
            self._executor.shutdown(wait=False)

    async def close(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=False, cancel_futures=True)


@dataclass(slots=True)
class _Request:
    task: Task
    make: Callable[[int], bytes]
    answer: asyncio.Future[BotAnswer]


class ProcessBotWorker:
    """Worker in a process of its own, with low priority.

    Questions asked while no process runs are lost at once. If the first process cannot be started,
    a thread answers until one can.
    """

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        self.pid: int | None = None
        self._command = tuple(command)
        self._loop = asyncio.get_running_loop()
        self._pipe: _Pipe | None = None
        self._starting: asyncio.Task[None] | None = None
        self._thread: ThreadBotWorker | None = None
        self._requests: dict[int, _Request] = {}
        self._number = 0
        self._tasks_sent: set[str] = set()
        self._started = self._retry_at = 0.0
        self._back_off_seconds = FIRST_BACK_OFF
        self._reply_timer: asyncio.TimerHandle | None = None
        self._closed = False

    def learn(self, task: Task, player: str) -> asyncio.Future[BotAnswer]:
        if (thread := self._fallback()) is not None:
            return thread.learn(task, player)
        return self._request(task, lambda number: learn_request(number, task.digest, player))

    def ask(self, task: Task, question: Question) -> asyncio.Future[BotAnswer]:
        if (thread := self._fallback()) is not None:
            return thread.ask(task, question)
        return self._request(task, lambda number: ask_request(number, task.digest, question))

    def _fallback(self) -> ThreadBotWorker | None:
        """Return the thread that answers until a process starts; try to start one if due."""
        due = self._loop.time() >= self._retry_at
        if self._thread is not None and self._starting is None and due and not self._closed:
            self._starting = asyncio.create_task(self._start())
        return self._thread

    def _request(self, task: Task, make: Callable[[int], bytes]) -> asyncio.Future[BotAnswer]:
        answer: asyncio.Future[BotAnswer] = self._loop.create_future()
        if self._closed or self._loop.time() < self._retry_at:
            # The question fails at once, because doing nothing in this step is better than acting
            # after the back-off.
            answer.set_exception(BotWorkerLostError())
            return answer
        self._number += 1
        self._requests[self._number] = _Request(task, make, answer)
        if self._pipe is not None:
            self._send(self._number)
        elif self._starting is None:
            self._starting = asyncio.create_task(self._start())
        return answer

    def _send(self, number: int) -> None:
        request, pipe = self._requests[number], self._pipe
        if pipe is None:
            return
        # A task is far longer than a question, so it is sent once per process.
        if request.task.digest not in self._tasks_sent:
            self._tasks_sent.add(request.task.digest)
            pipe.write(task_request(request.task))
        pipe.write(request.make(number))
        if self._reply_timer is None:
            self._reply_timer = self._loop.call_later(REPLY_SECONDS, self._kill)

    # The process

    async def _start(self) -> None:
        try:
            _, pipe = await self._loop.subprocess_exec(
                lambda: _Pipe(self._replied, self._died),
                *self._command,
                stderr=None,
                env=_environment(),
                start_new_session=True,  # Ctrl+C must reach the server only.
            )
        except (OSError, NotImplementedError) as error:
            self._starting = None
            self._not_started(error)
            return
        self._starting = None
        # The process ended before this coroutine continued; `_died` has run already.
        if pipe.gone.done():
            return
        self._pipe, self.pid = pipe, pipe.pid
        self._started = self._loop.time()
        # A new process has received no task yet.
        self._tasks_sent.clear()
        self._retire_thread()
        if self._closed:
            pipe.end()
        # Send the questions that were asked while the process started.
        for number in list(self._requests):
            self._send(number)

    def _not_started(self, error: Exception) -> None:
        # The reason may be permanent (no right to start programs) or temporary (no memory, no
        # descriptors), so a thread answers and the start is retried.
        if self._thread is None:
            get_logger().error("no process for substitutes", error=str(error) or repr(error))
            if not (self._started or self._closed):
                self._thread = ThreadBotWorker()
        self._back_off()

    def _retire_thread(self) -> None:
        if self._thread is not None:
            get_logger().info("substitutes now plan in a separate process")
            self._thread.retire()
            self._thread = None

    def _died(self, status: int | None) -> None:
        self._pipe, self.pid = None, None
        if not self._closed:
            get_logger().error("the process of the substitutes died", status=status)
        # Otherwise, restarting a process that dies right after each start would use up a core.
        if self._loop.time() - self._started > HEALTHY_SECONDS:
            self._back_off_seconds = FIRST_BACK_OFF
        self._back_off()

    def _back_off(self) -> None:
        """Lose all questions and wait before the next start."""
        self._retry_at = self._loop.time() + self._back_off_seconds
        self._back_off_seconds = min(MAX_BACK_OFF, 2 * self._back_off_seconds)
        self._reset_reply_timer()
        requests, self._requests = self._requests, {}
        for request in requests.values():
            if not request.answer.done():
                request.answer.set_exception(BotWorkerLostError())

    def _kill(self) -> None:
        self._reply_timer = None
        if self._pipe is not None:
            self._pipe.kill()

    def _reset_reply_timer(self) -> None:
        if self._reply_timer is not None:
            self._reply_timer.cancel()
            self._reply_timer = None

    async def close(self) -> None:
        self._closed = True
        if self._starting is not None:
            await self._starting
        pipe = self._pipe
        if pipe is not None:
            pipe.end()
            await asyncio.wait({pipe.gone}, timeout=CLOSE_SECONDS)
            if not pipe.gone.done():
                pipe.kill()
                await pipe.gone
        self._back_off()
        if self._thread is not None:
            await self._thread.close()

    # Replies

    def _replied(self, reply: Any) -> None:
        number, how, what = reply
        self._reset_reply_timer()
        request = self._requests.get(number)
        if request is None:
            return
        # The process has forgotten the task to bound its memory. It gets the task again.
        if how == UNKNOWN:
            self._tasks_sent.discard(request.task.digest)
            self._send(number)
            return
        del self._requests[number]
        # Each reply proves that the process works, so its time limit starts again.
        if self._requests:
            self._reply_timer = self._loop.call_later(REPLY_SECONDS, self._kill)
        if request.answer.done():
            return
        if how == DONE:
            request.answer.set_result(what)
        else:
            request.answer.set_exception(RuntimeError(what))


class _Pipe(asyncio.SubprocessProtocol):
    """Pipes to the process. `gone` is done when the process has ended."""

    def __init__(self, replied: Callable[[Any], None], died: Callable[[int | None], None]) -> None:
        self.gone: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._replied = replied
        self._died = died
        self._unpacker = unpacker()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.SubprocessTransport", transport)

    @property
    def pid(self) -> int:
        return self._transport.get_pid()

    def write(self, data: bytes) -> None:
        stdin = cast("asyncio.WriteTransport", self._transport.get_pipe_transport(0))
        stdin.write(data)

    def end(self) -> None:
        """Close the process's input, which ends the process."""
        stdin = self._transport.get_pipe_transport(0)
        if stdin is not None:
            stdin.close()

    def kill(self) -> None:
        if not self.gone.done():
            self._transport.kill()

    def pipe_data_received(self, fd: int, data: bytes) -> None:
        try:
            self._unpacker.feed(data)
            for reply in self._unpacker:
                self._replied(reply)
        except (ValueError, TypeError, msgpack.UnpackException):
            get_logger().exception("invalid reply from the process of the substitutes")
            self.kill()

    def process_exited(self) -> None:
        self._transport.close()
        if not self.gone.done():
            self.gone.set_result(None)
            self._died(self._transport.get_returncode())


def _environment() -> dict[str, str]:
    """Return an environment with the same modules but without the server's settings and keys."""
    # The process needs no keys or settings, and cannot leak what it does not have
    # (docs/decisions/0022).
    plain = {k: v for k, v in os.environ.items() if not k.startswith("ROBOTOUILLE_")}
    path = os.pathsep.join(entry or str(Path.cwd()) for entry in sys.path)
    # Compiling the planner would take longer than any seat can wait.
    return {**plain, "PYTHONPATH": path, "ROBOTOUILLE_COMPILE": "0"}
