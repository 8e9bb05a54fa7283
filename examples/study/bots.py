"""Play the episodes that `robotouille episodes open --tokens` has opened, with two bots in each.

    python examples/study/bots.py opened.csv [--url URL] [--at-once 5]

The first bot plays its part of a plan. The second bot does the same (label `condition`: expert) or
acts at random (novice). If the label `line` is `breaks`, the second bot disconnects during the
episode and returns. Afterwards, experts use the planner, because the plan no longer fits the state.
"""

from __future__ import annotations

import argparse
import asyncio
import csv
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from robotouille.installation import data_folder
from robotouille_client import Game, connect
from robotouille_client.bots import play
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.seat_policy import MakePolicy

LEAVES_AT = 15
"""Step in which the second bot disconnects."""
AWAY_SECONDS = 1.0
LOOK_SECONDS = 0.05
PLAYERS = ("robot1", "robot2")
GOES = "robot2"
"""Seat of the bot that disconnects."""
PLAN = data_folder("problems") / "multi_agent/01_lettuce_burger@2.plan"

Row = Mapping[str, str]


async def play_seat(url: str, row: Row, player: str, seed: int) -> None:
    """Play one seat to the end of its episode."""
    novice = row["label.condition"] == "novice"
    breaks = row["label.line"] == "breaks"
    kind = BotKind.RANDOM if novice and player == GOES else BotKind.SCRIPTED
    before = after = policy_maker(kind, seed, PLAN)
    if breaks and not novice:
        after = policy_maker(BotKind.PLANNER)
    name, token = f"{row['label.pair']}-{player}", row[f"token.{player}"]
    resume = None
    if breaks and player == GOES:
        async with connect(url, name=name, kind="bot", token=token) as client:
            game = await client.join(row["code"], seat=player)
            game.say("hello")
            await play_until(game, before, lambda: game.step >= LEAVES_AT)
            resume = client.resume
        await asyncio.sleep(AWAY_SECONDS)
    async with connect(url, name=name, kind="bot", token=token, resume=resume) as client:
        game = await client.join(row["code"], seat=player)
        game.say("hello" if resume is None else "I am back")
        if breaks and player != GOES:
            await play_until(game, before, came_back(game))
        await play(game, after)


def came_back(game: Game) -> Callable[[], bool]:
    """Return a function that tests whether the second bot has left and returned."""
    away = False

    def there_again() -> bool:
        nonlocal away
        there = any(seat.player == GOES and seat.present for seat in game.seats)
        away = away or (game.step >= LEAVES_AT and not there)
        return away and there

    return there_again


async def play_until(game: Game, bot: MakePolicy, over: Callable[[], bool]) -> None:
    """Play until `over` returns true or the episode ends."""
    playing = asyncio.create_task(play(game, bot))
    while not (over() or playing.done()):
        await asyncio.wait([playing], timeout=LOOK_SECONDS)
    playing.cancel()
    with suppress(asyncio.CancelledError):
        await playing


async def play_all(url: str, rows: list[Row], at_once: int) -> None:
    """Play all episodes, at most `at_once` at the same time."""
    free = asyncio.Semaphore(at_once)

    async def episode(number: int, row: Row) -> None:
        async with free, asyncio.TaskGroup() as group:
            for player in PLAYERS:
                group.create_task(play_seat(url, row, player, number))
        print(f"{row['code']} {row['label.pair']} {row['label.condition']}: ended", flush=True)

    async with asyncio.TaskGroup() as group:
        for number, row in enumerate(rows, 1):
            group.create_task(episode(number, row))


def main() -> None:
    parser = argparse.ArgumentParser(description="Play the episodes of a study with bots.")
    parser.add_argument("opened", type=Path, help="CSV file written by `robotouille episodes open`")
    parser.add_argument("--url", default="ws://127.0.0.1:8765", help="URL of the server")
    parser.add_argument("--at-once", type=int, default=5, help="episodes to play at the same time")
    given = parser.parse_args()
    with given.opened.open(encoding="utf-8", newline="") as file:
        rows: list[Row] = list(csv.DictReader(file))
    asyncio.run(play_all(given.url, rows, given.at_once))


if __name__ == "__main__":
    main()
