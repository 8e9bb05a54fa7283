"""Planner bots in teams: steps by the certified plan, and with a person who stands still.

    python -m benchmarks.teams                            # all multi-agent tasks, 2, 3 and 4 bots
    python -m benchmarks.teams --idle                     # each seat in turn stands still
    python -m benchmarks.teams --network --clock realtime --seats 2 -- 01 04

In process the bots are told what they are told over the network, in its order, and think in plain
Python; with `--network` each is a `robotouille-bot planner` of its own, on a `robotouille-server`.
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
from robotouille.planning.search.unsolvable import CutOff

LIMIT = 200
NUMBERS = [f"{number:02d}" for number in range(1, 11)]


def together(name: str, clock: Clock) -> dict[str, Any]:
    """The outcome of a game of planner bots in this process."""
    outcome = play_team(name, clock=clock, limit=LIMIT).outcome
    return outcome.to_json() if outcome is not None else {}


def over_network(name: str, clock: Clock) -> dict[str, Any]:
    """The outcome of such a game of bots that are processes of their own, on a server."""
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
    parser.add_argument("tasks", nargs="*", default=NUMBERS, help="01 to 10; all if left out")
    parser.add_argument("--seats", type=int, nargs="+", default=[2, 3, 4])
    parser.add_argument("--clock", type=Clock, default=Clock.LOCKSTEP)
    parser.add_argument("--idle", action="store_true", help="with a person who stands still")
    parser.add_argument("--network", action="store_true", help="as processes on a server")
    options = parser.parse_args(arguments)
    for number in options.tasks:
        for seats in options.seats:
            name = f"multi_agent/{number}@{seats}"
            if options.idle:
                with_idle(name, options.clock)
            else:
                tell(name, options.clock, options.network)


def tell(name: str, clock: Clock, network: bool) -> None:
    """Play one task, and print how many steps that took."""
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
    """Play one task with each seat in turn a person who stands still, and print what came of it."""
    world = World(load_task(name))
    for idle in world.players:
        if CutOff(world)(world.initial, set(world.players) - {idle}):
            print(f"{name:18} {idle} stands: there is no way, which is proven", flush=True)
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
