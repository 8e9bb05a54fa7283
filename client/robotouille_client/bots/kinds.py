"""The shipped bots."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import Fault, FileError, MissingExtraError, RobotouilleError

if TYPE_CHECKING:
    from robotouille.domain.rendering import Language
    from robotouille.planning.policies.policy import Policy
    from robotouille.world.world import State
    from robotouille_client.bots.seat_policy import MakePolicy

NAMES = (
    "Ada", "Ben", "Cleo", "Dov", "Edda", "Finn", "Gus", "Hana", "Ivo", "June", "Kai", "Lou",
    "Mika", "Nora", "Otto", "Pia",
)  # fmt: skip
"""Short given names that are easy to tell apart."""


def given_names(seed: int = 0, seat: str | None = None) -> tuple[str, ...]:
    """Return all names in order of preference, which depends on the seed and the seat."""
    number = re.search(r"\d+$", seat or "")
    first = (seed + (int(number[0]) - 1 if number else 0)) % len(NAMES)
    return (*NAMES[first:], *NAMES[:first])


class BotKind(StrEnum):
    """The kind of a bot: random, following a plan file, or planning by search."""

    RANDOM = "random"
    SCRIPTED = "scripted"
    PLANNER = "planner"


class OfferedBot(StrEnum):
    """The bots offered to people: planners with a skill, or random bots."""

    PARTNER = "partner"
    LEARNER = "learner"
    EXPERT = "expert"
    RANDOM = "random"


@dataclass(frozen=True, slots=True)
class BotSetup:
    """The kind of some bots, their seed, and the skill of planners.

    Attributes:
        skill: Name of a skill, or empty for the one that fits the company: see `SkilledPolicy`.
        plan: Plan file of a scripted bot.
        words: Words that replace those of the domain in chat messages of planners.
    """

    kind: BotKind = BotKind.PLANNER
    seed: int = 0
    skill: str = ""
    plan: Path | None = None
    words: Language | None = None

    @classmethod
    def named(cls, name: str, seed: int = 0, words: Language | None = None) -> BotSetup:
        """Return the setup of a kind, or of a planner with a skill."""
        if name in list(BotKind):
            return cls(BotKind(name), seed, words=words)
        return cls(seed=seed, skill=name, words=words)

    @property
    def agent(self) -> str:
        """The setup in words, for recordings."""
        if self.kind is not BotKind.PLANNER:
            return f"{self.kind} seed={self.seed}"
        from robotouille.planning.policies.skill import skill_named

        skill = f"{self.skill} {skill_named(self.skill)}" if self.skill else "by company"
        return f"{self.kind} skill={skill.strip()} seed={self.seed}"


def bot_maker(setup: BotSetup, *, step_seconds: float = 0.0) -> MakePolicy:
    """Return a function that makes the policy of a seat. Planners share their analysis of the task.

    Args:
        step_seconds: Duration of a step in a real-time game; 0 in games that wait for players.

    Raises:
        RobotouilleError: A scripted bot has no plan file, or the skill is unknown.
    """
    if setup.kind is not BotKind.PLANNER:
        return policy_maker(setup.kind, setup.seed, setup.plan)
    from robotouille.planning.policies.skill import SkilledPolicy, skill_named

    skill = skill_named(setup.skill) if setup.skill else None
    plan = _planner_maker(setup.seed, setup.words, hurried=step_seconds > 0)

    def make(state: State, player: str) -> Policy:
        policy, seed = plan(state, player), setup.seed
        return SkilledPolicy(policy, player, skill, step_seconds=step_seconds, seed=seed)

    return make


def policy_maker(kind: BotKind, seed: int = 0, plan: Path | None = None) -> MakePolicy:
    """Return a function that makes the policy of a seat, with all the skill that it has.

    Raises:
        RobotouilleError: A scripted bot has no plan file.
    """
    if kind is BotKind.SCRIPTED and (plan is None or not plan.is_file()):
        raise RobotouilleError(f"a scripted bot needs a plan file: --plan FILE, found {plan}")
    if kind is BotKind.PLANNER:
        return _planner_maker(seed)

    def make(state: State, player: str) -> Policy:
        if kind is BotKind.SCRIPTED:
            return _scripted(state, player, plan)
        from robotouille.planning.policies.policy import RandomPolicy

        return RandomPolicy(player, seed)

    return make


class TrainedBot:
    """Maker of a seat's policy from a file of `robotouille-train`.

    Raises:
        FileError: The file cannot be read or is invalid.
        MissingExtraError: NumPy is not installed.
    """

    def __init__(self, path: Path, seed: int = 0) -> None:
        try:
            from robotouille.planning.policies.trained import read_actor
        except ModuleNotFoundError as error:
            if error.name != "numpy":
                raise
            raise MissingExtraError("a trained policy", "rl") from None
        self._actor = read_actor(path)
        self._seed = seed

    def __call__(self, state: State, player: str) -> Policy:
        """Return the policy of a player.

        Raises:
            WrongWorldError: It was trained for another kitchen.
        """
        from robotouille.planning.policies.trained import TrainedPolicy

        return TrainedPolicy(self._actor, state, player, self._seed)

    def check(self, task: str, seats: int) -> None:
        """Check a shipped task before a seat is taken. Other tasks are known only in the game.

        Raises:
            WrongWorldError: The policy was trained for another kitchen.
        """
        from robotouille.domain.loading import load_task, task_names
        from robotouille.world.world import World

        # The name comes from a server, so nothing but a shipped task is loaded.
        if f"{task}@{seats}" != self._actor.task and task in task_names():
            start = World(load_task(task, seats=seats)).initial
            self(start, start.world.players[0])


def _planner_maker(
    seed: int, words: Language | None = None, *, hurried: bool = False
) -> MakePolicy:
    """Return a function that makes planners, which share what they learn of a kitchen.

    Args:
        hurried: True if the game does not wait for the bots.
    """
    from robotouille.domain.rendering import NO_WORDS
    from robotouille.planning.policies.planner_policy import PlannerOptions, PlannerPolicy
    from robotouille.planning.policies.shift_policy import ShiftPolicy
    from robotouille.planning.shift import DishPlanner
    from robotouille.planning.solvers import AnytimePlanner
    from robotouille.world.world import World

    options = PlannerOptions(seed=seed, words=NO_WORDS if words is None else words)
    dishes: dict[str, DishPlanner] = {}
    known: dict[World, AnytimePlanner] = {}

    def make(state: State, player: str) -> Policy:
        world = state.world
        if world.shift is not None:
            prepares = hurried and not dishes
            if prepares:
                dishes.update((name, DishPlanner(world, name)) for name in world.shift.menu)
            return ShiftPolicy(
                world, player, options, dishes=dishes, start=state, prepares=prepares
            )
        if world not in known:
            known[world] = AnytimePlanner(World(world.task))
        return PlannerPolicy(world, player, options, start=state, anytime=known[world])

    return make


def _scripted(state: State, player: str, plan: Path | None) -> Policy:
    from robotouille.files.reading import read_text
    from robotouille.planning.plan import read_plan
    from robotouille.planning.policies.policy import Script
    from robotouille.world.world import World

    if plan is None:
        raise RobotouilleError("a scripted bot needs a plan file: --plan FILE")
    # Plan files have one joint action for each step, so walks must take one step.
    task = state.world.task
    rehearsal = World(type(task).from_json({**task.to_json(), "timing": "benchmark"}))
    try:
        text = read_text(plan)
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(plan), [Fault("", f"cannot be read: {error}")]) from None
    return Script(player, read_plan(text, rehearsal, str(plan)), rehearsal.initial)
