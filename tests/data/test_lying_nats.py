"""Copying recordings from a program that only pretends to be NATS."""

from __future__ import annotations

import asyncio
import json
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("nats", reason="needs the extra `cluster`")

from robotouille.nats_address import nats_address
from robotouille_data import cluster_recordings
from robotouille_data.cluster_recordings import ClusterRecordings
from robotouille_data.database import UnavailableError

GREETING = {
    "server_id": "X", "server_name": "x", "version": "2.10.0", "proto": 1, "headers": True,
    "max_payload": 1_048_576,
}  # fmt: skip
STATE = {"messages": 1, "bytes": 1, "first_seq": 1, "last_seq": 1, "consumer_count": 0}
STREAM: dict[str, Any] = {"config": {"name": "S"}, "state": STATE}
CONSUMER = {"stream_name": "S", "name": "c", "created": "2026-01-01T00:00:00Z", "config": {}}
MIB = 1024 * 1024


class LyingNats:
    """Server that answers requests by a part of their subject.

    Bytes are sent as they are, after which an endless message follows.
    """

    def __init__(self, answers: Mapping[str, Any], greeting: Any) -> None:
        self._answers = answers
        self._greeting = greeting
        self.sent = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"INFO " + json.dumps(self._greeting).encode() + b"\r\n")
        inboxes: dict[str, str] = {}
        try:
            while words := (await reader.readline()).decode().split():
                match words:
                    case ["PING"]:
                        writer.write(b"PONG\r\n")
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


endless = "endless"


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


def fetch(url: str, folder: Path) -> str:
    """Return the reason why nothing can be copied."""
    recordings = ClusterRecordings(nats_address(url, "robotouille"), folder)
    with pytest.raises(UnavailableError) as caught:
        recordings.fetch(threading.Event(), lambda: nullcontext(lambda done, total: None))
    return str(caught.value)


@pytest.mark.parametrize(
    "stream",
    [
        None, [], {}, {"error": "x"}, {**STREAM, "created": 5}, {**STREAM, "created": "then"},
        {**STREAM, "state": "x"}, {**STREAM, "state": {**STATE, "last_seq": "x"}},
        b"\xff", b"[" * 100_000,
    ],
)  # fmt: skip
def test_invalid_description_of_the_store_is_reported(stream: Any, tmp_path: Path) -> None:
    with lying_nats({"STREAM.INFO": stream}) as (url, _):
        assert "the server's answer is invalid" in fetch(url, tmp_path)


@pytest.mark.parametrize(
    "answers",
    [
        {"CONSUMER.CREATE": None},
        {"CONSUMER.CREATE": {}},
        {"CONSUMER.CREATE": CONSUMER, "CONSUMER.INFO": None},
        {"CONSUMER.CREATE": CONSUMER, "CONSUMER.INFO": {**CONSUMER, "num_pending": "x"}},
    ],
)
def test_invalid_reader_of_the_store_is_reported(answers: Any, tmp_path: Path) -> None:
    with lying_nats({"STREAM.INFO": STREAM, **answers}) as (url, _):
        assert "the server's answer is invalid" in fetch(url, tmp_path)


@pytest.mark.parametrize("greeting", [None, [], 5])
def test_invalid_greeting_is_reported(greeting: Any, tmp_path: Path) -> None:
    with lying_nats({}, greeting) as (url, _):
        assert f"cannot connect to NATS at {url}" in fetch(url, tmp_path)


def test_message_without_end_does_not_fill_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_recordings, "ANSWER_SECONDS", 0.5)
    with lying_nats({"STREAM.INFO": endless}) as (url, liar):
        assert fetch(url, tmp_path).startswith("NATS: ")
    assert liar.sent < 50 * MIB
