"""Limits on the load that operators cause, so that their requests delay no episode."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.runtime.budgets import TokenBucket
from robotouille_server.transport import LoopBudget, LoopTurns

if TYPE_CHECKING:  # A server without the extra `operator` imports this module, too.
    from starlette.requests import Request

HEAVY_JOBS = 2
"""Jobs that read recordings at the same time. More would compete with the event loop for the
interpreter's lock."""
MAX_WAITING_JOBS = 16
BUSY_SECONDS = 1
REQUESTS_A_SECOND, REQUESTS_BURST = 20.0, 256.0
"""The burst is twice the number of connections. All connections of a flood can thus send a request,
and an operator without a token is still answered."""
MAX_SUBJECTS = 256
TURNS_A_SECOND, TURNS_BURST = 100.0, 100.0
"""Turns of all operators together. One turn takes about 3 ms, so they use up at most a third of a
core."""
ROWS_A_TURN = 20
"""Rows of the overview that are built in one turn. These rows also count as one request."""
ROOMS_A_TURN = 250
"""Rooms that are searched in one turn."""

P = ParamSpec("P")
T = TypeVar("T")


class HeavyJobs:
    """Work that takes too long for the event loop. It runs in threads, a few at a time."""

    def __init__(self) -> None:
        self._free = asyncio.Semaphore(HEAVY_JOBS)
        self._unfinished: set[asyncio.Task[object]] = set()

    async def run(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Do the work and return its result.

        Raises:
            RequestRefusedError: Too many jobs wait.
        """
        if len(self._unfinished) >= HEAVY_JOBS + MAX_WAITING_JOBS:
            message = f"{len(self._unfinished)} requests for recordings are waiting; try again"
            raise RequestRefusedError(
                HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", message, BUSY_SECONDS
            )

        async def job() -> T:
            async with self._free:
                return await asyncio.to_thread(work, *args, **kwargs)

        task = asyncio.create_task(job(), name="operator port: job")
        self._unfinished.add(task)
        task.add_done_callback(self._finished)
        # A thread cannot be stopped. Its job keeps its place even if the client has gone.
        return await asyncio.shield(task)

    def _finished(self, task: asyncio.Task[object]) -> None:
        self._unfinished.discard(task)
        if not task.cancelled():
            task.exception()  # Otherwise asyncio warns if the client has gone.


async def unless_gone(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """Do work and return its result; cancel it if the client disconnects.

    The web server does not cancel requests by itself.

    Raises:
        RequestRefusedError: The client has disconnected.
    """
    working, gone = asyncio.create_task(work), asyncio.create_task(_disconnected(request))
    try:
        await asyncio.wait((working, gone), return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            status = HTTPStatus.SERVICE_UNAVAILABLE
            raise RequestRefusedError(status, "operator/busy", "the client has gone", BUSY_SECONDS)
        return working.result()
    finally:
        working.cancel()
        gone.cancel()
        await asyncio.gather(working, gone, return_exceptions=True)


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


class Turns(LoopTurns):
    """Turns of the event loop for operators' work, at a limited rate."""

    def __init__(self, budget: LoopBudget, now: Callable[[], float]) -> None:
        super().__init__(budget)
        self._now = now
        self._bucket = TokenBucket(TURNS_A_SECOND, now(), TURNS_BURST)
        self._paced = asyncio.Lock()

    async def next(self) -> None:
        """Wait for a turn. The caller may then work until its next `await`."""
        async with self._paced:
            lacking = 1 - self._bucket.left(self._now())
            if lacking > 0:
                await asyncio.sleep(lacking / TURNS_A_SECOND)
            self._bucket.owe(self._now(), 1)
            await super().next()

    async def parts(self, items: Sequence[T], size: int) -> AsyncIterator[Sequence[T]]:
        """Yield parts of a sequence, each in a turn of its own."""
        for start in range(0, len(items), size):
            await self.next()
            yield items[start : start + size]


class RequestRates:
    """Rate limit of requests, for each token subject. Callers without a token share one."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._buckets: OrderedDict[str | None, TokenBucket] = OrderedDict()

    def charge(self, subject: str | None, cost: float = 1) -> None:
        """Count a request, as several requests if it costs more than others.

        Raises:
            RequestRefusedError: The subject sends too many requests.
        """
        now = self._now()
        bucket = self._buckets.pop(subject, None)
        if bucket is None:
            bucket = TokenBucket(REQUESTS_A_SECOND, now, REQUESTS_BURST)
        self._buckets[subject] = bucket
        if len(self._buckets) > MAX_SUBJECTS:
            self._buckets.popitem(last=False)
        if not bucket.take(now, cost):
            whose = "with your token" if subject else "without a token"
            message = f"more than {REQUESTS_A_SECOND:g} requests per second {whose}"
            raise RequestRefusedError(
                HTTPStatus.TOO_MANY_REQUESTS, "operator/rate", message, BUSY_SECONDS
            )
