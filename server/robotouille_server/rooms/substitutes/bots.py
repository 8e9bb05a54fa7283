"""Substitute bots: worlds, planners and policies, without any I/O.

All substitute bots of a task share one world and one planner: what one has found out the others
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
    from robotouille.planning.anytime import AnytimePlanner
    from robotouille.planning.policies.policy import Policy
    from robotouille.world.timers import BusyRow, TimerRow

__all__ = ["EXPANSIONS", "BotAnswer", "BotWorld", "Bots", "ObservedMove", "Question"]

EXPANSIONS = 200
"""Of the search for a first plan: some hundredths of a second, so that the next step has it."""
MAX_WORLDS = 24
"""Tasks that are known at a time: what is learnt of one takes 5 to 20 MB."""
MAX_SEARCHES = 1_000
"""Plans after which a world is learnt anew: each leaves up to 0.1 MB behind."""
MAX_BOTS = 2_000
"""Bots that are remembered; one that is forgotten plans anew."""
SEED = 0
"""The same for all, so that what happens alike in two games is thought about once."""

ObservedMove: TypeAlias = "tuple[str, str, tuple[str, ...], bool]"
"""What somebody did in a step: player, the action's name and arguments, whether it was applied."""
BotAnswer: TypeAlias = "tuple[str, ...] | None"
"""An action's name and arguments; None to do nothing."""


@dataclass(frozen=True, slots=True)
class Question:
    """What is `player` to do in a state (its facts, timers and busy players)?

    `bot` is the bot's number; a new one knows nothing of what was before. `observed` are
    the steps since its last question, each with what everybody did.
    """

    bot: int
    player: str
    kind: Kind
    facts: int
    timers: tuple[TimerRow, ...]
    busy: tuple[BusyRow, ...]
    observed: tuple[tuple[ObservedMove, ...], ...] = ()


class BotWorld:
    """A task's world and planner; `learnt` are the seats for which it is known already."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._anytime: AnytimePlanner | None = None
        self.learnt: set[str] = set()

    @cached_property
    def world(self) -> World:
        return World(self._task)

    @property
    def planner(self) -> AnytimePlanner:
        """The planner of all bots of the task."""
        if self._anytime is None:
            from robotouille.planning.anytime import AnytimePlanner

            self._anytime = AnytimePlanner(self.world)
        return self._anytime

    def policy(self, player: str) -> Policy:
        """A planner's policy for a seat."""
        from robotouille.planning.policies.planner_policy import PlannerPolicy

        return PlannerPolicy(
            self.world,
            player,
            seed=SEED,
            expansions=EXPANSIONS,
            alone=True,
            anytime=self.planner,
        )

    def learn(self, player: str) -> None:
        """Decide once at the start, if nobody has yet: what takes longest is to learn the world."""
        if player not in self.learnt:
            self.learnt.add(player)
            self.policy(player).act(self.world.initial)

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
    """One bot: the world it is in, and the policy that it follows."""

    world: BotWorld
    policy: Policy


class Bots:
    """All substitute bots, in whatever process they are. The same questions in the same
    order have the same answers, whatever is known of `worlds` (by digest) already."""

    def __init__(self, worlds: OrderedDict[str, BotWorld] | None = None) -> None:
        self._worlds = OrderedDict() if worlds is None else worlds
        self._bots: OrderedDict[int, _Bot] = OrderedDict()

    def knows(self, digest: str) -> bool:
        """Whether a task was shown, and is remembered."""
        return digest in self._worlds

    def show(self, task: Task) -> None:
        """Get to know a task."""
        if task.digest not in self._worlds:
            self._worlds[task.digest] = BotWorld(task)
            if len(self._worlds) > MAX_WORLDS:
                self._worlds.popitem(last=False)

    def learn(self, digest: str, player: str) -> None:
        """Get ready to play a seat of a task."""
        self._world(digest).learn(player)

    def answer(self, digest: str, question: Question) -> BotAnswer:
        """The answer to a question about a task that is known."""
        world = self._world(digest)
        bot = self._bots.pop(question.bot, None)
        if bot is None or bot.world is not world:
            bot = _Bot(world, _policy(world, question))
        else:
            _observe(bot, question)
        state = world.world.restore(question.facts, question.timers, question.busy)
        action = bot.policy.act(state)
        world.tidy()
        self._bots[question.bot] = bot  # One that has failed is not remembered.
        if len(self._bots) > MAX_BOTS:
            self._bots.popitem(last=False)
        return None if action is None else (action.name, *action.arguments)

    def _world(self, digest: str) -> BotWorld:
        self._worlds.move_to_end(digest)
        return self._worlds[digest]


def _observe(bot: _Bot, question: Question) -> None:
    world = bot.world.world
    for step in question.observed:
        world.admit(argument for _, _, arguments, _ in step for argument in arguments)
        bot.policy.observe(
            [(player, world.action(name, *args), applied) for player, name, args, applied in step]
        )


def _policy(world: BotWorld, question: Question) -> Policy:
    if question.kind == "random":
        from robotouille.planning.policies.policy import RandomPolicy

        return RandomPolicy(question.player, SEED)
    return world.policy(question.player)
