"""Garbage is looked for rarely, but it is; and hardly any is made."""

from __future__ import annotations

import asyncio
import gc
import weakref
from pathlib import Path
from typing import Any

import pytest

from robotouille_server.collector import MARGIN, memory_in_use, rare_collections
from tests.support.servers import raw, serving
from tests.support.virtual_time import run


class Knot:
    """Something that only the collector can free."""

    def __init__(self) -> None:
        self.itself = self


def tie() -> weakref.ref[Knot]:
    return weakref.ref(Knot())


def test_garbage_waits_until_the_memory_has_grown() -> None:
    async def main() -> None:
        size = 1000 * 2**20
        async with rare_collections(lambda: size):
            await asyncio.sleep(0.1)
            assert not gc.isenabled()
            for _ in range(3):
                knot = tie()
                size = size * 5 // 4
                await asyncio.sleep(60)
                assert knot() is not None
                size += 1
                await asyncio.sleep(2)
                assert knot() is None

    was_enabled = gc.isenabled()
    run(main())
    assert gc.isenabled() == was_enabled


def test_python_collects_again_where_the_memory_cannot_be_asked_for() -> None:
    def unknown() -> int:
        raise RuntimeError

    async def main() -> None:
        async with rare_collections(unknown):
            await asyncio.sleep(10)
            assert gc.isenabled()

    run(main())


def test_the_memory_in_use_is_that_of_the_process() -> None:
    before = memory_in_use()
    ballast = bytearray(b"x") * MARGIN
    assert MARGIN / 2 < memory_in_use() - before < 2 * MARGIN
    del ballast


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
def test_a_refused_message_leaves_nothing_behind(tmp_path: Path, message: dict[str, Any]) -> None:
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


def test_a_flood_of_messages_that_cannot_be_read_ends_the_connection(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada:
            for _ in range(1000):
                await ada.send({"type": "nonsense"})
            await asyncio.sleep(1)
            bye = await ada.expect("bye")
            assert bye["code"] == "rate/limited"
            assert server.metrics.dropped.labels("flood")._value.get() == 1

    run(main())
