"""Event loop with a virtual clock that skips waiting, while real sockets still work.

Time stands still while messages travel through the loopback interface and while threads of the
loop work. When nothing has arrived for a moment, the clock jumps to the next timer.
"""

from __future__ import annotations

import asyncio
import functools
import inspect
import selectors
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SETTLE = 0.0002
"""Real seconds of silence after which no message is in transit."""
WORK = 5.0
"""Real seconds for which time stands still while a thread of the loop works."""


class JumpingSelector(selectors.DefaultSelector):
    """Selector that returns real events first, and otherwise advances virtual time."""

    now = 1000.0
    working = 0

    def select(self, timeout: float | None = None) -> list[Any]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        time.sleep(SETTLE)  # Selectors only wait for whole milliseconds.
        if ready := super().select(0):
            return ready
        if self.working and (ready := super().select(WORK)):
            return ready
        if timeout is None:
            return super().select(None)
        self.now += max(0.0, timeout)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Event loop whose `time()` is virtual."""

    def __init__(self) -> None:
        self._jumping = JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> Any:
        future = super().run_in_executor(executor, func, *args)
        self._jumping.working += 1
        future.add_done_callback(self._done)
        return future

    def _done(self, _: Any) -> None:
        self._jumping.working -= 1

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Wait for threads without a limit, because they end in real time."""
        await super().shutdown_default_executor()


STILL = 50.0
"""Seconds for which `stand_still` suspends the process."""


def stand_still(seconds: float = STILL) -> None:
    """Suspend the process for some seconds."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop._jumping.now += seconds


def run(coroutine: Any) -> Any:
    """Run a coroutine in virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(coroutine)


def virtual(test: Callable[..., Any]) -> Callable[..., None]:
    """Run an asynchronous test in virtual time."""

    @functools.wraps(test)
    def running(*instance: object, **given: Any) -> None:
        run(test(*instance, **given))

    return running


def opening(context: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Run a test in virtual time with `context(tmp_path, **options)` as its first argument."""

    def decorate(test: Callable[..., Any]) -> Callable[..., None]:
        _, *others = inspect.signature(test).parameters.values()
        folder = inspect.Parameter("tmp_path", inspect.Parameter.POSITIONAL_OR_KEYWORD)

        @functools.wraps(test)
        def running(tmp_path: Path, **given: Any) -> None:
            async def main() -> None:
                async with context(tmp_path, **options) as opened:
                    await test(opened, **given)

            run(main())

        running.__signature__ = inspect.Signature([folder, *others])  # type: ignore[attr-defined]
        return running

    return decorate
