"""Server-sent events: a value that is sent again whenever it has changed."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from http import HTTPStatus

from pydantic import BaseModel

from robotouille_server.operator.models import Problem
from robotouille_server.operator.principal import Principal, RequestRefusedError

MAX_STREAMS = 32
MAX_STREAMS_PER_SUBJECT = 16
"""Streams with tokens of one subject."""
KEEP_ALIVE_SECONDS = 10.0
TOKEN_CHECK_SECONDS = 1.0
"""Time between two checks of a stream's token, which can expire or be revoked."""

ReadValue = Callable[[], Awaitable[BaseModel]]


class EventStream:
    """One open stream. `end` is the reason why the stream must end, if there is one."""

    def __init__(self, principal: Principal) -> None:
        self.principal = principal
        self.end: RequestRefusedError | None = None
        self._unchecked = 0.0

    def check(self, passed: float) -> None:
        """Check the token if the last check is too old; `passed` is the time since the last call.

        Raises:
            RequestRefusedError: The stream must end.
        """
        self._unchecked += passed
        if self._unchecked >= TOKEN_CHECK_SECONDS:
            self._unchecked = 0.0
            self.principal.check_token()
        if self.end is not None:
            raise self.end


class EventStreams:
    """All open streams."""

    def __init__(self) -> None:
        # A dict keeps the order, and a stream without a token gives way in this order.
        self._open: dict[EventStream, None] = {}
        self._stopping = asyncio.Event()

    def stop(self) -> None:
        """End all streams."""
        self._stopping.set()

    def events(self, read: ReadValue, seconds: float, principal: Principal) -> AsyncIterator[str]:
        """Return `data:` events, at most one per `seconds`, and comments while nothing changes.

        The last event is `refused` if the principal's token is no longer valid, or if a caller
        with a token takes the stream's place.

        Raises:
            RequestRefusedError: Too many streams are open.
        """
        self._make_room(principal)
        return self._events(read, seconds, principal)

    async def _events(
        self, read: ReadValue, seconds: float, principal: Principal
    ) -> AsyncIterator[str]:
        sent, silent, passed = "", 0.0, 0.0
        with self._opened(principal) as stream:
            while True:
                try:
                    stream.check(passed)
                    value = (await read()).model_dump_json()
                except RequestRefusedError as error:
                    yield _refused(error)
                    return
                silent += seconds
                if value != sent:
                    sent, silent = value, 0.0
                    yield f"data: {value}\n\n"
                elif silent >= KEEP_ALIVE_SECONDS:
                    # Proxies close connections without traffic.
                    silent = 0.0
                    yield ": nothing new\n\n"
                if await self.stopped_within(seconds):
                    return
                passed = seconds

    @contextlib.contextmanager
    def _opened(self, principal: Principal) -> Iterator[EventStream]:
        stream = EventStream(principal)
        self._open[stream] = None
        try:
            yield stream
        finally:
            self._open.pop(stream, None)

    def _make_room(self, principal: Principal) -> None:
        """End the oldest stream without a token if a principal with a token needs its place."""
        if principal.grant is not None:
            same = sum(one.principal.token_subject == principal.token_subject for one in self._open)
            if same >= MAX_STREAMS_PER_SUBJECT:
                raise _busy(f"{MAX_STREAMS_PER_SUBJECT} pages are already open with your token")
        if len(self._open) < MAX_STREAMS:
            return
        unknown = next((one for one in self._open if one.principal.grant is None), None)
        if unknown is None or principal.grant is None:
            raise _busy(f"{MAX_STREAMS} pages are already open")
        unknown.end = _busy("an operator with a token took the place of this page")
        del self._open[unknown]

    async def stopped_within(self, seconds: float) -> bool:
        """Wait for the streams to be stopped; return False if the time is over first."""
        try:
            async with asyncio.timeout(seconds):
                await self._stopping.wait()
        except TimeoutError:
            return False
        return True


def _busy(reason: str) -> RequestRefusedError:
    message = f"{reason}; close a page"
    return RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", message)


def _refused(error: RequestRefusedError) -> str:
    problem = Problem(code=error.code, message=error.message)
    return f"event: refused\ndata: {problem.model_dump_json()}\n\n"
