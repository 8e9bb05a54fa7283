"""Bots that play the seats of absent participants."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from robotouille.episode import Controller, Episode, Phase, Stepped
from robotouille.episode.rules import StandIn as Kind
from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World
from robotouille_server.logs import get_logger

if TYPE_CHECKING:
    from robotouille.domain.task import Task
    from robotouille.planning.anytime import Anytime
    from robotouille.planning.policies import Policy
    from robotouille.planning.script import Did

__all__ = ["StandIn"]

MAX_OBSERVED = 64
"""Steps that are kept for a policy until it is asked; one that has missed more begins anew."""
MAX_THREADS = 2
MOST_MINDS = 50
"""Stand-ins that plan with one planner, which remembers all that it has found out."""
TURN = 0.0005
"""Seconds after which a thinking thread gives way."""
EXPANSIONS = 200
"""Of the search for a first plan: some hundredths of a second, so that the next step has it."""


class StandIn:
    """A bot for one seat. It is made when the game begins and told every step, so that it can act
    in the very next one; it thinks in a thread, one thought at a time."""

    def __init__(
        self,
        episode: Episode,
        player: str,
        kind: Kind,
        decide: Callable[[str, GroundAction | None], None],
    ) -> None:
        self._episode = episode
        self._player = player
        self._kind = kind
        self._decide = decide
        self._loop = asyncio.get_running_loop()
        self._observed: list[Did] = []
        self._mind: _Mind | None = None
        self._thought: asyncio.Future[GroundAction | None] | None = None
        self._stopped = False

    def warm(self) -> None:
        """Get ready while the participant still plays."""
        if self._mind is None and not self._stopped:
            self._mind = _Mind(self._episode, self._player, self._kind)
            self._loop.run_in_executor(_threads(), self._mind.wake)

    def observe(self, event: Stepped) -> None:
        """What everybody did in a step."""
        did = tuple(
            (move.player, move.action, attempt.applied)
            for move, attempt in zip(event.moves, event.attempts, strict=True)
        )
        self._observed.append(did)
        if len(self._observed) > MAX_OBSERVED:
            self._observed.clear()
            if self._mind is not None and self._mind.played:
                self._mind = None
                self.warm()

    def consider(self) -> None:
        """Think about the present step, if the seat is the bot's and has to decide."""
        if self._thought is not None or self._stopped or not self._must_decide():
            return
        self.warm()
        if self._mind is None:
            return
        observed, self._observed = self._observed, []
        state, step = self._episode.state, self._episode.step
        think = partial(self._mind.think, state.facts, state.timer_rows(), state.timers.busy)
        self._thought = self._loop.run_in_executor(_threads(), think, observed)
        self._thought.add_done_callback(partial(self._thought_over, step))

    def stop(self) -> None:
        """The episode is over or goes on elsewhere."""
        self._stopped = True

    def _must_decide(self) -> bool:
        episode = self._episode
        seat = episode.seats[self._player]
        return (
            episode.phase is Phase.RUNNING
            and not episode.paused
            and seat.controller is Controller.STAND_IN
            and seat.pending is None
            and episode.on_turn in (None, self._player)
            and episode.state.busy_steps(self._player) == 0
        )

    def _thought_over(self, step: int, thought: asyncio.Future[GroundAction | None]) -> None:
        self._thought = None
        if self._stopped or thought.cancelled() or not self._must_decide():
            return
        episode, action, failure = self._episode, None, thought.exception()
        if failure is not None:
            get_logger().error("a stand-in failed", player=self._player, exc_info=failure)
            self._mind = None
        elif (found := thought.result()) is not None:
            action = episode.world.action(found.name, *found.arguments)
        in_time = episode.step == step
        if in_time or (action is not None and episode.world.applicable(episode.state, action)):
            self._decide(self._player, action)
        else:
            self.consider()


@cache
def _threads() -> ThreadPoolExecutor:
    """Few, so that thoughts take little from the steps of all other games; and whenever the event
    loop wants to go on, it does not wait for them as long as Python would let it (5 ms)."""
    sys.setswitchinterval(min(TURN, sys.getswitchinterval()))
    return ThreadPoolExecutor(MAX_THREADS, "stand-in")


class _Kitchen:
    """A task's own world and planner, for all stand-ins in episodes of it: one thought at a time.

    What takes longest is to learn the kitchen, so it is learnt once, while everybody still plays.
    """

    def __init__(self, task: Task) -> None:
        self.thinking = threading.Lock()
        self._task = task
        self._anytime: Anytime | None = None
        self.minds = 0

    @cached_property
    def world(self) -> World:
        """To be used while `thinking` is held."""
        return World(self._task)

    def learn(self, player: str) -> Anytime:
        """The planner that knows the kitchen; to be asked for while `thinking` is held."""
        if self._anytime is None:
            # Compiling the planner would take longer than any seat can wait.
            os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
            from robotouille.planning.anytime import Anytime

            self._anytime = Anytime(self.world)
            next(self._anytime.answers(self.world.initial, team=(player,), beam=EXPANSIONS))
        return self._anytime

    def forget(self) -> None:
        """Know nothing any more of what was found out for earlier games."""
        self._anytime, self.minds = None, 0


_kitchens: WeakValueDictionary[str, _Kitchen] = WeakValueDictionary()


def _kitchen(task: Task) -> _Kitchen:
    kitchen = _kitchens.get(task.digest)
    if kitchen is None:
        kitchen = _kitchens[task.digest] = _Kitchen(task)
    return kitchen


class _Mind:
    """What a stand-in knows: the kitchen, and what has been done since it plays."""

    def __init__(self, episode: Episode, player: str, kind: Kind) -> None:
        self._kitchen = _kitchen(episode.world.task)
        self._player = player
        self._kind = kind
        self._seed = episode.step
        self._policy: Policy | None = None
        self.played = False

    def wake(self) -> None:
        """Learn the kitchen, if nobody has yet."""
        if self._kind != "random":
            with self._kitchen.thinking:
                if self._kitchen.minds >= MOST_MINDS:
                    self._kitchen.forget()
                self._kitchen.learn(self._player)

    def _make(self) -> Policy:
        from robotouille.planning.policies import RandomPolicy

        if self._kind == "random":
            return RandomPolicy(self._player, self._seed)
        self._kitchen.minds += 1
        anytime = self._kitchen.learn(self._player)
        from robotouille.planning.policy import PlannerPolicy

        return PlannerPolicy(
            self._kitchen.world,
            self._player,
            seed=self._seed,
            expansions=EXPANSIONS,
            alone=True,
            anytime=anytime,
        )

    def think(
        self, facts: int, timers: object, busy: object, observed: list[Did]
    ) -> GroundAction | None:
        """The policy's action in a state, in this episode's own terms."""
        with self._kitchen.thinking:
            self._policy = policy = self._policy or self._make()
            state: State = self._kitchen.world.restore(facts, timers, busy)  # type: ignore[arg-type]
            if self.played:
                for did in observed:
                    policy.observe(did)
            self.played = True
            return policy.act(state)
