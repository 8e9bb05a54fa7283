"""Who does not read is cut off for real, and nothing queues up for them without bound."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from robotouille_server import Server
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import Session
from robotouille_server.transport.peer import MAX_HELD, MAX_UNSENT, Peer
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run

KERNEL = 4096
"""Bytes that the operating system is asked to hold at each end."""
TEXT = "x" * 500
"""As long as chat may be."""
LARGEST = 2 * len(TEXT)
"""Bytes of a message with it, and more."""


def narrow(transport: asyncio.BaseTransport, option: int) -> None:
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, option, KERNEL)


@asynccontextmanager
async def deaf_spectator(
    server: Server, ada: Raw, **rules: str
) -> AsyncIterator[tuple[Room, Session]]:
    """Somebody who watches ada's episode, and reads nothing any more."""
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


def dropped(server: Server) -> float:
    """How many have been cut off because they did not read."""
    return float(server.metrics.dropped.labels("stalled")._value.get())


def fill(room: Room, peer: Peer) -> None:
    """As much waits as keeps deltas away; the network may have taken some in the meantime."""
    while peer.unsent <= 2 * MAX_UNSENT and not peer.socket.transport.is_closing():
        room.announce(TEXT)


def test_who_has_stalled_is_gone_at_once(tmp_path: Path) -> None:
    """Nothing that waits for them is waited for: they would never take it."""

    async def main() -> None:
        async with serving(tmp_path, stall_seconds=5) as server, raw(server) as ada:
            async with deaf_spectator(server, ada, clock="realtime") as (room, session):
                peer = peer_of(session)
                async with asyncio.timeout(60):
                    while not dropped(server):
                        fill(room, peer)
                        await asyncio.sleep(0.05)
                assert peer.unsent == 0, "it is still kept for somebody who does not read"
                await asyncio.sleep(0.1)
                assert session.peer is None
                assert peer.socket.transport.is_closing()
                await ada.expect("delta")

    run(main())


async def announce(room: Room, ada: Raw) -> None:
    room.announce(TEXT)
    await ada.expect("notice")


async def chat(room: Room, ada: Raw) -> None:
    await ada.ask({"type": "say", "text": TEXT}, "said")


@pytest.mark.parametrize("flood", [announce, chat])
def test_what_waits_for_one_who_does_not_read_is_bounded(
    tmp_path: Path, flood: Callable[[Room, Raw], Awaitable[None]]
) -> None:
    """No picture is due in the meantime, so that only the bytes that wait can tell."""

    async def main() -> None:
        async with serving(tmp_path, messages_per_second=1e6) as server, raw(server) as ada:
            async with deaf_spectator(server, ada, clock="turn") as (room, session):
                peer, most, sent = peer_of(session), 0, 0
                while not dropped(server):
                    await flood(room, ada)
                    most, sent = max(most, peer.unsent), sent + 1
                    assert most <= MAX_HELD + LARGEST
                    assert sent < 4 * MAX_HELD / len(TEXT), "nothing was ever waited for"
                assert most > MAX_HELD
                await asyncio.sleep(0.1)
                assert session.peer is None
                assert peer.unsent == 0
                await flood(room, ada)

    run(main())
