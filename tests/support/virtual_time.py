"""An event loop whose clock jumps: nothing waits, real sockets still work.

While messages are on their way through the loopback interface time stands still; once nothing has
arrived for a moment, the clock jumps to the next timer; not while the loop's own threads work.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Callable
from typing import Any

SETTLE = 0.0002
"""Real seconds after which nothing is on its way any more."""
WORK = 5.0
"""Real seconds for which time stands still while a thread works for the loop."""


class JumpingSelector(selectors.DefaultSelector):
    """Gives real events the first word, then lets virtual time pass instead of waiting."""

    now = 1000.0
    working = 0

    def select(self, timeout: float | None = None) -> list[Any]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        time.sleep(SETTLE)  # a selector waits for whole milliseconds
        if ready := super().select(0):
            return ready
        if self.working and (ready := super().select(WORK)):
            return ready
        if timeout is None:
            return super().select(None)
        self.now += max(0.0, timeout)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """`loop.time()` is virtual."""

    def __init__(self) -> None:
        self._jumping = JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> Any:
        future = super().run_in_executor(executor, func, *args)
        if executor is None:
            self._jumping.working += 1
            future.add_done_callback(self._done)
        return future

    def _done(self, _: Any) -> None:
        self._jumping.working -= 1

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Threads end in real time, of which none passes here: wait for them without a limit."""
        await super().shutdown_default_executor()


def run(coroutine: Any) -> Any:
    """Run a coroutine in virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(coroutine)
