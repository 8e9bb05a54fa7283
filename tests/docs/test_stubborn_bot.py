"""The bot of docs/protocol.md that comes back does so, whatever happens to its connection."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotouille.replay.recording import read_recording
from robotouille_client import connect
from robotouille_server import Server
from robotouille_server.rooms.room import Room
from tests.support.pages import titled
from tests.support.samples import quick_sample_of_pairs
from tests.support.servers import crash, serving
from tests.support.virtual_time import run

STEPS = 120


class Dice(random.Random):
    """Tells when it has been thrown so and so often: a bot does so for each action."""

    def __init__(self) -> None:
        super().__init__(7)
        self._left = 0
        self._thrown = asyncio.Event()

    def choice(self, seq: Any) -> Any:
        self._left -= 1
        if self._left == 0:
            self._thrown.set()
        return super().choice(seq)

    async def thrown(self, times: int) -> None:
        """Wait for so many more throws."""
        self._left = times
        self._thrown.clear()
        await self._thrown.wait()


def bot_of_the_page(dice: Dice) -> Any:
    source = titled("protocol.md", "stubborn_bot.py")
    assert "robotouille" not in source.replace("robotouille.v1.json", "")
    names: dict[str, Any] = {"__name__": "stubborn_bot"}
    exec(compile(source, "stubborn_bot.py", "exec"), names)
    names["random"] = dice
    return names["Bot"]


def the_room(server: Server) -> Room:
    (room,) = server.lobby.rooms.values()
    return room


async def cut(server: Server) -> None:
    """All lines are lost at once."""
    for member in the_room(server).members:
        assert member.peer is not None
        member.peer.socket.transport.abort()


async def restart(server: Server) -> None:
    await server.stop("the server is restarted", hand_over=True)


@pytest.mark.parametrize(
    ("mode", "calamity"),
    quick_sample_of_pairs(["realtime", "lockstep", "turn"], [cut, crash, restart], 1),
)
def test_it_comes_back(
    tmp_path: Path, mode: str, calamity: Callable[[Server], Awaitable[None]]
) -> None:
    async def game() -> tuple[list[dict[str, Any]], int]:
        dice, came_back = Dice(), 0
        bot = bot_of_the_page(dice)
        options: dict[str, Any] = {"mode": mode, "max_steps": STEPS, "absence": "pause"}
        async with AsyncExitStack() as stack:
            server = await stack.enter_async_context(serving(tmp_path, **options))
            options["port"] = server.port
            async with connect(server.url, name="host") as host:
                code = (await host.create("multi_agent/01@2")).code
            bots = asyncio.gather(*(bot(code, f"bot {i}").play(server.url) for i in range(2)))
            for seed in (2, 3):
                await dice.thrown(10)
                await calamity(server)
                if calamity is not cut:
                    again = serving(tmp_path, seed=seed, **options)
                    server = await stack.enter_async_context(again)
                await dice.thrown(10)
                came_back += sum(member.generation > 0 for member in the_room(server).members)
            return await bots, came_back

    outcomes, came_back = run(game())
    assert came_back == 4, "both, each time, with a resume token"
    for outcome in outcomes:
        assert (outcome["reason"], outcome["steps"]) == ("step_limit", STEPS)
        assert all(seat["acted"] > 10 for seat in outcome["seats"])
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    assert len(recording.participants) == 2


def test_it_stays_away_when_its_token_is_used_elsewhere(tmp_path: Path) -> None:
    async def game() -> dict[str, Any]:
        dice = Dice()
        bot = bot_of_the_page(dice)
        async with serving(tmp_path, mode="realtime", max_steps=1000) as server:
            async with connect(server.url, name="host") as host:
                code = (await host.create("multi_agent/01@2")).code
            first, second, other = (bot(code, name) for name in ("first", "second", "other"))
            playing = asyncio.create_task(first.play(server.url))
            beside = asyncio.create_task(other.play(server.url))
            await dice.thrown(10)
            second.resume = first.resume
            taking_over = asyncio.create_task(second.play(server.url))
            farewell: dict[str, Any] = await playing
            await dice.thrown(10)
            assert second.seq > first.seq
            for task in (taking_over, beside):
                task.cancel()
            return farewell

    farewell = run(game())
    assert (farewell["type"], farewell["code"]) == ("bye", "session/elsewhere")
