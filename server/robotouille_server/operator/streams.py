"""Server-sent events: the same question again and again, answered when the answer has changed."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from http import HTTPStatus

from pydantic import BaseModel

from robotouille_server.operator.errors import RefusedError

__all__ = ["Streams"]

MAX_STREAMS = 32
KEEP_ALIVE_SECONDS = 10.0

Look = Callable[[], Awaitable[BaseModel]]


class Streams:
    """All open streams; `stop` ends them."""

    def __init__(self) -> None:
        self._open = 0
        self._stopping = asyncio.Event()

    def stop(self) -> None:
        """End every stream, and whatever else waits for its next tick."""
        self._stopping.set()

    def events(self, look: Look, seconds: float) -> AsyncIterator[str]:
        """`data:` events, at most one in so many seconds, and comments while nothing changes.

        RefusedError if too many streams are open already.
        """
        if self._open >= MAX_STREAMS:
            message = f"{MAX_STREAMS} pages are open already; close one"
            raise RefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", message)
        return self._events(look, seconds)

    async def _events(self, look: Look, seconds: float) -> AsyncIterator[str]:
        self._open += 1
        told, silent = "", 0.0
        try:
            while True:
                shown = (await look()).model_dump_json()
                silent += seconds
                if shown != told:
                    told, silent = shown, 0.0
                    yield f"data: {shown}\n\n"
                elif silent >= KEEP_ALIVE_SECONDS:
                    silent = 0.0
                    yield ": nothing new\n\n"
                if await self.stopped_within(seconds):
                    return
        finally:
            self._open -= 1

    async def stopped_within(self, seconds: float) -> bool:
        """Wait so long; True at once when the streams are stopped."""
        try:
            async with asyncio.timeout(seconds):
                await self._stopping.wait()
        except TimeoutError:
            return False
        return True
