"""The port is never full for an operator: whoever says nothing goes in time, and makes room."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import trustme

from robotouille_server.admin import OperatorPort
from robotouille_server.admin.http.connection_slots import (
    MAX_CONNECTIONS,
)
from robotouille_server.admin.http.timeouts import (
    KEEP_ALIVE_SECONDS,
    REQUEST_SECONDS,
    STALL_SECONDS,
)
from tests.support.operator import PATIENCE, bearer, viewing
from tests.support.virtual_time import run

HEAD = "GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n{more}\r\n"
STREAM = "/api/overview/events"


def head(path: str = "/api/overview", **headers: str) -> bytes:
    more = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    return HEAD.format(path=path, more=more).encode()


class Line:
    """A plain TCP connection to the port."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    def say(self, data: bytes) -> None:
        self.writer.write(data)

    async def status(self) -> int:
        """The status of the next answer; 0 if the connection is over."""
        try:
            line = await self.reader.readline()
        except OSError:
            return 0
        return int(line.split()[1]) if line else 0

    async def goes_on(self) -> bool:
        """Whether more comes than what has come."""
        return bool(await self.reader.read(1_000_000) and await self.reader.read(1_000_000))

    async def ends(self) -> float:
        """When the connection is over, in the loop's time."""
        with contextlib.suppress(ConnectionError):
            async with asyncio.timeout(PATIENCE):
                while await self.reader.read(65536):
                    pass
        return asyncio.get_running_loop().time()


@asynccontextmanager
async def lines(port: OperatorPort, count: int = 1, **options: Any) -> AsyncIterator[list[Line]]:
    opened = []
    try:
        for _ in range(count):
            opened.append(Line(*await asyncio.open_connection("127.0.0.1", port.port, **options)))
        yield opened
    finally:
        for line in opened:
            line.writer.transport.abort()


JSON = {"Content-Type": "application/json", "X-Robotouille-Operator": "1"}
UNFINISHED = head("/api/announce", **{"Content-Length": "9"}, **JSON).replace(b"GET", b"POST")


@pytest.mark.parametrize(
    "said", [b"", head()[:30], UNFINISHED], ids=["nothing", "half a head", "no body"]
)
def test_what_is_not_sent_in_time_is_not_waited_for(tmp_path: Path, said: bytes) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (_, port, _), lines(port) as (line,):
            begun = asyncio.get_running_loop().time()
            line.say(said)
            passed = await line.ends() - begun
            assert passed == pytest.approx(REQUEST_SECONDS, abs=0.5)

    run(main())


def test_bytes_that_trickle_in_win_no_time(tmp_path: Path) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (_, port, _), lines(port) as (line,):
            ended = asyncio.ensure_future(line.ends())
            begun = asyncio.get_running_loop().time()
            for byte in head()[:6]:
                line.say(bytes([byte]))
                await asyncio.sleep(2)
            assert await ended - begun == pytest.approx(REQUEST_SECONDS, abs=1)

    run(main())


@pytest.mark.parametrize("more", [b"", b"GET /"], ids=["idle", "a second head, begun"])
def test_a_kept_connection_is_not_kept_for_long(tmp_path: Path, more: bytes) -> None:
    async def main() -> None:
        async with viewing(tmp_path) as (_, port, _), lines(port) as (line,):
            line.say(head())
            assert await line.status() == 200
            await asyncio.sleep(1)
            begun = asyncio.get_running_loop().time()
            line.say(more)
            passed = await line.ends() - begun
            assert passed == pytest.approx(
                (REQUEST_SECONDS if more else KEEP_ALIVE_SECONDS) - 1, abs=0.5
            )

    run(main())


def test_who_does_not_read_an_answer_is_cut_off_and_who_reads_slowly_is_not(
    tmp_path: Path,
) -> None:
    content = b"x" * 16_000_000

    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with viewing(tmp_path) as (_, port, _):
            (tmp_path / "a_b_c.rbt").write_bytes(content)
            with narrow_socket(port) as deaf, narrow_socket(port) as slow:
                for one in (deaf, slow):
                    await loop.sock_sendall(one, head("/api/recordings/a_b_c.rbt"))
                read = 0
                while read < len(content):
                    await asyncio.sleep(STALL_SECONDS / 2)
                    for _ in range(30):
                        part = await loop.sock_recv(slow, 100_000)
                        assert part, f"over after {read} bytes"
                        read += len(part)
                        if read > len(content):
                            break
                rest = 0
                while part := await loop.sock_recv(deaf, 1_000_000):
                    rest += len(part)
                assert rest < len(content)

    run(main())


def narrow_socket(port: OperatorPort) -> socket.socket:
    """A connection whose own buffer is small."""
    narrow = socket.socket()
    narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
    narrow.connect(("127.0.0.1", port.port))
    narrow.setblocking(False)
    return narrow


@pytest.mark.parametrize("said", [b"", head("/"), head(STREAM)], ids=["silent", "idle", "streams"])
def test_a_full_port_makes_room(tmp_path: Path, said: bytes) -> None:
    """Whoever comes is answered, with however many connections somebody holds the port."""

    async def main() -> None:
        async with viewing(tmp_path) as (_, port, api):
            async with lines(port, MAX_CONNECTIONS + 12) as held:
                for line in held:
                    line.say(said)
                for _ in range(3):
                    assert (await api.http.get("/api/overview")).status_code == 200
            assert len(held) > MAX_CONNECTIONS

    run(main())


def test_a_connection_with_a_good_token_is_displaced_by_nobody(tmp_path: Path) -> None:
    async def main() -> None:
        view = {"ask_token": False}
        opened = viewing(tmp_path, tokens=True, view=view)
        async with opened as (server, port, _), lines(port, 3) as kept:
            for line in kept[:2]:
                line.say(head(STREAM, **bearer(server)))
                assert await line.status() == 200
            kept[2].say(head(STREAM, Authorization="Bearer guess"))
            assert await kept[2].status() == 401
            async with AsyncExitStack() as flood:
                for _ in range(3):
                    for line in await flood.enter_async_context(lines(port, MAX_CONNECTIONS // 2)):
                        line.say(UNFINISHED)
                    await asyncio.sleep(0.1)
                assert all([await line.goes_on() for line in kept[:2]])
                async with lines(port) as (late,):
                    late.say(head(**bearer(server, "late")))
                    assert await late.status() == 200

    run(main())


def test_silence_instead_of_a_tls_handshake_is_no_way_in(tmp_path: Path) -> None:
    authority = trustme.CA()
    context, trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.create_default_context()
    authority.issue_cert("127.0.0.1").configure_cert(context)
    authority.configure_trust(trusting)

    async def main() -> None:
        async with viewing(tmp_path, view={"tls": context}) as (_, port, _):
            async with lines(port, MAX_CONNECTIONS + 12) as silent:
                async with lines(port, ssl=trusting) as (line,):
                    line.say(head())
                    assert await line.status() == 200
                begun = asyncio.get_running_loop().time()
                passed = await silent[-1].ends() - begun
                assert passed == pytest.approx(REQUEST_SECONDS, abs=1)

    run(main())


# Who makes room for whom
