"""Garbage collection: rare, sufficient, and with little garbage to collect."""

from __future__ import annotations

import asyncio
import gc
import time
import weakref
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from websockets.server import ServerProtocol

from robotouille.episode import Episode
from robotouille_server import Server
from robotouille_server.rooms.episode_driver import EpisodeDriver
from robotouille_server.rooms.lobby import LINGER_SECONDS
from robotouille_server.rooms.membership import Membership
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.recording.journal import Journal
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.process_limits import CLOSED_AT_LEAST, NEW, rare_collections
from tests.programs.floods.client import SUBPROTOCOL
from tests.support.fuzzing.wire import PING, TEXT, frame, request
from tests.support.metrics import dropped
from tests.support.samples import quick_sample
from tests.support.servers import raw, serving
from tests.support.virtual_time import run, virtual


class Knot:
    """Object that only the collector can free."""

    def __init__(self) -> None:
        self.itself = self


def tie() -> weakref.ref[Knot]:
    return weakref.ref(Knot())


def tie_old() -> weakref.ref[Knot]:
    """Create a knot that becomes garbage after the collector has seen it in use."""
    knot = Knot()
    gc.collect(1)
    return weakref.ref(knot)


def test_old_garbage_is_collected_after_many_closed_connections() -> None:
    async def main() -> None:
        there, closed = 10 * CLOSED_AT_LEAST, 0
        async with rare_collections(lambda: there, lambda: closed):
            await asyncio.sleep(0.1)
            for _ in range(3):
                knot = tie_old()
                closed += there // 2 - 1
                await asyncio.sleep(60)
                assert knot() is not None
                closed += 1
                await asyncio.sleep(2)
                assert knot() is None

    usual = gc.get_threshold()
    run(main())
    assert gc.get_threshold() == usual


def test_waiting_for_the_processor_does_not_make_collections_rarer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hours = count(step=3600.0)
    monkeypatch.setattr(time, "perf_counter", lambda: next(hours))

    async def main() -> None:
        closed = 0
        async with rare_collections(lambda: 0, lambda: closed):
            await asyncio.sleep(0.1)
            for _ in range(2):
                knot = tie_old()
                closed += CLOSED_AT_LEAST
                await asyncio.sleep(600)
                assert knot() is None

    run(main())


@virtual
async def test_young_garbage_is_collected_soon() -> None:
    async with rare_collections(lambda: 0, lambda: 0):
        await asyncio.sleep(0.1)
        knot = tie()
        kept = [[None] for _ in range(2 * NEW)]
        assert knot() is None
        assert len(kept) == 2 * NEW


@pytest.fixture(scope="module")
def only_new_garbage() -> Iterator[None]:
    """Exclude the garbage of other tests."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("only_new_garbage")
@pytest.mark.parametrize(
    "message",
    [
        {"type": "say", "text": "x" * 600},
        {"type": "say", "text": "hello"},
        {"type": "nonsense"},
        {"type": "act", "seq": 0, "action": None},
        {"type": "act", "seq": 1, "action": {"name": "fly", "args": []}},
        {"type": "act", "seq": 1, "action": [[[[1]]]]},
        {"type": "join", "episode": "NOSUCH-KITCHEN"},
        {"type": "create", "task": "no/such"},
        {"type": "hello", "protocol": 1, "name": "ada"},
        {"type": "list", "ref": -1},
    ],
    ids=str,
)
def test_refused_message_leaves_no_garbage(tmp_path: Path, message: dict[str, Any]) -> None:
    async def main() -> int:
        async with serving(tmp_path, messages_per_second=1000) as server, raw(server) as ada:
            await ada.send(message)
            await asyncio.sleep(1)
            gc.collect()
            gc.disable()
            for _ in range(100):
                await ada.send(message)
            await asyncio.sleep(1)
            return gc.collect()

    try:
        assert run(main()) < 100
    finally:
        gc.enable()


def library_parts() -> int:
    return sum(isinstance(one, ServerProtocol) for one in gc.get_objects())


LONG = frame(b"x" * 60_000, TEXT)


@pytest.mark.usefixtures("only_new_garbage")
@pytest.mark.parametrize(
    "sent",
    [
        request(SUBPROTOCOL),
        request(SUBPROTOCOL) + LONG,
        request(SUBPROTOCOL) + frame(b"", TEXT, fin=False) + LONG,
        request(SUBPROTOCOL) + frame(b"", PING, masked=False),
        b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n",
        b"nonsense\r\n\r\n",
    ],
    ids=["nothing", "long", "fragment", "unmasked", "page", "nonsense"],
)
def test_closed_connection_leaves_no_garbage(tmp_path: Path, sent: bytes) -> None:
    """Frames that are too long once stayed in memory until a collection."""

    async def main() -> int:
        async with serving(tmp_path) as server:
            gc.collect()
            gc.disable()
            before = library_parts()
            for _ in range(10):
                _, writer = await asyncio.open_connection("127.0.0.1", server.port)
                writer.write(sent)
                await asyncio.sleep(1)
                writer.transport.abort()
                await asyncio.sleep(1)
            return library_parts() - before

    try:
        assert run(main()) == 0
    finally:
        gc.enable()


@virtual
async def test_flood_of_unreadable_messages_closes_the_connection(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada:
        for _ in range(1000):
            await ada.send({"type": "nonsense"})
        await asyncio.sleep(1)
        bye = await ada.expect("bye")
        assert bye["code"] == "rate/limited"
        assert dropped(server.metrics, "flood") == 1


@virtual
async def test_no_collection_looks_at_many_objects() -> None:
    """Half a second passed when a million new objects were collected at once."""
    async with rare_collections(lambda: 0, lambda: 0):
        await asyncio.sleep(0.1)
        young, middle, _ = gc.get_threshold()
        assert young * middle <= 100_000


def room_parts() -> list[str]:
    parts = (Room, EpisodeDriver, Broadcaster, Membership, Episode, Journal)
    # `isinstance` would follow weak proxies, also to objects that no longer exist.
    return [kind.__name__ for kind in map(type, gc.get_objects()) if kind in parts]


@pytest.mark.usefixtures("only_new_garbage")
@pytest.mark.parametrize("absence", ["end", "bot"])
@pytest.mark.parametrize("clock", quick_sample(["lockstep", "realtime"]))
@pytest.mark.parametrize("played", [True, False])
def test_closed_room_is_freed_at_once(
    tmp_path: Path, clock: str, absence: str, played: bool
) -> None:
    """Rooms once waited for a full collection, which takes up to a second."""
    order = {"type": "create", "task": "multi_agent/01", "clock": clock, "absence": absence}

    async def play(server: Server, code: str) -> None:
        async with raw(server) as ada, raw(server) as eve:
            join = {"type": "join", "episode": code}
            await ada.ask({**join, "seats": "all"}, "joined")
            await eve.ask({**join, "role": "spectator", "view": "both"}, "joined")
            await asyncio.sleep(1)
            await ada.send({"type": "say", "text": "hello"})

    async def main() -> list[str]:
        async with serving(tmp_path) as server, raw(server) as host:
            for _ in range(3):
                created = await host.ask(order, "created")
                assert room_parts()
                if played:
                    await play(server, created["code"])
                await host.ask({"type": "close", "episode": created["episode"]}, "closed")
            # Nobody returns to an episode that nobody has joined.
            await asyncio.sleep(LINGER_SECONDS + 10 if played else 1)
            return room_parts()

    gc.disable()
    try:
        assert run(main()) == []
    finally:
        gc.enable()
