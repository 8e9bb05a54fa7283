"""Play the episodes that `robotouille episodes open --tokens` has opened, with two bots in each.

    python examples/study/bots.py opened.csv [--url URL] [--at-once 2]

The first bot plays its part of a plan. The second bot does the same (label `condition`: expert) or
acts at random (novice). If the label `line` is `breaks`, the second bot disconnects during the
episode and returns. Experts then use the planner, because the plan no longer fits the state.

All bots share this process. With more episodes at once than the machine has cores, planners decide
too late for the clock, and experts may not reach the goal.
"""

from __future__ import annotations

import argparse
import asyncio
import csv
import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

# Compiling the planner takes half a minute, during which all bots would do nothing. The variable
# must be set before the import.
os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")

from robotouille import ProtocolError, RobotouilleError, World
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
LABELS = ("label.pair", "label.condition", "label.line")
OPENED = ("code", *(f"token.{player}" for player in PLAYERS))
"""Columns that opening the episodes adds."""
OPEN = "robotouille episodes open examples/study/pairs.csv --out opened.csv --tokens"
PLAN = data_folder("problems") / "multi_agent/01_lettuce_burger@2.plan"

Row = Mapping[str, str]
Outcome = Mapping[str, Any]


def read_rows(path: Path) -> list[Row]:
    """Read the episodes that `robotouille episodes open --tokens` has written.

    Raises:
        RobotouilleError: The file is unreadable, or has no episodes or not all columns.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows: list[Row] = list(csv.DictReader(file))
    except OSError as error:
        raise RobotouilleError(f"{path}: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise RobotouilleError(f"{path}: not a CSV file: {error}") from None
    if not rows:
        raise RobotouilleError(f"{path}: no episodes")
    for column in (*LABELS, *OPENED):
        if column not in rows[0]:
            cure = f"; open it first: {OPEN}" if column in OPENED else ""
            raise RobotouilleError(f"{path}: no column {column!r}{cure}")
    return rows


def warm_up(row: Row) -> None:
    """Plan once, because the first plan also loads the planner."""
    start = World(row["task"]).initial
    policy_maker(BotKind.PLANNER)(start, PLAYERS[0]).act(start)


async def play_seat(url: str, row: Row, player: str, seed: int) -> Outcome:
    """Play one seat to the end of its episode, and return the outcome."""
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
            # A planner hears the version of a partner only once, so it must start before the
            # partner returns. Otherwise each plans alone, and both may wait for each other.
            await play_until(game, before, lambda: game.step >= LEAVES_AT and is_away(game))
        return await play(game, after)


def is_away(game: Game) -> bool:
    """Return whether the bot that disconnects is disconnected."""
    return any(seat.player == GOES and not seat.present for seat in game.seats)


async def play_until(game: Game, bot: MakePolicy, over: Callable[[], bool]) -> None:
    """Play until `over` returns true or the episode ends."""
    playing = asyncio.create_task(play(game, bot))
    while not (over() or playing.done()):
        await asyncio.wait([playing], timeout=LOOK_SECONDS)
    playing.cancel()
    with suppress(asyncio.CancelledError):
        await playing


async def play_episode(url: str, row: Row, seed: int) -> None:
    """Play both seats of an episode, and print how it ended.

    Raises:
        ExceptionGroup: One `RobotouilleError` for each seat that could not play.
    """
    async with asyncio.TaskGroup() as group:
        seats = [group.create_task(play_seat(url, row, each, seed)) for each in PLAYERS]
    outcome = seats[0].result()
    ending = f"{outcome['reason']} in {outcome['steps']} steps" if outcome else "connection lost"
    print(f"{row['code']} {row['label.pair']} {row['label.condition']}: {ending}", flush=True)


async def play_all(url: str, rows: list[Row], at_once: int) -> None:
    """Play all episodes, at most `at_once` at the same time. Stop at the first error."""
    free = asyncio.Semaphore(at_once)

    async def in_turn(number: int, row: Row) -> None:
        async with free:
            await play_episode(url, row, number)

    async with asyncio.TaskGroup() as group:
        for number, row in enumerate(rows, 1):
            group.create_task(in_turn(number, row))


def explain(error: BaseException) -> str:
    """Return the message of an error, or of the first error of a group."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    if isinstance(error, ProtocolError) and error.code in ("episode/ended", "episode/unknown"):
        return f"{error.message}. To play the study again, open new episodes: {OPEN}"
    return str(error)


def main() -> None:
    parser = argparse.ArgumentParser(description="Play the episodes of a study with bots.")
    parser.add_argument("opened", type=Path, help="CSV file written by `robotouille episodes open`")
    parser.add_argument("--url", default="ws://127.0.0.1:8765", help="URL of the server")
    parser.add_argument("--at-once", type=int, default=2, help="episodes to play at the same time")
    given = parser.parse_args()
    if given.at_once < 1:
        parser.error("--at-once must be at least 1")
    status: str | int = 0
    try:
        rows = read_rows(given.opened)
        warm_up(rows[0])
        asyncio.run(play_all(given.url, rows, given.at_once))
    except* RobotouilleError as errors:
        status = explain(errors)
    except* KeyboardInterrupt:
        status = 130
    sys.exit(status)


if __name__ == "__main__":
    main()
