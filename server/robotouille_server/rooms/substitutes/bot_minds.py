"""What goes on in the minds of stand-ins: worlds, planners and policies, without any I/O.

All stand-ins of a task think with one world and one planner: what one has found out the others
know, and those that are in the same state have the same plan for the price of one.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

from robotouille.world.world import World

if TYPE_CHECKING:
    from robotouille.domain.task import Task
    from robotouille.episode.rules import StandIn as Kind
    from robotouille.planning.anytime import Anytime
    from robotouille.planning.policies.policy import Policy

__all__ = ["EXPANSIONS", "BotAnswer", "BotWorld", "Bots", "Deed", "Question"]

EXPANSIONS = 200
"""Of the search for a first plan: some hundredths of a second, so that the next step has it."""
MAX_KITCHENS = 24
"""Tasks that are known at a time: what is learnt of one takes 5 to 20 MB."""
MAX_SEARCHES = 1_000
"""Plans after which a kitchen is learnt anew: each leaves up to 0.1 MB behind."""
MAX_BOTS = 2_000
"""Stand-ins that are remembered; one that is forgotten plans anew."""
SEED = 0
"""The same for all, so that what happens alike in two games is thought about once."""

Deed: TypeAlias = "tuple[str, str, tuple[str, ...], bool]"
"""What somebody did in a step: player, the action's name and arguments, whether it was applied."""
Rows: TypeAlias = "tuple[tuple[str, int, tuple[str, ...], tuple[int, ...]], ...]"
BotAnswer: TypeAlias = "tuple[str, ...] | None"
"""An action's name and arguments; None to do nothing."""


@dataclass(frozen=True, slots=True)
class Question:
    """What is `player` to do in a state (its facts, timers and busy players)?

    `mind` is the stand-in's number; a new one knows nothing of what was before. `observed` are
    the steps since its last question, each with what everybody did.
    """

    mind: int
    player: str
    kind: Kind
    facts: int
    timers: Rows
    busy: tuple[tuple[str, int], ...]
    observed: tuple[tuple[Deed, ...], ...] = ()


class BotWorld:
    """A task's world and planner; `learnt` are the seats for which it is known already."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._anytime: Anytime | None = None
        self.learnt: set[str] = set()

    @cached_property
    def world(self) -> World:
        return World(self._task)

    @property
    def planner(self) -> Anytime:
        """The planner of all stand-ins of the task."""
        if self._anytime is None:
            from robotouille.planning.anytime import Anytime

            self._anytime = Anytime(self.world)
        return self._anytime

    def learn(self, player: str) -> None:
        """Plan from the start, if nobody has yet: what takes longest is to learn the kitchen."""
        planner = self.planner
        if player not in self.learnt:
            self.learnt.add(player)
            start = self.world.initial
            next(planner.answers(start, team=(player,), seed=SEED, beam=EXPANSIONS))

    def tidy(self) -> None:
        """Do not remember too much."""
        if self._anytime is not None and self._anytime.searches >= MAX_SEARCHES:
            self.forget()

    def forget(self) -> None:
        """Remember nothing of what was found out so far."""
        self.learnt.clear()
        if self._anytime is not None:
            self._anytime.forget()


@dataclass(slots=True)
class _Bot:
    """One stand-in: the kitchen it is in, and the policy that it follows."""

    kitchen: BotWorld
    policy: Policy


class Bots:
    """The minds of all stand-ins, in whatever process they think. The same questions in the same
    order have the same answers, whatever is known of `kitchens` (by digest) already."""

    def __init__(self, kitchens: OrderedDict[str, BotWorld] | None = None) -> None:
        self._kitchens = OrderedDict() if kitchens is None else kitchens
        self._minds: OrderedDict[int, _Bot] = OrderedDict()

    def knows(self, digest: str) -> bool:
        """Whether a task was shown, and is remembered."""
        return digest in self._kitchens

    def show(self, task: Task) -> None:
        """Get to know a task."""
        if task.digest not in self._kitchens:
            self._kitchens[task.digest] = BotWorld(task)
            if len(self._kitchens) > MAX_KITCHENS:
                self._kitchens.popitem(last=False)

    def learn(self, digest: str, player: str) -> None:
        """Get ready to play a seat of a task."""
        self._kitchen(digest).learn(player)

    def think(self, digest: str, question: Question) -> BotAnswer:
        """The answer to a question about a task that is known."""
        kitchen = self._kitchen(digest)
        mind = self._minds.pop(question.mind, None)
        if mind is None or mind.kitchen is not kitchen:
            mind = _Bot(kitchen, _policy(kitchen, question))
        else:
            _observe(mind, question)
        state = kitchen.world.restore(question.facts, question.timers, question.busy)
        action = mind.policy.act(state)
        kitchen.tidy()
        self._minds[question.mind] = mind  # One that has failed is not remembered.
        if len(self._minds) > MAX_BOTS:
            self._minds.popitem(last=False)
        return None if action is None else (action.name, *action.arguments)

    def _kitchen(self, digest: str) -> BotWorld:
        self._kitchens.move_to_end(digest)
        return self._kitchens[digest]


def _observe(mind: _Bot, question: Question) -> None:
    world = mind.kitchen.world
    for step in question.observed:
        world.admit(argument for _, _, arguments, _ in step for argument in arguments)
        mind.policy.observe(
            [(player, world.action(name, *args), applied) for player, name, args, applied in step]
        )


def _policy(kitchen: BotWorld, question: Question) -> Policy:
    if question.kind == "random":
        from robotouille.planning.policies.policy import RandomPolicy

        return RandomPolicy(question.player, SEED)
    from robotouille.planning.policies.planner_policy import PlannerPolicy

    return PlannerPolicy(
        kitchen.world,
        question.player,
        seed=SEED,
        expansions=EXPANSIONS,
        alone=True,
        anytime=kitchen.planner,
    )
