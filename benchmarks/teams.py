"""Measure teams of planner bots against certified plans, and with a player who stands still.

    python -m benchmarks.teams                            # all multi-agent tasks, 2, 3 and 4 bots
    python -m benchmarks.teams --idle                     # each seat in turn stands still
    python -m benchmarks.teams --network --clock realtime --seats 2 -- 01 04

By default the bots run in this process in plain Python and receive the same events in the same
order as over the network. With `--network`, each bot is a `robotouille-bot planner` process that
connects to a `robotouille-server`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.support.processes import process, program
from tests.support.team_games import Idle, play_team

from robotouille import World, load_certificate, load_task
from robotouille.episode import Clock
from robotouille.planning.search.unsolvable import ReachabilityCheck

LIMIT = 200
NUMBERS = [f"{number:02d}" for number in range(1, 11)]


def together(name: str, clock: Clock) -> dict[str, Any]:
    """Play a game of planner bots in this process and return its outcome."""
    outcome = play_team(name, clock=clock, limit=LIMIT).outcome
    return outcome.to_json() if outcome is not None else {}


def over_network(name: str, clock: Clock) -> dict[str, Any]:
    """Play a game of planner bots in separate processes on a server and return its outcome."""
    flags = ["--mode", clock.value, "--timing", "benchmark", "--max-steps", str(LIMIT)]
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        compiled = {"ROBOTOUILLE_COMPILE": os.environ["ROBOTOUILLE_COMPILE"]}
        room = process(Path(folder), *flags, "--task", name, **compiled)
        _, url, code = stack.enter_context(room)
        options = ["planner", "--url", url, "--episode", code, "--json"]
        bots = [
            stack.enter_context(program("robotouille_client.bots.cli", *options, **compiled))
            for _ in range(load_task(name).seats)
        ]
        told = [bot.communicate()[0] for bot in bots]
    return json.loads(told[0])  # type: ignore[no-any-return]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("tasks", nargs="*", default=NUMBERS, help="01 to 10; default: all")
    parser.add_argument("--seats", type=int, nargs="+", default=[2, 3, 4])
    parser.add_argument("--clock", type=Clock, default=Clock.LOCKSTEP)
    parser.add_argument("--idle", action="store_true", help="with a player who stands still")
    parser.add_argument("--network", action="store_true", help="as separate processes on a server")
    options = parser.parse_args(arguments)
    for number in options.tasks:
        for seats in options.seats:
            name = f"multi_agent/{number}@{seats}"
            if options.idle:
                with_idle(name, options.clock)
            else:
                tell(name, options.clock, options.network)


def tell(name: str, clock: Clock, network: bool) -> None:
    """Play one task and print its number of steps."""
    length = load_certificate(load_task(name)).length or 0
    begun = time.perf_counter()
    outcome = over_network(name, clock) if network else together(name, clock)
    spent = time.perf_counter() - begun
    steps, rejected = outcome["steps"], sum(seat["rejected"] for seat in outcome["seats"])
    print(
        f"{name:18} {outcome['reason']:10} {steps:4} steps, certified {length:3}:"
        f" {steps / length:5.2f} ×, {rejected} rejected, {spent:.0f} s",
        flush=True,
    )


def with_idle(name: str, clock: Clock) -> None:
    """Play one task with each player in turn standing still, and print the outcomes."""
    world = World(load_task(name))
    for idle in world.players:
        if ReachabilityCheck(world)(world.initial, set(world.players) - {idle}):
            print(f"{name:18} {idle} stands: proven unsolvable", flush=True)
            continue
        begun = time.perf_counter()
        game = play_team(name, {idle: Idle(idle)}, clock=clock, limit=LIMIT)
        spent = time.perf_counter() - begun
        outcome = game.outcome
        asked = [text for _, _, text in game.said if text.startswith("I need")]
        if outcome is not None:
            print(
                f"{name:18} {idle} stands: {outcome.reason.value:10} {outcome.steps:4} steps,"
                f" {sum(t.rejected for t in outcome.seats)} rejected, {spent:.0f} s {asked[:1]}",
                flush=True,
            )


if __name__ == "__main__":
    main()
