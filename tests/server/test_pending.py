"""Who has said nothing yet costs little, is cut off in time, and goes on with the first byte."""

from __future__ import annotations

import asyncio
import gc
from pathlib import Path

import pytest

from robotouille_server.transport.connection import Connection
from robotouille_server.transport.pending import PendingConnection
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

SECONDS = 10.0


class NewOnes:
    """The objects of a type that are there now and were not before: other tests may leave some."""

    def __init__(self, kind: type) -> None:
        self.kind = kind
        self.before = self._there()

    def _there(self) -> dict[int, object]:
        return {id(one): one for one in gc.get_objects() if type(one) is self.kind}

    def count(self) -> int:
        return len(self._there().keys() - self.before.keys())


async def silent(port: int, count: int) -> list[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    opened = [await asyncio.open_connection("127.0.0.1", port) for _ in range(count)]
    await asyncio.sleep(0.1)
    return opened


def test_silence_makes_no_connection_of_the_library(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            connections = NewOnes(Connection)
            held = await silent(server.port, 20)
            assert len(server._admission.pending) == 20
            assert connections.count() == 0
            for _, writer in held:
                writer.close()

    run(main())


def test_who_stays_silent_is_cut_off_and_leaves_nothing(tmp_path: Path) -> None:
    async def main() -> None:
        pending = NewOnes(PendingConnection)
        async with serving(tmp_path, hello_seconds=SECONDS) as server:
            begun = asyncio.get_running_loop().time()
            held = await silent(server.port, 5)
            assert pending.count() == 5
            for reader, writer in held:
                assert await reader.read() == b""
                writer.close()
            assert asyncio.get_running_loop().time() - begun == pytest.approx(SECONDS, abs=0.5)
            await asyncio.sleep(1)
            assert not server._admission.pending
            assert server._admission.admitted == 0
            gc.collect()
            assert pending.count() == 0

    run(main())


def test_a_request_in_single_bytes_is_answered(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            for byte in b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n":
                writer.write(bytes([byte]))
                await asyncio.sleep(0.01)
            assert (await reader.read()).startswith(b"HTTP/1.1 200")
            writer.close()

    run(main())


def test_a_server_that_stops_cuts_off_who_is_silent(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, hello_seconds=1000) as server, raw(server):
            ((reader, writer),) = await silent(server.port, 1)
            begun = asyncio.get_running_loop().time()
        assert await reader.read() == b""
        assert asyncio.get_running_loop().time() - begun < 30
        writer.close()

    run(main())


def test_a_full_server_counts_who_is_silent(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            server._admission.limit = 3
            held = await silent(server.port, 5)
            assert server._admission.admitted == 3
            over = [reader for reader, _ in held if reader.at_eof() or reader.exception()]
            assert len(over) == 2
            for _, writer in held:
                writer.close()

    run(main())
