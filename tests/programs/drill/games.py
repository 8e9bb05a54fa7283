"""The drill's episodes: task, clock, absence policy and bots, drawn from a seed."""

from __future__ import annotations

import random
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from robotouille.installation import data_folder
from robotouille_client.bots.kinds import BotKind

__all__ = ["MIXES", "GameSpec", "Mix", "draw_game", "mix_of", "plan_of"]

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


@dataclass(frozen=True, slots=True)
class Mix:
    """The kinds of episodes of a drill. `flaky` is the share of seats whose connections break."""

    seats: tuple[int, ...] = (1, 2, 2)
    clocks: tuple[str, ...] = ("turn", "lockstep", "realtime")
    absences: tuple[str, ...] = ("wait", "wait", "pause", "bot", "bot", "end")
    bots: tuple[BotKind, ...] = (
        BotKind.RANDOM, BotKind.RANDOM, BotKind.SCRIPTED, BotKind.PLANNER,
    )  # fmt: skip
    rates: tuple[float, ...] = (4.0, 5.0, 8.0)
    thinks: tuple[float, ...] = (0.05, 0.15, 0.3)
    flaky: float = 0.15


# Random bots never stop acting, so a seat without an applied action is the server's fault.
STEADY = Mix(
    seats=(2,), clocks=("realtime",), absences=("wait",), bots=(BotKind.RANDOM,), rates=(5.0,),
    thinks=(0.05,), flaky=0.0,
)  # fmt: skip
MIXES = {
    "all": Mix(),
    "steady": STEADY,
    "random": replace(
        STEADY, seats=(1, 2, 2), clocks=("realtime", "realtime", "turn", "lockstep"),
        absences=("wait", "bot"),
    ),
}  # fmt: skip


def mix_of(name: str, rate: float = 0.0) -> Mix:
    """Return a mix of episodes; `rate` is the number of steps per second if it is not 0."""
    mix = MIXES[name]
    return replace(mix, rates=(rate,), thinks=(0.5 / rate,)) if rate else mix


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


def draw_game(
    seed: int, slot: int, number: int, *, steps: tuple[int, int], mix: Mix | None = None
) -> GameSpec:
    """Draw the `number`th episode of a slot; `steps` bounds its step limit."""
    mix = mix or MIXES["all"]
    chance = random.Random(f"{seed}:{slot}:{number}")
    seats = chance.choice(mix.seats)
    task = chance.choice(ALONE if seats == 1 else TOGETHER)
    kind = chance.choice(mix.bots)
    return GameSpec(
        task=task,
        seats=seats,
        clock=mix.clocks[(slot + number) % len(mix.clocks)],
        absence=chance.choice(mix.absences),
        substitute=chance.choice(("random", "planner")),
        step_rate=chance.choice(mix.rates),
        max_steps=chance.randint(*steps),
        bots=(kind.value,) * seats,
        think=chance.choice(mix.thinks),
        flaky=tuple(chance.random() < mix.flaky for _ in range(seats)),
        seed=chance.getrandbits(31),
    )


def plan_of(spec: GameSpec) -> Path | None:
    """Return the plan file that a scripted bot follows, or None."""
    folder = data_folder("problems")
    for name in (f"{spec.task}@{spec.seats}.plan", f"{spec.task}.plan"):
        if (folder / name).is_file():
            return folder / name
    return None
