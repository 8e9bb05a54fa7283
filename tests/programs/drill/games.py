"""The drill's episodes: task, clock, absence policy and bots, drawn from a seed."""

from __future__ import annotations

import random
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from robotouille.installation import data_folder
from robotouille_client.bots.kinds import BotKind

__all__ = ["GameSpec", "draw_game", "plan_of"]

ALONE = (
    "training/01_synchronous",
    "synchronous/01_cheese_sandwich",
    "synchronous/02_lettuce_sandwich",
    "synchronous/04_hamburger",
    "asynchronous/01_cheese_chicken_sandwich",
    "asynchronous/06_potato_soup",
)
TOGETHER = (
    "training/03_multi_agent",
    "multi_agent/01_lettuce_burger",
    "multi_agent/02_lettuce_tomato_burger",
    "multi_agent/04_lettuce_chicken_sandwich",
)
CLOCKS = ("turn", "lockstep", "realtime")
ABSENCES = ("wait", "wait", "pause", "bot", "bot", "end")


@dataclass(frozen=True, slots=True)
class GameSpec:
    """One episode: the fields of its `create` message, and a bot for each seat.

    `think` is a bot's time per move in seconds. `flaky` lists the seats whose connections break at
    times by themselves.
    """

    task: str
    seats: int
    clock: str
    absence: str
    substitute: str
    step_rate: float
    max_steps: int
    bots: tuple[str, ...]
    think: float
    flaky: tuple[bool, ...]
    seed: int

    @property
    def options(self) -> dict[str, Any]:
        """Return the fields of the `create` message except the task."""
        names = ("seats", "clock", "absence", "substitute", "step_rate", "max_steps")
        return {name: value for name, value in asdict(self).items() if name in names}


def draw_game(seed: int, slot: int, number: int, *, steps: tuple[int, int]) -> GameSpec:
    """Draw the `number`th episode of a slot; `steps` bounds its step limit."""
    chance = random.Random(f"{seed}:{slot}:{number}")
    seats = chance.choice((1, 2, 2))
    task = chance.choice(ALONE if seats == 1 else TOGETHER)
    kind = chance.choice((BotKind.RANDOM, BotKind.RANDOM, BotKind.SCRIPTED, BotKind.PLANNER))
    return GameSpec(
        task=task,
        seats=seats,
        clock=CLOCKS[(slot + number) % len(CLOCKS)],
        absence=chance.choice(ABSENCES),
        substitute=chance.choice(("random", "planner")),
        step_rate=chance.choice((4.0, 5.0, 8.0)),
        max_steps=chance.randint(*steps),
        bots=(kind.value,) * seats,
        think=chance.choice((0.05, 0.15, 0.3)),
        flaky=tuple(chance.random() < 0.15 for _ in range(seats)),
        seed=chance.getrandbits(31),
    )


def plan_of(spec: GameSpec) -> Path | None:
    """Return the plan file that a scripted bot follows, or None."""
    folder = data_folder("problems")
    for name in (f"{spec.task}@{spec.seats}.plan", f"{spec.task}.plan"):
        if (folder / name).is_file():
            return folder / name
    return None
