"""A scripted OpenAI-compatible endpoint on a real socket: it does what endpoints do at their worst.

Bytes are written as the script has them, so that broken answers are broken exactly so.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

JSON = "application/json"
MAX_HEAD = 100_000


@dataclass(frozen=True)
class Received:
    """A request that came."""

    path: str
    headers: dict[str, str]
    body: dict[str, Any]


@dataclass(frozen=True)
class Reply:
    """What is written: status, headers and body; or less, later, or nothing."""

    body: bytes = b""
    status: int = 200
    content_type: str | None = JSON
    headers: dict[str, str] = field(default_factory=dict)
    delay: float = 0.0
    """Seconds before the first byte."""
    missing: int = 0
    """Bytes that are announced and never come: the connection is cut instead."""
    silent: bool = False
    """Nothing is written at all, until the client goes."""
    stalls: bool = False
    """The body stops in the middle, until the client goes."""

    def encoded(self) -> bytes:
        lines = [f"HTTP/1.1 {self.status} Scripted"]
        if self.content_type is not None:
            lines.append(f"content-type: {self.content_type}")
        lines += [f"{name}: {value}" for name, value in self.headers.items()]
        lines.append(f"content-length: {len(self.body) + self.missing}")
        return "\r\n".join(lines).encode() + b"\r\n\r\n" + self.body


def completion(
    text: str | None,
    *,
    finish_reason: str = "stop",
    usage: object = None,
    **message: object,
) -> dict[str, object]:
    """The JSON of a chat completion."""
    choice = {
        "index": 0,
        "finish_reason": finish_reason,
        "message": {"role": "assistant", "content": text, **message},
    }
    tokens = {"prompt_tokens": 100, "completion_tokens": 20, "total_tokens": 120}
    return {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1,
        "model": "scripted",
        "choices": [choice],
        "usage": tokens if usage is None else usage,
    }


def answer(text: str | None, delay: float = 0.0, **options: Any) -> Reply:
    """A usual answer."""
    return Reply(json.dumps(completion(text, **options)).encode(), delay=delay)


def tool_call() -> Reply:
    """A call of a tool that nobody has offered, instead of text."""
    function = {"name": "move", "arguments": '{"to": "stove1"}'}
    calls = [{"id": "call_1", "type": "function", "function": function}]
    return answer(None, finish_reason="tool_calls", tool_calls=calls)


def stream(*pieces: str, ended: bool = True, usage: object = None) -> Reply:
    """A stream of events, as if one had been asked for."""
    chunks: list[dict[str, object]] = [
        {"choices": [{"index": 0, "delta": {"content": piece}, "finish_reason": None}]}
        for piece in pieces
    ]
    if ended:
        chunks.append({"choices": [{"index": 0, "delta": {}, "finish_reason": "stop"}]})
        chunks.append({"choices": [], "usage": usage or {"prompt_tokens": 7}})
    lines = [": a comment", *(f"data: {json.dumps(chunk)}" for chunk in chunks)]
    lines += ["data: [DONE]"] if ended else []
    body = "\n\n".join(lines).encode() + b"\n\n"
    return Reply(body, content_type="text/event-stream; charset=utf-8")


def error(status: int, message: str = "no", code: str | None = None, **headers: str) -> Reply:
    """An error as OpenAI writes it; underscores in names of headers stand for hyphens."""
    body = json.dumps({"error": {"message": message, "type": "error", "code": code}}).encode()
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return Reply(body, status=status, headers=named)


def page(status: int = 200) -> Reply:
    """A web page, as from an address that is no endpoint."""
    return Reply(b"<html><h1>It works!</h1></html>", status=status, content_type="text/html")


class Raw(Reply):
    """A body that is written as it is, without status and headers."""

    def encoded(self) -> bytes:
        return self.body


SILENCE = Reply(silent=True)
HANG_UP = Reply(missing=1, status=-1)
"""The connection ends without a byte."""


class ScriptedEndpoint:
    """Replies in the order of the script, the last of them again and again; or by a function."""

    def __init__(self, script: Iterable[Reply] | Callable[[Received], Reply]) -> None:
        self._script = list(script) if not callable(script) else script
        self.received: list[Received] = []
        self.url = ""
        self._tasks: set[asyncio.Task[None]] = set()

    def _next(self, request: Received) -> Reply:
        self.received.append(request)
        if callable(self._script):
            return self._script(request)
        return self._script.pop(0) if len(self._script) > 1 else self._script[0]

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            while await self._exchange(reader, writer):
                pass
        except (asyncio.IncompleteReadError, ConnectionError):
            pass  # the client is gone
        except asyncio.CancelledError:
            pass  # the test is over
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _exchange(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """One request and its reply; whether the connection is still of use."""
        reply = self._next(await read_request(reader))
        if reply.silent:
            await reader.read(1)
            return False
        if reply.status < 0:
            return False
        if reply.delay:
            await asyncio.sleep(reply.delay)
        data = reply.encoded()
        if reply.stalls:
            writer.write(data[: -len(reply.body) // 2])
            await reader.read(1)
            return False
        writer.write(data)
        await writer.drain()
        return not reply.missing

    async def stop(self) -> None:
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


async def read_request(reader: asyncio.StreamReader) -> Received:
    """One HTTP request with a JSON body."""
    head = (await reader.readuntil(b"\r\n\r\n")).decode()
    first, *lines = head.rstrip().split("\r\n")
    pairs = (line.split(":", 1) for line in lines)
    headers = {name.strip().lower(): value.strip() for name, value in pairs}
    body = await reader.readexactly(int(headers.get("content-length", "0")))
    return Received(first.split()[1], headers, json.loads(body) if body else {})


@asynccontextmanager
async def endpoint(*script: Reply) -> AsyncIterator[ScriptedEndpoint]:
    """An endpoint on a free port; its `url` is the base URL."""
    async with answering(script) as scripted:
        yield scripted


@asynccontextmanager
async def answering(
    script: Iterable[Reply] | Callable[[Received], Reply],
) -> AsyncIterator[ScriptedEndpoint]:
    """An endpoint that replies by a script or a function."""
    scripted = ScriptedEndpoint(script)
    server = await asyncio.start_server(scripted.serve, "127.0.0.1", 0, limit=MAX_HEAD)
    scripted.url = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/v1"
    try:
        yield scripted
    finally:
        server.close()
        await scripted.stop()
