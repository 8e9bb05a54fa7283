"""Two bots for each episode that `robotouille episodes open --tokens` has opened.

    python examples/study/bots.py opened.csv [--url URL] [--at-once 5]

The first bot of an episode plays its part of a plan; the second does so, too, or does anything, as
the label `condition` says. In every second episode the second bot's line breaks in the middle, and
it comes back.
"""

from __future__ import annotations

import argparse
import asyncio
import csv
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from robotouille.resources import data_folder
from robotouille_client import Game, connect
from robotouille_client.bots import play
from robotouille_client.bots.kinds import BotKind, policy_maker

LEAVES_AT = 15
"""The step in which somebody's line breaks."""
AWAY_SECONDS = 1.0
LOOK_SECONDS = 0.05
PLAYERS = ("robot1", "robot2")
PLAN = data_folder("problems") / "multi_agent/01_lettuce_burger@2.plan"

Row = Mapping[str, str]


async def play_seat(url: str, row: Row, player: str, seed: int, *, goes: bool) -> None:
    """A seat of an episode, to its end."""
    novice = player == "robot2" and row["label.condition"] == "novice"
    bot = policy_maker(BotKind.RANDOM if novice else BotKind.SCRIPTED, seed, PLAN)
    name, token = f"{row['label.pair']}-{player}", row[f"token.{player}"]
    resume = None
    if goes:
        async with connect(url, name=name, kind="bot", token=token) as client:
            game = await client.join(row["code"], seat=player)
            playing = asyncio.create_task(play(game, bot))
            await until(game, LEAVES_AT)
            playing.cancel()
            with suppress(asyncio.CancelledError):
                await playing
            resume = client.resume
        await asyncio.sleep(AWAY_SECONDS)
    async with connect(url, name=name, kind="bot", token=token, resume=resume) as client:
        game = await client.join(row["code"], seat=player)
        game.say("I am back" if goes else "hello")
        await play(game, bot)


async def until(game: Game, step: int) -> None:
    """Wait for a step, or for the end."""
    while not game.ended and game.step < step:  # noqa: ASYNC110
        await asyncio.sleep(LOOK_SECONDS)


async def play_all(url: str, rows: list[Row], at_once: int) -> None:
    """All episodes, some at a time."""
    free = asyncio.Semaphore(at_once)

    async def episode(number: int, row: Row) -> None:
        async with free, asyncio.TaskGroup() as group:
            for player in PLAYERS:
                goes = player == "robot2" and number % 2 == 0
                group.create_task(play_seat(url, row, player, number, goes=goes))
        print(f"{row['code']} {row['label.pair']} {row['label.condition']}: over", flush=True)

    async with asyncio.TaskGroup() as group:
        for number, row in enumerate(rows, 1):
            group.create_task(episode(number, row))


def main() -> None:
    parser = argparse.ArgumentParser(description="Bots for a study.")
    parser.add_argument("opened", type=Path, help="what `robotouille episodes open` has written")
    parser.add_argument("--url", default="ws://127.0.0.1:8765", help="the server")
    parser.add_argument("--at-once", type=int, default=5, help="episodes at a time")
    given = parser.parse_args()
    with given.opened.open(encoding="utf-8", newline="") as file:
        rows: list[Row] = list(csv.DictReader(file))
    asyncio.run(play_all(given.url, rows, given.at_once))


if __name__ == "__main__":
    main()
