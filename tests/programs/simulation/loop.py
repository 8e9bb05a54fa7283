"""Event loop without sockets, threads or real time, and the processes that run on it.

Time stands still while any callback is ready, and then jumps to the next timer. Each callback
belongs to the process in whose context it was scheduled. A process can be suspended (its callbacks
wait, as after SIGSTOP) and killed (its callbacks never run, and it has no further effect).
"""

from __future__ import annotations

import asyncio
import contextlib
import heapq
from asyncio import events
from collections.abc import Callable, Coroutine, Iterator
from contextvars import Context, ContextVar, copy_context
from typing import Any, TypeVar

__all__ = ["EPOCH", "Killed", "Process", "SimulatedLoop", "current_process"]

T = TypeVar("T")

EPOCH = 1000.0
"""Start value of the clock."""
MAX_FINALLY = 20


class Killed(BaseException):
    """Unwinds a callback during which its process was killed."""


class Process:
    """Simulated operating system process, whose tasks and callbacks end with it."""

    def __init__(self, name: str, loop: SimulatedLoop, host: str = "127.0.0.1") -> None:
        self.name = name
        self.host = host
        self.loop = loop
        self.dead = False
        self.suspended = False
        self.callbacks = 0
        self.dies_at: int | None = None
        self.on_death: list[Callable[[], None]] = []
        self._parked: list[events.Handle] = []
        self._grave: list[SimulatedTask] = []
        self.context = copy_context()
        self.context.run(_process.set, self)

    def __repr__(self) -> str:
        return f"<Process {self.name}{' (dead)' if self.dead else ''}>"

    def start(self, coroutine: Coroutine[Any, Any, T], name: str = "main") -> asyncio.Task[T]:
        """Create a task of this process."""
        return self.loop.create_task(
            coroutine, name=f"{self.name}/{name}", context=self.context.copy()
        )

    def call(self, function: Callable[..., T], *args: Any) -> T:
        """Call a function as part of this process."""
        return self.context.copy().run(function, *args)

    def suspend(self) -> None:
        self.suspended = True

    def wake(self) -> None:
        """Continue, and run all callbacks that became due while suspended, in order."""
        self.suspended = False
        parked, self._parked = self._parked, []
        self.loop.requeue(parked)

    def kill(self) -> None:
        """Kill the process like `kill -9`: it neither runs nor has any effect from now on."""
        if self.dead:
            return
        self._grave = self.tasks()
        self.dead = True
        self._parked.clear()
        for mourn in self.on_death:
            mourn()

    def tasks(self) -> list[SimulatedTask]:
        """Return the unfinished tasks, oldest first."""
        return [task for task in self.loop.living_tasks() if task.process is self]

    def bury(self) -> None:
        """Free the resources of a dead process; its `finally` blocks run, but without effect."""
        self.on_death.clear()
        with self.loop.muted():
            for task in self._grave:
                task.abandon(self.context)
            self._grave.clear()

    def admit(self, handle: events.Handle) -> bool:
        """Return whether a callback may run now; park it while the process is suspended."""
        if self.dead:
            return False
        if self.suspended:
            self._parked.append(handle)
            return False
        self.callbacks += 1
        if self.dies_at is not None and self.callbacks >= self.dies_at:
            self.kill()
            return False
        return True


_process: ContextVar[Process | None] = ContextVar("process", default=None)


def current_process() -> Process | None:
    """Return the caller's process, or None outside of all processes."""
    return _process.get()


class SimulatedTask(asyncio.Task):  # type: ignore[type-arg]
    """Task with its process and a hash that is the same in every run."""

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, Any],
        *,
        process: Process | None,
        serial: int,
        **options: Any,
    ) -> None:
        self.process = process
        self.serial = serial
        super().__init__(coroutine, **options)

    def __hash__(self) -> int:
        return self.serial

    def __eq__(self, other: object) -> bool:
        return self is other

    def abandon(self, context: Context) -> None:
        """Discard a task that will never run again; its `finally` blocks may await repeatedly."""
        self._log_destroy_pending = False
        coroutine: Any = self.get_coro()
        for _ in range(MAX_FINALLY):
            try:
                context.copy().run(coroutine.close)
            except BaseException:
                continue
            return


class SimulatedFuture(asyncio.Future):  # type: ignore[type-arg]
    """Future with a hash that is the same in every run."""

    serial: int = 0

    def __hash__(self) -> int:
        return self.serial

    def __eq__(self, other: object) -> bool:
        return self is other


class SimulatedLoop(asyncio.BaseEventLoop):
    """Event loop with virtual time in seconds from `EPOCH`; `network` makes its connections."""

    def __init__(self) -> None:
        super().__init__()
        self.network: Any = None
        self.callbacks = 0
        self.faults: list[str] = []
        self._now = EPOCH
        self._serial = 0
        self._timers: list[tuple[float, int, events.TimerHandle]] = []
        self._muted = False
        self._tasks: list[SimulatedTask] = []
        self._many_tasks = 100
        self.set_task_factory(self._make_task)
        self.set_exception_handler(self._note_fault)

    def time(self) -> float:
        return self._now

    # Scheduling

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> events.Handle:
        handle = events.Handle(callback, args, self, context)
        if not self._muted:
            self._ready.append(handle)
        return handle

    call_soon_threadsafe = call_soon  # type: ignore[assignment]

    def call_later(  # type: ignore[override]
        self,
        delay: float,
        callback: Callable[..., Any],
        *args: Any,
        context: Context | None = None,
    ) -> events.TimerHandle:
        return self.call_at(self._now + delay, callback, *args, context=context)

    def call_at(  # type: ignore[override]
        self,
        when: float,
        callback: Callable[..., Any],
        *args: Any,
        context: Context | None = None,
    ) -> events.TimerHandle:
        handle = events.TimerHandle(when, callback, args, self, context)
        if not self._muted:
            self._serial += 1
            heapq.heappush(self._timers, (when, self._serial, handle))
        return handle

    def create_future(self) -> asyncio.Future[Any]:
        future = SimulatedFuture(loop=self)
        self._serial += 1
        future.serial = self._serial
        return future

    def _make_task(
        self,
        loop: asyncio.AbstractEventLoop,
        coroutine: Coroutine[Any, Any, Any],
        **options: Any,
    ) -> SimulatedTask:
        context = options.get("context")
        process = current_process() if context is None else context.get(_process)
        self._serial += 1
        task = SimulatedTask(coroutine, process=process, serial=self._serial, loop=loop, **options)
        if self._muted:
            task.abandon(copy_context())
            return task
        self._tasks.append(task)
        if len(self._tasks) > self._many_tasks:
            self._many_tasks = 2 * len(self.living_tasks()) + 100
        return task

    def living_tasks(self) -> list[SimulatedTask]:
        """Return the tasks that can still run, oldest first."""
        self._tasks = [
            task
            for task in self._tasks
            if not task.done() and not (task.process is not None and task.process.dead)
        ]
        return list(self._tasks)

    def pending(self, process: Process) -> list[events.TimerHandle]:
        """Return the timers that a process waits for."""
        return [
            handle
            for _, _, handle in sorted(self._timers)
            if not handle.cancelled() and handle._context.get(_process) is process
        ]

    def requeue(self, handles: list[events.Handle]) -> None:
        self._ready.extend(handles)

    @contextlib.contextmanager
    def muted(self) -> Iterator[None]:
        """Discard everything that is scheduled within the context."""
        before, self._muted = self._muted, True
        running = events._get_running_loop()
        events._set_running_loop(self)
        try:
            yield
        finally:
            self._muted = before
            events._set_running_loop(running)

    # Running

    def _run_once(self) -> None:
        if not self._ready:
            self._advance()
        for _ in range(len(self._ready)):
            handle = self._ready.popleft()
            if handle._cancelled:
                continue
            process = handle._context.get(_process)
            if process is not None and not process.admit(handle):
                continue
            self.callbacks += 1
            handle._run()

    def _advance(self) -> None:
        """Jump to the next timer and make all due timers ready."""
        timers = self._timers
        while timers and timers[0][2]._cancelled:
            heapq.heappop(timers)
        if not timers:
            if not self._stopping:
                raise RuntimeError("deadlock: nothing is scheduled")
            return
        self._now = max(self._now, timers[0][0])
        while timers and timers[0][0] <= self._now:
            handle = heapq.heappop(timers)[2]
            if not handle._cancelled:
                self._ready.append(handle)

    def _timer_handle_cancelled(self, handle: events.TimerHandle) -> None:
        pass

    def _process_events(self, event_list: Any) -> None:
        pass

    def _write_to_self(self) -> None:
        pass

    def _note_fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Record an unhandled exception that asyncio would log."""
        error = context.get("exception")
        if isinstance(error, Killed):
            return
        self.faults.append(f"{context.get('message')}: {error!r}")

    # Called by libraries

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, function: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Run a function as a separate callback, before or after which a process can be killed."""
        future: asyncio.Future[T] = self.create_future()
        self.call_soon(_work, future, function, args)
        return future

    async def create_connection(  # type: ignore[override]
        self, factory: Callable[[], Any], host: str, port: int, **options: Any
    ) -> tuple[Any, Any]:
        return await self.network.connect(factory, host, port)

    async def create_server(  # type: ignore[override]
        self, factory: Callable[[], Any], host: Any = None, port: int = 0, **options: Any
    ) -> Any:
        return self.network.listen(factory, port, bool(options.get("reuse_port")))


def _work(future: asyncio.Future[T], function: Callable[..., T], args: tuple[Any, ...]) -> None:
    if future.cancelled():
        return
    try:
        future.set_result(function(*args))
    except Exception as error:
        future.set_exception(error)
