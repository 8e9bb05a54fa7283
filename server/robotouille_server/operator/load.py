"""Limits on the load that operators cause, so that their requests delay no episode."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from http import HTTPStatus
from typing import ParamSpec, TypeVar

from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.runtime.budgets import TokenBucket

HEAVY_JOBS = 2
"""Jobs that read recordings at the same time. More would compete with the event loop for the
interpreter's lock."""
MAX_WAITING_JOBS = 16
BUSY_SECONDS = 1
REQUESTS_A_SECOND, REQUESTS_BURST = 20.0, 256.0
"""The burst is twice the number of connections. All connections of a flood can thus send a request,
and an operator without a token is still answered."""
MAX_SUBJECTS = 256

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


class RequestRates:
    """Rate limit of requests, for each token subject. Callers without a token share one."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._buckets: OrderedDict[str | None, TokenBucket] = OrderedDict()

    def charge(self, subject: str | None) -> None:
        """Count one request.

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
        if not bucket.take(now):
            whose = "with your token" if subject else "without a token"
            message = f"more than {REQUESTS_A_SECOND:g} requests per second {whose}"
            raise RequestRefusedError(
                HTTPStatus.TOO_MANY_REQUESTS, "operator/rate", message, BUSY_SECONDS
            )
