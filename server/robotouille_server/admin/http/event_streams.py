"""Server-sent events: the same question again and again, answered when the answer has changed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from http import HTTPStatus

from pydantic import BaseModel

from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.models import Problem
from robotouille_server.admin.principal import Principal

__all__ = ["MAX_STREAMS", "MAX_STREAMS_PER_SUBJECT", "Streams"]

MAX_STREAMS = 32
MAX_STREAMS_PER_SUBJECT = 16
"""With tokens of one subject."""
KEEP_ALIVE_SECONDS = 10.0
JUDGE_SECONDS = 1.0
"""So often is a stream's token looked at again."""

Look = Callable[[], Awaitable[BaseModel]]


class Stream:
    """One open stream, and why it has to end; None while it need not."""

    __slots__ = ("end", "judged", "principal")

    def __init__(self, principal: Principal) -> None:
        self.principal = principal
        self.end: RequestRefusedError | None = None
        self.judged = 0.0

    def judge(self, seconds: float) -> None:
        """Look at the token again where that was long ago; RequestRefusedError if it is over."""
        self.judged += seconds
        if self.judged >= JUDGE_SECONDS:
            self.judged = 0.0
            self.principal.judge()
        if self.end is not None:
            raise self.end


class Streams:
    """All open streams; `stop` ends them."""

    def __init__(self) -> None:
        self._open: dict[Stream, None] = {}  # In the order in which they came.
        self._stopping = asyncio.Event()

    def stop(self) -> None:
        """End every stream, and whatever else waits for its next tick."""
        self._stopping.set()

    def events(self, look: Look, seconds: float, principal: Principal) -> AsyncIterator[str]:
        """`data:` events, at most one in so many seconds, and comments while nothing changes.

        The last event is `refused` where the principal's token does not hold any longer, or where
        somebody with a token needs the slot. RequestRefusedError if too many streams are
        open already.
        """
        self._make_room(principal)
        return self._events(look, seconds, principal)

    async def _events(self, look: Look, seconds: float, principal: Principal) -> AsyncIterator[str]:
        told, silent, waited = "", 0.0, 0.0
        with self._opened(principal) as stream:
            while True:
                try:
                    stream.judge(waited)
                    shown = (await look()).model_dump_json()
                except RequestRefusedError as error:
                    yield _refused(error)
                    return
                silent += seconds
                if shown != told:
                    told, silent = shown, 0.0
                    yield f"data: {shown}\n\n"
                elif silent >= KEEP_ALIVE_SECONDS:
                    silent = 0.0
                    yield ": nothing new\n\n"
                if await self.stopped_within(seconds):
                    return
                waited = seconds

    @contextlib.contextmanager
    def _opened(self, principal: Principal) -> Iterator[Stream]:
        stream = Stream(principal)
        self._open[stream] = None
        try:
            yield stream
        finally:
            self._open.pop(stream, None)

    def _make_room(self, principal: Principal) -> None:
        """Who has shown a token takes the place of the oldest stream without one."""
        if principal.grant is not None:
            same = sum(one.principal.token_subject == principal.token_subject for one in self._open)
            if same >= MAX_STREAMS_PER_SUBJECT:
                raise _busy(f"{MAX_STREAMS_PER_SUBJECT} pages are open with your token already")
        if len(self._open) < MAX_STREAMS:
            return
        unknown = next((one for one in self._open if one.principal.grant is None), None)
        if unknown is None or principal.grant is None:
            raise _busy(f"{MAX_STREAMS} pages are open already")
        unknown.end = _busy("somebody with a token needs the place")
        del self._open[unknown]

    async def stopped_within(self, seconds: float) -> bool:
        """Wait so long; True at once when the streams are stopped."""
        try:
            async with asyncio.timeout(seconds):
                await self._stopping.wait()
        except TimeoutError:
            return False
        return True


def _busy(why: str) -> RequestRefusedError:
    return RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", f"{why}; close one")


def _refused(error: RequestRefusedError) -> str:
    problem = Problem(code=error.code, message=error.message)
    return f"event: refused\ndata: {problem.model_dump_json()}\n\n"
