"""The server's end of the process in which substitute bots decide (`worker_main`): starts it when
the first question is asked, starts it anew when it dies, and ends it."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import msgpack

from robotouille_server.rooms.substitutes.bot_worker import BotWorkerLostError, ThreadBotWorker
from robotouille_server.rooms.substitutes.bots import BotAnswer, Question
from robotouille_server.rooms.substitutes.worker_main import (
    DONE,
    MAX_BYTES,
    UNKNOWN,
    ask_request,
    learn_request,
    task_request,
)
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["ProcessBotWorker"]

COMMAND = (
    sys.executable,
    "-P",
    "-c",
    "from robotouille_server.rooms.substitutes.worker_main import main; main()",
)
FIRST_BACK_OFF, MAX_BACK_OFF = 0.1, 5.0
"""Seconds after which a process that has died is replaced, the first time and at most."""
HEALTHY_SECONDS = 10.0
"""After which a process that dies is not one that dies again and again."""
REPLY_SECONDS = 60.0
"""Seconds without any reply after which the process is taken for stuck, and killed."""
CLOSE_SECONDS = 1.0


class _Request:
    """What was asked, until it is answered."""

    __slots__ = ("answer", "make", "task")

    def __init__(
        self, task: Task, make: Callable[[int], bytes], answer: asyncio.Future[BotAnswer]
    ) -> None:
        self.task = task
        self.make = make
        self.answer = answer


class ProcessBotWorker:
    """Decides in a process of its own, at low priority. While none is running, what is asked is
    lost at once; where none can be started at first, a thread does until one can."""

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
        """The thread that answers as long as there was no process; now and then one is tried."""
        due = self._loop.time() >= self._retry_at
        if self._thread is not None and self._starting is None and due and not self._closed:
            self._starting = asyncio.create_task(self._start())
        return self._thread

    def _request(self, task: Task, make: Callable[[int], bytes]) -> asyncio.Future[BotAnswer]:
        answer: asyncio.Future[BotAnswer] = self._loop.create_future()
        if self._closed or self._loop.time() < self._retry_at:
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
                process_group=0,  # Ctrl+C is for the server.
            )
        except (OSError, NotImplementedError) as error:
            self._starting = None
            self._not_started(error)
            return
        self._starting = None
        if pipe.gone.done():
            return
        self._pipe, self.pid = pipe, pipe.pid
        self._started = self._loop.time()
        self._tasks_sent.clear()
        self._retire_thread()
        if self._closed:
            pipe.end()
        for number in list(self._requests):
            self._send(number)

    def _not_started(self, error: Exception) -> None:
        """The first one that fails may be for good (no right to start programs), or for a moment
        (no memory, no descriptors): a thread answers until one starts."""
        if self._thread is None:
            get_logger().error("no process for stand-ins", error=str(error) or repr(error))
            if not (self._started or self._closed):
                self._thread = ThreadBotWorker()
        self._back_off()

    def _retire_thread(self) -> None:
        """There is a process now: the thread answers what it was asked, and ends."""
        if self._thread is not None:
            get_logger().info("stand-ins think in a process of their own now")
            self._thread.retire()
            self._thread = None

    def _died(self, status: int | None) -> None:
        self._pipe, self.pid = None, None
        if not self._closed:
            get_logger().error("the stand-ins' process died", status=status)
        if self._loop.time() - self._started > HEALTHY_SECONDS:
            self._back_off_seconds = FIRST_BACK_OFF
        self._back_off()

    def _back_off(self) -> None:
        """Answer nothing for a while; who asks after it gets a new process."""
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
        if how == UNKNOWN:
            self._tasks_sent.discard(request.task.digest)
            self._send(number)
            return
        del self._requests[number]
        if self._requests:
            self._reply_timer = self._loop.call_later(REPLY_SECONDS, self._kill)
        if request.answer.done():
            return
        if how == DONE:
            request.answer.set_result(what)
        else:
            request.answer.set_exception(RuntimeError(what))


class _Pipe(asyncio.SubprocessProtocol):
    """The pipes to the process; `gone` is done when it has ended."""

    def __init__(self, replied: Callable[[Any], None], died: Callable[[int | None], None]) -> None:
        self.gone: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._replied = replied
        self._died = died
        self._unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=MAX_BYTES)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.SubprocessTransport", transport)

    @property
    def pid(self) -> int:
        return self._transport.get_pid()

    def write(self, data: bytes) -> None:
        stdin = cast("asyncio.WriteTransport", self._transport.get_pipe_transport(0))
        stdin.write(data)

    def end(self) -> None:
        """Let it end: it gets no more requests."""
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
            get_logger().exception("the stand-ins' process talks nonsense")
            self.kill()

    def process_exited(self) -> None:
        self._transport.close()
        if not self.gone.done():
            self.gone.set_result(None)
            self._died(self._transport.get_returncode())


def _environment() -> dict[str, str]:
    """What the process needs to find the same modules; none of the server's settings and keys."""
    plain = {k: v for k, v in os.environ.items() if not k.startswith("ROBOTOUILLE_")}
    path = os.pathsep.join(entry or str(Path.cwd()) for entry in sys.path)
    # Compiling the planner would take longer than any seat can wait.
    return {**plain, "PYTHONPATH": path, "ROBOTOUILLE_COMPILE": "0"}
