"""The same episode takes the same course, hash for hash, alone or beside a hundred others."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille_client import Changed, Client, connect
from robotouille_client.bots import RandomPolicy
from robotouille_server import Server
from tests.support.samples import first_quickly
from tests.support.servers import serving
from tests.support.virtual_time import run

STEPS = 40


async def follow(client: Client, code: str, seed: int) -> list[str]:
    """Play a seat at random; the hash of every state."""
    game = await client.join(code)
    assert game.seat is not None
    policy = RandomPolicy(game.seat, seed)
    hashes: list[str] = []
    decided = -1
    while not game.ended:
        for event in game.poll():
            if isinstance(event, Changed):
                hashes.append(event.state.digest)
        if game.ended:
            break
        if game.my_move and decided < game.step:
            decided = game.step
            game.submit(policy.act(game.state))
        else:
            event = await game.next_event()
            if isinstance(event, Changed):
                hashes.append(event.state.digest)
    return hashes


async def one_episode(server: Server, task: str, clock: str, seed: int) -> list[list[str]]:
    async with connect(server.url, name="host") as host:
        created = await host.create(task, clock=clock, max_steps=STEPS)
    seats = 1 if task.startswith(("s", "a")) else 2

    async def seat(number: int) -> list[str]:
        async with connect(server.url, name=f"bot{number}") as client:
            await asyncio.sleep(0.01 * number)
            return await follow(client, created.code, seed + number)

    return list(await asyncio.gather(*(seat(i) for i in range(seats))))


@pytest.mark.parametrize("neighbours", [10, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("task", "clock"),
    first_quickly([("multi_agent/10@2", "lockstep"), ("asynchronous/06", "realtime")]),
)
def test_neighbours_change_nothing(tmp_path: Path, task: str, clock: str, neighbours: int) -> None:
    async def main(folder: Path, neighbours: int) -> list[list[str]]:
        async with serving(folder, messages_per_second=10_000) as server:
            others = [
                asyncio.create_task(
                    one_episode(
                        server, ("asynchronous/06", "synchronous/02")[i % 2], clock, 1000 + i
                    )
                )
                for i in range(neighbours)
            ]
            if others:
                await asyncio.sleep(0.05)
            course = await one_episode(server, task, clock, 7)
            for other in others:
                other.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            return course

    alone = run(main(tmp_path / "alone", 0))
    crowded = run(main(tmp_path / "crowded", neighbours))
    assert [len(hashes) > STEPS // 2 for hashes in alone] == [True] * len(alone)
    assert [hashes[-STEPS:] for hashes in crowded] == [hashes[-STEPS:] for hashes in alone]
