"""Connections of the operator port: slots, deadlines, and that no flood locks the operator out."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import socket
import ssl
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import trustme

from robotouille.web.bounded_requests import MAX_HEAD_LINES
from robotouille_server.operator import OperatorPort
from robotouille_server.operator.connections import (
    KEEP_ALIVE_SECONDS,
    MAX_CONNECTIONS,
    MAX_PER_ADDRESS,
    MAX_PER_SUBJECT,
    REQUEST_SECONDS,
    STALL_SECONDS,
    ConnectionSlot,
    ConnectionSlots,
    OperatorConnection,
)
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.transport import ServerTLS
from robotouille_server.transport.tls_records import RecordMeter
from tests.support.certificates import Pair
from tests.support.operator import PATIENCE, bearer, viewing
from tests.support.samples import quick_sample
from tests.support.virtual_time import virtual

STREAM = "/api/overview/events"
JSON = {"Content-Type": "application/json", "X-Robotouille-Operator": "1"}


class Clients:
    """Slots of clients, and the numbers of the clients whose connections were closed."""

    def __init__(self) -> None:
        self.slots = ConnectionSlots(lambda: 0.0)
        self.closed: list[int] = []
        self._count = 0

    def connect(self, address: str = "127.0.0.1") -> ConnectionSlot | None:
        number, self._count = self._count, self._count + 1
        return self.slots.take((address, 50_000 + number), lambda: self.closed.append(number))

    def fill(self, count: int, address: str = "127.0.0.1") -> list[ConnectionSlot]:
        slots = [slot for _ in range(count) if (slot := self.connect(address)) is not None]
        assert len(slots) == count
        return slots


def test_connections_are_limited_per_subject() -> None:
    slots = Clients().fill(MAX_PER_SUBJECT + 1)
    for slot in slots[:-1]:
        slot.authenticated("lab")
    slots[0].authenticated("lab")
    with pytest.raises(RequestRefusedError, match="operator/busy"):
        slots[-1].authenticated("lab")
    slots[-1].authenticated("other")


def test_connections_are_limited_per_address_except_on_this_machine() -> None:
    clients = Clients()
    clients.fill(MAX_PER_ADDRESS, "203.0.113.7")[0].authenticated("lab")
    clients.connect("203.0.113.7")
    assert clients.closed == []
    clients.connect("203.0.113.7")
    assert clients.closed == [1]
    clients.connect("203.0.113.8")
    clients.fill(MAX_PER_ADDRESS + 5)
    assert clients.closed == [1]


def test_ipv6_network_counts_as_one_address() -> None:
    clients = Clients()
    for number in range(MAX_PER_ADDRESS + 1):
        clients.connect(f"2001:db8::{number:x}")
    assert clients.closed == [0]


# Over real sockets


def head(path: str = "/api/overview", method: str = "GET", **headers: str) -> bytes:
    lines = [f"{method} {path} HTTP/1.1", "Host: 127.0.0.1"]
    lines += [f"{name}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode()


UNFINISHED = head("/api/announce", "POST", **{"Content-Length": "9"}, **JSON)


class RawClient:
    """Plain TCP connection to the operator port."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    def send(self, data: bytes) -> None:
        self.writer.write(data)

    async def status(self) -> int:
        """Return the status of the next response; 0 if the connection is closed."""
        try:
            line = await self.reader.readline()
        except OSError:
            return 0
        return int(line.split()[1]) if line else 0

    async def is_streaming(self) -> bool:
        """Return whether data arrives that was not sent yet."""
        return bool(await self.reader.read(1_000_000) and await self.reader.read(1_000_000))

    async def closed_at(self) -> float:
        """Wait until the server closes the connection; return the loop's time."""
        with contextlib.suppress(ConnectionError):
            async with asyncio.timeout(PATIENCE):
                while await self.reader.read(65536):
                    pass
        return asyncio.get_running_loop().time()


@asynccontextmanager
async def clients(
    port: OperatorPort, count: int = 1, **options: Any
) -> AsyncIterator[list[RawClient]]:
    opened = []
    try:
        for _ in range(count):
            streams = await asyncio.open_connection("127.0.0.1", port.port, **options)
            opened.append(RawClient(*streams))
        yield opened
    finally:
        for client in opened:
            client.writer.transport.abort()


def about(seconds: float) -> Any:
    """Return what equals a deadline, which the server checks once per second."""
    return pytest.approx(seconds + 0.5, abs=0.7)


@pytest.mark.parametrize(
    "sent", [b"", head()[:30], UNFINISHED], ids=["nothing", "half a head", "no body"]
)
@virtual
async def test_request_must_arrive_in_time(tmp_path: Path, sent: bytes) -> None:
    async with viewing(tmp_path) as (_, port, _), clients(port) as (client,):
        start = asyncio.get_running_loop().time()
        client.send(sent)
        assert await client.closed_at() - start == about(REQUEST_SECONDS)


@virtual
async def test_slowly_sent_bytes_do_not_extend_the_deadline(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, port, _), clients(port) as (client,):
        closed = asyncio.ensure_future(client.closed_at())
        start = asyncio.get_running_loop().time()
        for byte in head()[:6]:
            client.send(bytes([byte]))
            await asyncio.sleep(2)
        assert await closed - start == about(REQUEST_SECONDS)


@pytest.mark.parametrize("more", [b"", b"GET /"], ids=["idle", "second head begun"])
@virtual
async def test_next_request_must_arrive_in_time(tmp_path: Path, more: bytes) -> None:
    async with viewing(tmp_path) as (_, port, _), clients(port) as (client,):
        client.send(head())
        assert await client.status() == 200
        start = asyncio.get_running_loop().time()
        await asyncio.sleep(1)
        client.send(more)
        limit = REQUEST_SECONDS if more else KEEP_ALIVE_SECONDS
        assert await client.closed_at() - start == about(limit)


@pytest.mark.slow
@virtual
async def test_only_a_client_that_reads_nothing_is_disconnected(
    tmp_path: Path,
) -> None:
    content = b"x" * 16_000_000
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
                    assert part, f"closed after {read} bytes"
                    read += len(part)
                    if read > len(content):
                        break
            rest = 0
            while part := await loop.sock_recv(deaf, 1_000_000):
                rest += len(part)
            assert rest < len(content)


def narrow_socket(port: OperatorPort) -> socket.socket:
    """Connect with a small receive buffer."""
    narrow = socket.socket()
    narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65536)
    narrow.connect(("127.0.0.1", port.port))
    narrow.setblocking(False)
    return narrow


@pytest.mark.parametrize("sent", quick_sample([head(STREAM), b"", head("/")]))
@virtual
async def test_newcomer_is_answered_while_others_fill_the_port(tmp_path: Path, sent: bytes) -> None:
    async with viewing(tmp_path) as (_, port, api):
        async with clients(port, MAX_CONNECTIONS + 12) as flood:
            for client in flood:
                client.send(sent)
            for _ in range(3):
                assert (await api.http.get("/api/overview")).status_code == 200


@pytest.mark.slow
@virtual
async def test_connection_with_a_token_survives_a_flood(tmp_path: Path) -> None:
    view = {"ask_token": False}
    opened = viewing(tmp_path, tokens=True, view=view)
    async with opened as (server, port, _), clients(port, 3) as kept:
        for client in kept[:2]:
            client.send(head(STREAM, **bearer(server)))
            assert await client.status() == 200
        kept[2].send(head(STREAM, Authorization="Bearer guess"))
        assert await kept[2].status() == 401
        async with AsyncExitStack() as stack:
            for _ in range(3):
                flood = await stack.enter_async_context(clients(port, MAX_CONNECTIONS // 2))
                for client in flood:
                    client.send(UNFINISHED)
                await asyncio.sleep(0.1)
            assert all([await client.is_streaming() for client in kept[:2]])
            async with clients(port) as (late,):
                late.send(head(**bearer(server, "late")))
                assert await late.status() == 200


def secure_view(pair: Pair) -> dict[str, Any]:
    return {"tls": ServerTLS(pair.cert, pair.key)}


CHUNKED = head("/api/announce", "POST", **{"Transfer-Encoding": "chunked"}) + b"1\r\na\r\n" * 10_000
MANY_LINES = head()[:-2] + b"a:\r\n" * MAX_HEAD_LINES + b"\r\n"


@pytest.mark.parametrize("sent", [CHUNKED, MANY_LINES], ids=["chunks", "lines"])
@pytest.mark.parametrize("secure", [False, True], ids=["plain", "TLS"])
@virtual
async def test_costly_requests_of_strangers_are_refused(
    tmp_path: Path, sent: bytes, secure: bool
) -> None:
    problems: list[Any] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, problem: problems.append(problem))
    pair = Pair(tmp_path)
    view, options = (secure_view(pair), {"ssl": pair.client()}) if secure else ({}, {})
    opened = viewing(tmp_path, tokens=True, view=view)
    async with opened as (_, port, _), clients(port, **options) as (stranger,):
        stranger.send(sent)
        # The client gets no answer if it still sends when the server closes the connection.
        assert await stranger.status() in (0, 400)
        await stranger.closed_at()
    assert problems == []


@virtual
async def test_unfinished_tls_handshakes_hold_slots_and_expire(tmp_path: Path) -> None:
    pair = Pair(tmp_path)
    async with viewing(tmp_path, view=secure_view(pair)) as (_, port, _):
        start = asyncio.get_running_loop().time()
        async with clients(port, MAX_CONNECTIONS + 12) as silent:
            async with clients(port, ssl=pair.client()) as (client,):
                client.send(head())
                assert await client.status() == 200
            assert await silent[-1].closed_at() - start == about(REQUEST_SECONDS)


@pytest.mark.slow
@virtual
async def test_failed_tls_handshakes_leave_no_garbage(tmp_path: Path) -> None:
    arriving, hello = ssl.MemoryBIO(), ssl.MemoryBIO()
    client = ssl.create_default_context().wrap_bio(arriving, hello, server_hostname="127.0.0.1")
    with contextlib.suppress(ssl.SSLWantReadError):
        client.do_handshake()
    first = hello.read()
    async with viewing(tmp_path, view=secure_view(Pair(tmp_path))) as (_, port, _):
        gc.collect()
        gc.disable()
        try:
            for _ in range(20):
                _, writer = await asyncio.open_connection("127.0.0.1", port.port)
                writer.write(first)
                await asyncio.sleep(0.05)
                writer.close()
            await asyncio.sleep(1)
            left = [
                one for one in gc.get_objects() if type(one) in (OperatorConnection, RecordMeter)
            ]
        finally:
            gc.enable()
    assert left == []


@virtual
async def test_renewed_certificate_is_served(tmp_path: Path) -> None:
    pair = Pair(tmp_path)
    view = secure_view(pair)
    async with viewing(tmp_path, view=view) as (_, port, _):
        async with clients(port, ssl=pair.client()) as (client,):
            client.send(head())
            assert await client.status() == 200
        pair.authority = trustme.CA()
        pair.renew()
        assert view["tls"].reload()
        async with clients(port, ssl=pair.client()) as (client,):
            client.send(head())
            assert await client.status() == 200
