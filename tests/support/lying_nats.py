"""Program that only pretends to be NATS."""

from __future__ import annotations

import asyncio
import json
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

__all__ = ["MIB", "LyingNats", "endless", "hangs_up", "lying_nats"]

GREETING = {
    "server_id": "X", "server_name": "x", "version": "2.10.0", "proto": 1, "headers": True,
    "max_payload": 1_048_576, "jetstream": True,
}  # fmt: skip
MIB = 1024 * 1024
endless = "endless"
hangs_up: Mapping[str, Any] = {}
"""Answers of a server that closes each connection after its start."""


class LyingNats:
    """Server that answers requests by a part of their subject.

    Bytes are sent as they are, after which an endless message follows.
    """

    def __init__(self, answers: Mapping[str, Any], greeting: Any) -> None:
        self._answers = answers
        self._greeting = greeting
        self.sent = 0
        self.connections = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        writer.write(b"INFO " + json.dumps(self._greeting).encode() + b"\r\n")
        inboxes: dict[str, str] = {}
        try:
            while words := (await reader.readline()).decode().split():
                match words:
                    case ["PING"]:
                        writer.write(b"PONG\r\n")
                    case ["SUB", *_] if self._answers is hangs_up:
                        break
                    case ["SUB", inbox, *_, number]:
                        inboxes[inbox] = number
                    case ["PUB", subject, reply, size]:
                        await reader.readexactly(int(size) + 2)
                        await self._answer(writer, subject, reply, inboxes)
        except (ConnectionError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.close()

    async def _answer(
        self, writer: asyncio.StreamWriter, subject: str, reply: str, inboxes: Mapping[str, str]
    ) -> None:
        answer = next((a for part, a in self._answers.items() if part in subject), None)
        number = next((n for inbox, n in inboxes.items() if re.match(inbox, reply)), "1")
        if answer is endless:
            writer.write(f"MSG {reply} {number} 1000000000\r\n".encode())
            while self.sent < 200 * MIB:
                writer.write(b"x" * MIB)
                await writer.drain()
                self.sent += MIB
        body = answer if isinstance(answer, bytes) else json.dumps(answer).encode()
        writer.write(f"MSG {reply} {number} {len(body)}\r\n".encode() + body + b"\r\n")


@contextmanager
def lying_nats(
    answers: Mapping[str, Any], greeting: Any = GREETING
) -> Iterator[tuple[str, LyingNats]]:
    """Run a lying server in a thread, and yield its address and itself."""
    loop, liar = asyncio.new_event_loop(), LyingNats(answers, greeting)
    server = loop.run_until_complete(asyncio.start_server(liar.serve, "127.0.0.1", 0))
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    async def stop() -> None:
        server.close()
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
        loop.call_soon(loop.stop)

    try:
        yield f"nats://127.0.0.1:{server.sockets[0].getsockname()[1]}", liar
    finally:
        asyncio.run_coroutine_threadsafe(stop(), loop)
        thread.join()
        loop.close()
