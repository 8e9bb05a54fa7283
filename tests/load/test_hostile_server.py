"""The load tester with servers that send anything."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import msgpack
import pytest
from tools.message_examples import EXAMPLES
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from robotouille.episode.rules import Clock
from robotouille.protocol.codec import MAX_SERVER_ITEMS, MSGPACK
from robotouille_client.loadtest.histogram import MAX_COUNTERS, Measurements
from robotouille_client.loadtest.load_worker import LoadWorker
from robotouille_client.loadtest.workload import LoadPlan
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.specimens import server_messages
from tests.support.samples import quick_sample
from tests.support.virtual_time import virtual

Answers = Callable[[dict[str, Any]], list[bytes]]

WELCOME = {
    "type": "welcome", "protocol": 1, "server": "x", "session": "s", "resume": "token",
    "role": "host", "grace": 1.0,
}  # fmt: skip


def honest(message: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the answers that the load tester expects."""
    match message["type"]:
        case "hello":
            return [WELCOME]
        case "create":
            return [EXAMPLES["created"]]
        case "join":
            return [EXAMPLES["joined"], {**EXAMPLES["roster"], "phase": "running"}]
        case "act":
            step = {"type": "delta", "step": message["seq"], "did": [], "seq": []}
            return [step]
    return []


async def load_test(answers: Answers, **plan: Any) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Return the counts of a load test and the errors in the event loop."""
    reports: list[dict[str, Any]] = []
    errors: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: errors.append(context))

    async def lie(socket: ServerConnection) -> None:
        try:
            async for payload in socket:
                for answer in answers(msgpack.unpackb(payload)):
                    await socket.send(answer)
        except ConnectionClosed:
            pass

    protocols = [Subprotocol(MSGPACK.name)]
    async with serve(lie, "127.0.0.1", 0, subprotocols=protocols) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        (share,) = LoadPlan(url=f"ws://127.0.0.1:{port}", rooms=2, ramp=0.0, **plan).shares()
        worker = LoadWorker(share, reports.append)
        await worker.open()
        worker.measure()
        await asyncio.sleep(5)
        worker.stop()
        await asyncio.sleep(1)
    total = Measurements()
    for report in reports:
        total.merge(Measurements.from_json(report))
    return total.counts, errors


@pytest.mark.parametrize(
    "lie",
    [
        {"type": "welcome"},
        {"type": "created"},
        {"type": "joined"},
        {"type": "moved"},
        [1, 2, 3],
        5,
        {},
        {"type": []},
        {"type": "delta", "step": "x"},
    ],
)
@pytest.mark.parametrize("to", quick_sample(["create", "hello", "join"]))
@virtual
async def test_invalid_answers_end_the_connection(to: str, lie: Any) -> None:
    def answers(message: dict[str, Any]) -> list[bytes]:
        found = [lie] if message["type"] == to else honest(message)
        return [msgpack.packb(one) for one in found]

    counts, errors = await load_test(answers)
    assert errors == []
    assert counts["invalid messages"] >= 2


@pytest.mark.parametrize("seed", range(12))
@virtual
async def test_hostile_messages_raise_nothing(seed: int) -> None:
    adversary = Adversary(seed)

    def answers(message: dict[str, Any]) -> list[bytes]:
        found = [msgpack.packb(one) for one in honest(message)]
        if adversary.random.random() < 0.5:
            return found
        return [*found, adversary.packed(adversary.message(server_messages()))]

    clock = list(Clock)[seed % len(Clock)]
    _, errors = await load_test(answers, mix={clock: 1})
    assert errors == []


def test_counters_are_limited() -> None:
    measured = Measurements()
    for number in range(10 * MAX_COUNTERS):
        measured.count(f"refused: {number}")
    assert len(measured.counts) == MAX_COUNTERS + 1
    assert sum(measured.counts.values()) == 10 * MAX_COUNTERS


def test_names_of_counters_are_cut() -> None:
    measured = Measurements()
    for number in range(3):
        measured.count(f"refused: {'x' * 10**6}{number}")
    assert [(len(name), count) for name, count in measured.counts.items()] == [(100, 3)]


@virtual
async def test_messages_have_the_limits_of_the_protocol() -> None:
    rows = b"\xdd" + (MAX_SERVER_ITEMS + 1).to_bytes(4) + b"\x90" * (MAX_SERVER_ITEMS + 1)
    nothing = b"\x82\xa4type\xa5other\xa4rows" + rows

    def answers(message: dict[str, Any]) -> list[bytes]:
        found = [msgpack.packb(one) for one in honest(message)]
        return [*found, nothing] if message["type"] == "join" else found

    counts, errors = await load_test(answers)
    assert errors == []
    assert counts["invalid messages"] >= 2
