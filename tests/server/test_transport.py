"""Peers, pending connections and admission."""

from __future__ import annotations

import asyncio
import gc
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest

from robotouille_server import Server
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.audience import DELIVERY_SECONDS
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport import Admission, LoopBudget, Newcomers
from robotouille_server.transport.connection import Connection, PendingConnection
from robotouille_server.transport.loop_budget import LOOP_BUDGET, TURN_SECONDS
from robotouille_server.transport.peer import MAX_HELD, MAX_UNSENT, Peer
from tests.support.fuzzing.wire import request
from tests.support.metrics import dropped
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

KERNEL = 4096
"""Bytes that the operating system is asked to hold at each end."""
TEXT = "x" * 500
"""Longest chat message."""
LARGEST = 2 * len(TEXT)
"""Bytes of a message with it, and more."""


def narrow(transport: asyncio.BaseTransport, option: int) -> None:
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, option, KERNEL)


@asynccontextmanager
async def deaf_spectator(
    server: Server, ada: Raw, **rules: str
) -> AsyncIterator[tuple[Room, Session]]:
    """Connect a spectator of Ada's episode who stops reading."""
    created = await ada.ask({"type": "create", "task": "synchronous/01", **rules}, "created")
    code = created["code"]
    async with raw(server, name="deaf") as deaf:
        await deaf.ask({"type": "join", "episode": code, "role": "spectator"}, "joined")
        await ada.ask({"type": "join", "episode": code}, "joined")
        await deaf.expect("snapshot")
        room = server.lobby.find(code)
        session = next(member for member in room.members if member.player is None)
        narrow(deaf.socket.transport, socket.SO_RCVBUF)
        narrow(peer_of(session).socket.transport, socket.SO_SNDBUF)
        deaf.socket.transport.pause_reading()
        yield room, session


def peer_of(session: Session) -> Peer:
    assert session.peer is not None
    return session.peer


def fill(room: Room, peer: Peer) -> None:
    """Send more than a client may leave unread before it receives no more deltas."""
    if peer.unsent <= 2 * MAX_UNSENT and not peer.socket.transport.is_closing():
        for _ in range(2 * MAX_UNSENT // len(TEXT)):
            room.announce(TEXT)


@virtual
async def test_stalled_client_is_aborted(tmp_path: Path) -> None:
    async with serving(tmp_path, stall_seconds=5) as server, raw(server) as ada:
        async with deaf_spectator(server, ada, clock="realtime") as (room, session):
            peer = peer_of(session)
            async with asyncio.timeout(60):
                while not dropped(server.metrics, "stalled"):
                    fill(room, peer)
                    await asyncio.sleep(0.05)
            assert peer.unsent == 0, "data is still kept for a client that does not read"
            await asyncio.sleep(0.1)
            assert session.peer is None
            assert peer.socket.transport.is_closing()
            await ada.expect("delta")


@pytest.mark.slow
@virtual
async def test_unsent_data_is_bounded(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        async with deaf_spectator(server, ada, clock="turn") as (room, session):
            peer, most, sent, at_once = peer_of(session), 0, 0, 20
            while not dropped(server.metrics, "stalled"):
                for _ in range(at_once):
                    room.announce(TEXT)
                    await ada.expect("notice")
                await asyncio.sleep(DELIVERY_SECONDS)
                most, sent = max(most, peer.unsent), sent + at_once
                assert most <= MAX_HELD + at_once * LARGEST
                assert sent < 4 * MAX_HELD / len(TEXT), "nothing was ever waited for"
            assert most > MAX_HELD
            await asyncio.sleep(0.1)
            assert session.peer is None
            assert peer.unsent == 0
            room.announce(TEXT)
            await ada.expect("notice")


SECONDS = 10.0


class NewOnes:
    """Objects of a type that did not exist before."""

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


@virtual
async def test_silent_connection_creates_no_library_connection(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        connections = NewOnes(Connection)
        held = await silent(server.port, 20)
        assert len(server.admission.newcomers) == 20
        assert connections.count() == 0
        for _, writer in held:
            writer.close()


@virtual
async def test_silent_connection_is_closed_and_freed(tmp_path: Path) -> None:
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
        assert not server.admission.newcomers
        assert server.admission.admitted == 0
        gc.collect()
        assert pending.count() == 0


@virtual
async def test_request_in_single_bytes_is_answered(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        for byte in b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n":
            writer.write(bytes([byte]))
            await asyncio.sleep(0.01)
        assert (await reader.read()).startswith(b"HTTP/1.1 200")
        writer.close()


@virtual
async def test_stopping_server_closes_silent_connections(tmp_path: Path) -> None:
    async with serving(tmp_path, hello_seconds=1000) as server, raw(server):
        ((reader, writer),) = await silent(server.port, 1)
        begun = asyncio.get_running_loop().time()
    assert await reader.read() == b""
    assert asyncio.get_running_loop().time() - begun < 30
    writer.close()


@virtual
async def test_silent_connections_count_towards_the_limit(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        server.admission.limit = 3
        held = await silent(server.port, 5)
        assert server.admission.admitted == 3
        over = [reader for reader, _ in held if reader.at_eof() or reader.exception()]
        assert len(over) == 2
        for _, writer in held:
            writer.close()


class Caller:
    """Connection that has sent nothing."""

    def __init__(self) -> None:
        self.closed = False

    def abort(self) -> None:
        self.closed = True


@virtual
async def test_silent_connections_of_one_address_replace_each_other() -> None:
    groups = {"": "", "a": "a", "b": "b"}
    newcomers = Newcomers(1, 2, lambda peer: groups[str(peer)])
    admission = Admission(Metrics(), 100, SECONDS, newcomers, str)
    here, strangers, other = [Caller() for _ in range(5)], [Caller() for _ in range(4)], Caller()
    for peer, callers in (("", here), ("a", strangers), ("b", [other])):
        for caller in callers:
            admission.enter(caller, peer, heard=False)
    assert [caller.closed for caller in strangers] == [True, True, False, False]
    assert not any(caller.closed for caller in (*here, other))
    admission.newcomers.leave(strangers[2])
    admission.newcomers.leave(strangers[2])
    admission.enter(Caller(), "a", heard=False)
    assert not strangers[3].closed
    assert dropped(admission.metrics, "displaced") == 2


@virtual
async def test_silent_connections_do_not_replace_one_that_has_sent_data() -> None:
    admission = Admission(Metrics(), 100, SECONDS, Newcomers(1, 2, str), str)
    victim = Caller()
    admission.enter(victim, "a", heard=False)
    admission.enter(victim, "a", heard=True)
    for _ in range(10):
        admission.enter(Caller(), "a", heard=False)
    assert not victim.closed
    assert len(admission.newcomers) == 3
    admission.enter(Caller(), "a", heard=True)
    assert victim.closed


@virtual
async def test_queue_is_served_in_order_within_the_budget() -> None:
    budget, served = LoopBudget(asyncio.get_running_loop()), []

    def serve(name: str) -> None:
        served.append(name)
        budget.spend(LOOP_BUDGET / 2)

    for name in ("ada", "bob", "cy"):
        budget.wait(lambda name=name: serve(name))  # type: ignore[misc]
    assert not budget.start(), "newcomers wait behind them"
    await asyncio.sleep(0)
    assert served == ["ada", "bob"]
    await asyncio.sleep(0)
    assert served == ["ada", "bob", "cy"]


@virtual
async def test_client_waits_for_one_of_many_connections_of_another_address() -> None:
    budget = LoopBudget(asyncio.get_running_loop())
    served: list[str] = []
    for number in range(64):
        budget.wait(partial(served.append, f"flood {number}"), "203.0.113.7")
    budget.wait(partial(served.append, "ada"), "203.0.113.8")
    budget.wait(partial(served.append, "local"))
    await asyncio.sleep(0)
    assert served[:4] == ["flood 0", "ada", "local", "flood 1"]
    assert served[3:] == [f"flood {number}" for number in range(1, 64)]


@virtual
async def test_queue_continues_after_an_error() -> None:
    loop, served, errors = asyncio.get_running_loop(), [], []
    loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
    budget = LoopBudget(loop)
    budget.wait(lambda: served.append(1 // len(served)))
    budget.wait(lambda: served.append(2))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert (served, [type(error) for error in errors]) == ([2], [ZeroDivisionError])


@virtual
async def test_turn_ends_after_its_time_though_messages_count_little(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop, now, served = asyncio.get_running_loop(), [0.0], []
    monkeypatch.setattr(loop, "time", lambda: now[0])
    budget = LoopBudget(loop)

    def serve(name: str) -> None:
        budget.spend(1)
        now[0] += TURN_SECONDS
        served.append(name)

    for name in ("ada", "bob"):
        budget.wait(lambda name=name: serve(name))  # type: ignore[misc]
    await asyncio.sleep(0)
    assert served == ["ada"]
    assert not budget.start(), "newcomers wait for the next turn"
    await asyncio.sleep(0)
    assert served == ["ada", "bob"]
    await asyncio.sleep(0)
    now[0] += TURN_SECONDS
    assert budget.start(), "time without work does not count"


@virtual
async def test_clients_that_have_gone_before_their_turn_are_not_answered(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        held = await silent(server.port, 100)
        # The first requests use up the budget of the turn, so that the others wait.
        for _, writer in held:
            writer.write(request("robotouille.v1.json"))
            writer.close()
        await asyncio.sleep(0.5)
        assert dropped(server.metrics, "early") > 40
        assert server.admission.admitted == 1, "only ada is connected"
        await ada.ask({"type": "list"}, "episodes")
