"""Scripted OpenAI-compatible endpoint on a real socket that can misbehave in many ways.

It writes the exact bytes of the script, so tests control how a reply is broken.
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
    """A received request."""

    path: str
    headers: dict[str, str]
    body: dict[str, Any]


@dataclass(frozen=True)
class Reply:
    """Scripted reply: status, headers and body, possibly incomplete, late or missing."""

    body: bytes = b""
    status: int = 200
    content_type: str | None = JSON
    headers: dict[str, str] = field(default_factory=dict)
    delay: float = 0.0
    """Seconds before the first byte."""
    missing: int = 0
    """Announced bytes that are never sent; the connection closes instead."""
    silent: bool = False
    """Write nothing until the client disconnects."""
    stalls: bool = False
    """Stop in the middle of the body until the client disconnects."""
    trickles: bool = False
    """Send a byte of the body every 10 ms."""
    drips: bool = False
    """Send a byte of the status and headers every 10 ms."""

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
    """Return the JSON of a chat completion."""
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
    """Return a normal reply with a completion."""
    return Reply(json.dumps(completion(text, **options)).encode(), delay=delay)


def tool_call() -> Reply:
    """Return a call of an unknown tool instead of text."""
    function = {"name": "move", "arguments": '{"to": "stove1"}'}
    calls = [{"id": "call_1", "type": "function", "function": function}]
    return answer(None, finish_reason="tool_calls", tool_calls=calls)


def stream(*pieces: str, ended: bool = True, usage: object = None) -> Reply:
    """Return a stream of server-sent events."""
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
    """Return an error in OpenAI's format; underscores in header names become hyphens."""
    body = json.dumps({"error": {"message": message, "type": "error", "code": code}}).encode()
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return Reply(body, status=status, headers=named)


def page(status: int = 200) -> Reply:
    """Return a web page, as from an address without an endpoint."""
    return Reply(b"<html><h1>It works!</h1></html>", status=status, content_type="text/html")


class Raw(Reply):
    """Body that is written without status and headers."""

    def encoded(self) -> bytes:
        return self.body


SILENCE = Reply(silent=True)
HANG_UP = Reply(missing=1, status=-1)
"""The connection closes without a byte."""


class ScriptedEndpoint:
    """Endpoint that replies from a script, repeating its last reply, or from a function."""

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
            pass  # The client has disconnected.
        except asyncio.CancelledError:
            pass  # The test has ended.
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _exchange(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Handle one request; return whether the connection remains usable."""
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
        head = len(data) - len(reply.body)
        begin = 0 if reply.drips else head if reply.trickles else len(data)
        end = head if reply.drips else len(data)
        writer.write(data[:begin])
        for byte in data[begin:end]:
            writer.write(bytes([byte]))
            await asyncio.sleep(0.01)
        writer.write(data[end:])
        await writer.drain()
        return not reply.missing

    async def stop(self) -> None:
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)


async def read_request(reader: asyncio.StreamReader) -> Received:
    """Read one HTTP request with a JSON body."""
    head = (await reader.readuntil(b"\r\n\r\n")).decode()
    first, *lines = head.rstrip().split("\r\n")
    pairs = (line.split(":", 1) for line in lines)
    headers = {name.strip().lower(): value.strip() for name, value in pairs}
    body = await reader.readexactly(int(headers.get("content-length", "0")))
    return Received(first.split()[1], headers, json.loads(body) if body else {})


@asynccontextmanager
async def endpoint(*script: Reply) -> AsyncIterator[ScriptedEndpoint]:
    """Run an endpoint with a script on a free port; its `url` is the base URL."""
    async with answering(script) as scripted:
        yield scripted


@asynccontextmanager
async def answering(
    script: Iterable[Reply] | Callable[[Received], Reply],
) -> AsyncIterator[ScriptedEndpoint]:
    """Run an endpoint that replies from a script or a function."""
    scripted = ScriptedEndpoint(script)
    server = await asyncio.start_server(scripted.serve, "127.0.0.1", 0, limit=MAX_HEAD)
    scripted.url = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/v1"
    try:
        yield scripted
    finally:
        server.close()
        await scripted.stop()
