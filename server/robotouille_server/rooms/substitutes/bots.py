"""Substitute bots, and the process in which they plan.

All substitutes of a task share one world and one planner. A plan that one bot has found is
therefore free for all others that are in the same state.

| request | reply |
| --- | --- |
| `["task", digest, json]` | none |
| `["learn", number, digest, player]` | `[number, "done", nil]` |
| `["ask", number, digest, …question]` | `[number, "done", [action, …arguments]]`, or nil |

The reply to a request about an unknown or forgotten task is `[number, "unknown", nil]`. The reply
to a request that failed is `[number, "failed", traceback]`.
"""

from __future__ import annotations

import json
import traceback
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

from robotouille.domain.task import Task
from robotouille.planning.bot_process import (
    MoveRow,
    StateRow,
    packed,
    read_moves,
    read_state,
    serve_requests,
)
from robotouille.world.world import World

if TYPE_CHECKING:
    from robotouille.episode.rules import Substitute as Kind
    from robotouille.planning.policies.policy import Policy
    from robotouille.planning.shift import DishPlanner
    from robotouille.planning.solvers import AnytimePlanner

EXPANSIONS = 200
"""Search budget for a first plan: some hundredths of a second, so that the plan is ready in time
for the next step."""
MAX_WORLDS = 24
"""Tasks that are remembered. What is learnt about one takes 5 to 20 MB."""
MAX_SEARCHES = 1_000
"""Searches after which a world's planner starts over. Each search leaves up to 0.1 MB behind."""
MAX_BOTS = 2_000
"""Bots that are remembered. A forgotten bot plans again."""
SEED = 0
"""Seed of all bots. With one seed, equal situations in two episodes need only one search."""

BotAnswer: TypeAlias = "tuple[str, ...] | None"
"""Name and arguments of an action; None to do nothing."""


@dataclass(frozen=True, slots=True)
class Question:
    """Request for the action of `player` in a state.

    Attributes:
        bot: The number of the bot. A new number means a bot without memory.
        state: The state, for `read_state`.
        observed: The moves of each step since the bot's last question.
    """

    bot: int
    player: str
    kind: Kind
    state: StateRow
    observed: tuple[tuple[MoveRow, ...], ...] = ()


class BotWorld:
    """World and planner of a task. `learnt` holds the seats that were prepared."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._anytime: AnytimePlanner | None = None
        self._dishes: dict[str, DishPlanner] = {}
        self.learnt: set[str] = set()

    @cached_property
    def world(self) -> World:
        return World(self._task)

    @property
    def planner(self) -> AnytimePlanner:
        """Planner of all bots of the task."""
        if self._anytime is None:
            from robotouille.planning.solvers import AnytimePlanner

            self._anytime = AnytimePlanner(self.world)
        return self._anytime

    def policy(self, player: str) -> Policy:
        """Return a new planner policy for a seat."""
        from robotouille.planning.policies.planner_policy import PlannerOptions, PlannerPolicy

        # The option `alone` makes planning quicker. The other players would not learn of a team
        # plan anyway (docs/decisions/0020).
        options = PlannerOptions(seed=SEED, expansions=EXPANSIONS, alone=True)
        if self.world.shift is not None:
            from robotouille.planning.policies.shift_policy import ShiftPolicy

            return ShiftPolicy(self.world, player, options, dishes=self._dishes)
        return PlannerPolicy(self.world, player, options, anytime=self.planner)

    def learn(self, player: str) -> None:
        """Decide once in the initial state, unless that was done for the seat before.

        The first decision in a world takes longest, because the planner analyses the world.
        """
        if player not in self.learnt:
            self.learnt.add(player)
            self.policy(player).act(self.world.initial)

    def tidy(self) -> None:
        """Forget everything after too many searches, to bound the memory."""
        if sum(planner.searches for planner in self._planners) >= MAX_SEARCHES:
            self.forget()

    def forget(self) -> None:
        """Forget all plans and prepared seats."""
        self.learnt.clear()
        for planner in self._planners:
            planner.forget()

    @property
    def _planners(self) -> list[AnytimePlanner]:
        """The planners so far: of the task, or of the dishes of a shift."""
        own = [] if self._anytime is None else [self._anytime]
        return own + [dish.anytime for dish in self._dishes.values()]


@dataclass(slots=True)
class _Bot:
    world: BotWorld
    policy: Policy


class Bots:
    """All substitutes of one process, without I/O.

    The same questions in the same order get the same answers, whatever `worlds` (by digest)
    already contain.
    """

    def __init__(self, worlds: OrderedDict[str, BotWorld] | None = None) -> None:
        self._worlds = OrderedDict() if worlds is None else worlds
        self._bots: OrderedDict[int, _Bot] = OrderedDict()

    def knows(self, digest: str) -> bool:
        """Return whether a task was shown and is still remembered."""
        return digest in self._worlds

    def show(self, task: Task) -> None:
        """Remember a task."""
        if task.digest not in self._worlds:
            self._worlds[task.digest] = BotWorld(task)
            # Forget the least recently used task. The server sends it again after the reply
            # "unknown".
            if len(self._worlds) > MAX_WORLDS:
                self._worlds.popitem(last=False)

    def learn(self, digest: str, player: str) -> None:
        """Prepare to play a seat of a task."""
        self._world(digest).learn(player)

    def answer(self, digest: str, question: Question) -> BotAnswer:
        """Return the answer to a question about a task that was shown."""
        world = self._world(digest)
        bot = self._bots.pop(question.bot, None)
        # If the task was forgotten and sent again, its world is a new object, so the bot's old plan
        # is useless.
        if bot is None or bot.world is not world:
            bot = _Bot(world, _policy(world, question))
        else:
            for rows in question.observed:
                bot.policy.observe(read_moves(world.world, rows))
        state = read_state(world.world, question.state)
        action = bot.policy.act(state)
        world.tidy()
        self._bots[question.bot] = bot  # After `act`, so that a bot that failed is forgotten.
        if len(self._bots) > MAX_BOTS:
            self._bots.popitem(last=False)
        return None if action is None else (action.name, *action.arguments)

    def _world(self, digest: str) -> BotWorld:
        self._worlds.move_to_end(digest)
        return self._worlds[digest]


def _policy(world: BotWorld, question: Question) -> Policy:
    if question.kind == "random":
        from robotouille.planning.policies.policy import RandomPolicy

        return RandomPolicy(question.player, SEED)
    return world.policy(question.player)


# Process

DONE, UNKNOWN, FAILED = "done", "unknown", "failed"


def task_request(task: Task) -> bytes:
    """Return the request that must precede all others about a task."""
    return packed("task", task.digest, json.dumps(task.json))


def learn_request(number: int, digest: str, player: str) -> bytes:
    return packed("learn", number, digest, player)


def ask_request(number: int, digest: str, question: Question) -> bytes:
    q = question
    return packed("ask", number, digest, q.bot, q.player, q.kind, q.state, q.observed)


def replies(requests: Iterator[Any], _is_last: Callable[[], bool]) -> Iterable[tuple[Any, ...]]:
    """Yield the replies to the requests of a server."""
    bots = Bots()
    for what, *rest in requests:
        if what == "task":
            bots.show(Task.from_json(json.loads(rest[1])))
            continue
        number, digest, *about = rest
        if not bots.knows(digest):
            yield number, UNKNOWN, None
            continue
        try:
            yield number, DONE, _answer(bots, what, digest, about)
        # One failing question must not end the process: all other substitutes depend on it.
        except Exception:
            yield number, FAILED, traceback.format_exc()


def _answer(bots: Bots, what: str, digest: str, about: list[Any]) -> BotAnswer:
    if what == "learn":
        bots.learn(digest, *about)
        return None
    return bots.answer(digest, Question(*about))


def main() -> None:
    """Run the process of the substitutes."""
    serve_requests(replies)


if __name__ == "__main__":
    main()
