"""Text views of players in real time: the newest one, at most ten times a second."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from robotouille.episode import Clock, Rules
from robotouille.episode.record import EpisodeRecord
from robotouille.world.world import World
from robotouille_server import Server
from robotouille_server.rooms.publishing.audience import DELIVERY_SECONDS
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

SEATS = ["robot1", "robot2"]


async def begun(player: Raw, view: str, rate: float, **options: Any) -> str:
    """Take all seats of a real-time game; return its code."""
    create = {"type": "create", "task": "multi_agent/01", "clock": "realtime"}
    answer = await player.ask({**create, "step_rate": rate, **options}, "created")
    code: str = answer["code"]
    await player.ask({"type": "join", "episode": code, "seats": "all", "view": view}, "joined")
    return code


async def received(player: Raw, seconds: float) -> list[dict[str, Any]]:
    """Return the messages that arrive within some time."""
    got = []
    try:
        async with asyncio.timeout(seconds):
            while True:
                got.append(await player.receive())
    except TimeoutError:
        return got


def shown(got: list[dict[str, Any]]) -> list[tuple[int, str]]:
    return [(m["step"], m["seat"]) for m in got if m["type"] == "observation"]


def step_of(server: Server, code: str) -> int:
    step: int = server.lobby.find(code).episode.step
    return step


@virtual
async def test_fast_games_show_the_newest_state_ten_times_a_second(tmp_path: Path) -> None:
    async with serving(tmp_path, countdown=0.0) as server, raw(server) as ada:
        code = await begun(ada, "both", rate=60)
        await received(ada, 1.0)
        before = step_of(server, code)
        got = await received(ada, 2.0)
        views = shown(got)
        assert len(views) <= (2.0 / DELIVERY_SECONDS + 1) * len(SEATS)
        assert len(views) >= 0.8 * (2.0 / DELIVERY_SECONDS) * len(SEATS)
        # All seats are shown in the same state, and none is older than the last delta.
        assert [seat for _, seat in views] == SEATS * (len(views) // len(SEATS))
        assert [step for step, _ in views[::2]] == [step for step, _ in views[1::2]]
        last = before
        for message in got:
            if message["type"] == "delta":
                last = message["step"]
            elif message["type"] == "observation":
                assert message["step"] == last


@virtual
async def test_slow_games_show_each_step(tmp_path: Path) -> None:
    async with serving(tmp_path, countdown=0.0) as server, raw(server) as ada:
        await begun(ada, "text", rate=5)
        await received(ada, 1.05)
        views = [step for step, seat in shown(await received(ada, 4.0)) if seat == "robot1"]
        assert views == list(range(views[0], views[0] + 20))


@virtual
async def test_last_state_comes_before_the_end(tmp_path: Path) -> None:
    async with serving(tmp_path, countdown=0.0) as server, raw(server) as ada:
        await begun(ada, "text", rate=60, max_steps=100)
        got = await received(ada, 5.0)
        last = [m["type"] for m in got].index("ended")
        assert shown(got[:last])[-2:] == [(100, seat) for seat in SEATS]
        assert got[last - 1]["phase"] == "ended"
        assert not shown(got[last:])


def test_players_who_see_no_change_share_the_work() -> None:
    world = World("multi_agent/10")
    record = EpisodeRecord(world, Rules(clock=Clock.REALTIME, sight=2, sight_blocked=True))
    assert record.sight is not None
    sight, players = record.sight, (world.players[0],)
    before = record.seen(world.initial, players, sight)
    still = world.initial.step([]).state
    for state in (still, still.step([]).state):
        assert record.seen(state, players, sight) is before
    act = next(a for a in before.actions if a in world.initial.actions(players[0]))
    assert record.seen(world.initial.step(act).state, players, sight) is not before
