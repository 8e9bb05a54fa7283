"""Rewrite the golden files: run `python -m tests.world.regenerate` and review the difference.

A change of `*.txt` changes what agents read, one of `digests.json` breaks old recordings, and
one of `perft.json` (how many states can be reached in exactly n steps) changes the world itself.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import product
from pathlib import Path

from robotouille import State, World, load_task
from tests.world.kitchens import STATES, full_pot

__all__ = ["GOLDEN", "PERFT_FILE", "golden_files", "perft"]

GOLDEN = Path(__file__).with_name("golden")
PERFT_FILE = "perft.json"

PERFT = {
    "synchronous/01": 10,
    "synchronous/04": 7,
    "asynchronous/01": 8,
    "asynchronous/06": 12,
    "workshop/01": 9,
    "multi_agent/01@2": 3,
    "workshop/02": 3,
}


def golden_files() -> dict[str, Callable[[], str]]:
    """Return a function for the content of each golden file."""
    return {
        "synchronous_01.txt": lambda: text("synchronous/01"),
        "asynchronous_06_full_pot.txt": lambda: full_pot().text() + "\n",
        "multi_agent_01_robot2.txt": lambda: text("multi_agent/01", "robot2"),
        "workshop_02.txt": lambda: text("workshop/02"),
        "digests.json": lambda: pretty({name: make().digest for name, make in STATES.items()}),
        PERFT_FILE: lambda: pretty({name: perft(name, depth) for name, depth in PERFT.items()}),
    }


def text(name: str, player: str | None = None) -> str:
    return World(load_task(name)).initial.text(player) + "\n"


def pretty(value: object) -> str:
    return json.dumps(value, indent=1) + "\n"


def perft(name: str, depth: int) -> list[int]:
    """Count the states reachable in exactly 0, 1, … steps in which every player acts."""
    states = {World(load_task(name)).initial}
    counts = [1]
    for _ in range(depth):
        states = {after for state in states for after in successors(state)}
        counts.append(len(states))
    return counts


def successors(state: State) -> set[State]:
    choices = [state.actions(player) for player in state.world.players]
    return {state.step(joint).state for joint in product(*choices)}


if __name__ == "__main__":
    GOLDEN.mkdir(exist_ok=True)
    for file, content in golden_files().items():
        (GOLDEN / file).write_text(content(), encoding="utf-8")
