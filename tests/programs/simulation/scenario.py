"""The scenario of a seed: participants, episodes, connections and faults."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from robotouille.protocol.messages import View
from tests.programs.simulation.oracle import EpisodeTruth
from tests.programs.simulation.transport import Conditions

if TYPE_CHECKING:
    from tests.programs.simulation.simulation import Simulation

__all__ = [
    "FAULTS",
    "DrawPlan",
    "Enlisted",
    "EpisodePlan",
    "Scenario",
    "draw",
    "draw_conditions",
    "draw_plan",
    "draw_settings",
]

TASKS = (
    ("training/01_synchronous", 1),
    ("training/02_asynchronous", 1),
    ("training/03_multi_agent@2", 2),
    ("multi_agent/01_lettuce_burger", 2),
    ("multi_agent/02", 2),
    ("training/03_multi_agent@3", 3),
    ("shifts/06_rush_hour@2", 2),
)

FAULTS = (
    "cut",
    "cut_one_side",
    "stall",
    "refuse",
    "freeze_client",
    "kill_client",
    "lose_machine",
    "take_over",
    "freeze_server",
    "crash",
    "crash_in_write",
    "fill_disk",
    "hand_over",
    "mangle",
    "flood",
)
"""Kinds of faults; each seed uses some of them."""


@dataclass(frozen=True)
class Enlisted:
    """A participant of an episode."""

    name: str
    role: Literal["player", "spectator"]
    creates: bool
    view: View
    encoding: str
    talks: float
    """Chat messages per second."""
    seats: Literal["all"] | tuple[str, ...] = ()
    """Seats to play over one connection; any free seat if empty."""


@dataclass
class EpisodePlan:
    """An episode to play, and what is known about it so far."""

    sim: Simulation
    tag: str
    task: str
    options: dict[str, Any]
    people: list[Enlisted] = field(default_factory=list)
    code: str | None = None

    @property
    def truth(self) -> EpisodeTruth | None:
        """Return the episode's recording."""
        return self.sim.oracle.of_code(self.code) if self.code else None

    @property
    def over(self) -> bool:
        """Return whether the recording contains the episode's end."""
        truth = self.truth
        return truth is not None and truth.over

    @property
    def begun(self) -> bool:
        truth = self.truth
        return truth is not None and truth.begun

    def entered(self, who: str, episode: str) -> None:
        """Record that a participant is in an episode, which must belong to this plan."""
        owner = self.sim.owners.setdefault(episode, self)
        if owner is not self:
            self.sim.fail(f"{who}: is in {episode}, an episode of {owner.tag}, not {self.tag}")

    def vanished(self) -> bool:
        """Handle a server that does not know the episode, which must have ended."""
        if self.over:
            return True
        if self.code is not None:
            self.sim.fail(f"{self.tag}: the server has forgotten {self.code}")
        return False

    def owns(self, text: str) -> bool:
        """Return whether a chat message was sent in this episode."""
        return text.startswith(f"{self.tag}/")

    def knows(self, name: str) -> bool:
        """Return whether a participant here has this name, possibly with a number.

        A participant who joins again while the old seat is kept gets a number.
        """
        plain = re.sub(r" [0-9]+$", "", name)
        return any(person.name == plain for person in self.people)

    def seats_of(self, name: str) -> int:
        """Return the largest number of seats for the participant with this name."""
        plain = re.sub(r" [0-9]+$", "", name)
        seats = next((person.seats for person in self.people if person.name == plain), ())
        return 16 if seats == "all" else max(1, len(seats))


DrawPlan = Callable[["Simulation", random.Random], EpisodePlan]


@dataclass
class Scenario:
    """Everything that is drawn before a run starts.

    `settings` are those of the server. `faults` holds the weights of the kinds of faults. A fault
    occurs every `pause` seconds on average, for `trouble` seconds. `patient_close` selects the
    closing behaviour of asyncio servers in Python 3.12 and later.
    """

    conditions: Conditions
    settings: dict[str, Any]
    faults: dict[str, float]
    pause: float
    trouble: float
    patient_close: bool
    plans: list[DrawPlan] = field(default_factory=list)


def draw(chance: random.Random) -> Scenario:
    """Draw the scenario of a seed."""
    kinds = chance.sample(FAULTS, chance.randint(1, len(FAULTS)))
    return Scenario(
        conditions=draw_conditions(chance),
        settings=draw_settings(chance),
        faults={kind: chance.random() + 0.1 for kind in kinds},
        pause=10 ** chance.uniform(-1, 0.5),
        trouble=chance.uniform(3, 25),
        patient_close=chance.random() < 0.5,
        plans=[partial(draw_plan, f"e{n}") for n in range(chance.choice((1, 1, 2, 3)))],
    )


def draw_conditions(chance: random.Random) -> Conditions:
    latency = 10 ** chance.uniform(-3, -0.7)
    return Conditions(
        latency=latency,
        jitter=latency * chance.choice((0.0, 0.5, 3.0)),
        window=int(10 ** chance.uniform(3, 5.3)),
    )


def draw_settings(chance: random.Random) -> dict[str, Any]:
    return {
        "grace": chance.choice((2.0, 10.0, 30.0)),
        "stall_seconds": chance.choice((3.0, 15.0)),
        "hello_seconds": chance.choice((3.0, 10.0)),
        "recovery_seconds": chance.choice((1.0, 10.0)),
    }


def draw_plan(
    tag: str, sim: Simulation, chance: random.Random, max_steps: int | None = None
) -> EpisodePlan:
    """Draw an episode: its task, its rules and its participants."""
    task, seats = chance.choice(TASKS)
    options: dict[str, Any] = {
        "clock": chance.choice(("turn", "lockstep", "realtime")),
        "max_steps": max_steps or int(10 ** chance.uniform(0.7, 1.6)),
        "seed": chance.randrange(3),
        "absence": chance.choice(("wait", "wait", "pause", "bot", "end")),
        "substitute": chance.choice(("random", "random", "random", "planner")),
        "grace": chance.choice((2.0, 10.0, 30.0)),
    }
    if options["clock"] == "realtime":
        options["step_rate"] = chance.choice((2.0, 5.0, 10.0))
        options["thinking"] = chance.choice(("wall", "wall", "declared"))
    elif chance.random() < 0.3:
        options["move_budget"] = chance.choice((0.5, 3.0))
    watchers = chance.choice((0, 0, 1, 2))
    people = [_enlist(f"{tag}-{n}", chance, n, seats) for n in range(seats + watchers)]
    shares = _shares(random.Random(f"{sim.seed}/{tag}/seats"), seats)
    players = [replace(player, seats=share) for player, share in zip(people, shares, strict=False)]
    return EpisodePlan(sim, tag, task, options, players + people[seats:])


def _shares(chance: random.Random, seats: int) -> list[Literal["all"] | tuple[str, ...]]:
    """Draw the seats of each participant: one free seat each, or several for one participant."""
    if seats == 1 or chance.random() < 0.6:
        return [()] * seats
    if chance.random() < 0.4:
        return ["all"]
    players = [f"robot{number + 1}" for number in range(seats)]
    several = sorted(chance.sample(players, 2))
    others = [player for player in players if player not in several]
    return [tuple(several), *((player,) for player in others)]


def _enlist(name: str, chance: random.Random, number: int, seats: int) -> Enlisted:
    return Enlisted(
        name=name,
        role="player" if number < seats else "spectator",
        creates=number == 0,
        view=chance.choice(("state", "state", "state", "both", "text")),
        encoding=chance.choice(("msgpack", "json")),
        talks=chance.choice((0.0, 0.3, 2.0)),
    )
