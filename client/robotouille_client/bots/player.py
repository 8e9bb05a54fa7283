"""Plays a seat over the network with a policy."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from robotouille.planning.policies.policy import Policy, TeamPolicy
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import Changed, GameEvent, Heard, RosterChanged

__all__ = ["MakePolicy", "play"]

MakePolicy = Callable[[State, str], Policy]
"""Makes the policy of a seat, given the state at which it begins."""

MAX_TRIES = 5


async def play(game: Game, make_policy: MakePolicy, *, threaded: bool = True) -> Mapping[str, Any]:
    """Play a game to its end; returns the outcome as data, empty if the connection was lost.

    `threaded` thinks in a thread, so that the connection stays alive while a policy searches.
    Otherwise each decision is made at once, and the same messages lead to the same course.
    """
    await _Player(game, make_policy, threaded).run()
    return game.outcome or {}


class _Player:
    def __init__(self, game: Game, make_policy: MakePolicy, threaded: bool) -> None:
        self._game = game
        self._make_policy = make_policy
        self._threaded = threaded
        self._policy: Policy | None = None
        self._world: World | None = None
        self._decided = -1
        self._tries = 0

    async def run(self) -> None:
        while not self._game.ended:
            if self._policy is None and self._game.has_state:
                self._policy = self._make_policy(
                    self._copy(self._game.state), self._game.seat or ""
                )
                self._meet()
            for event in self._game.poll():
                self._heed(event)
            if self._game.has_state and self._game.my_move and self._decided < self._game.step:
                await self._move()
            elif not self._game.ended:
                self._heed(await self._game.next_event())

    def _heed(self, event: GameEvent) -> None:
        policy = self._policy
        if policy is None:
            return
        if isinstance(event, Changed) and event.previous is not None:
            policy.observe(event.did)
        if not isinstance(policy, TeamPolicy):
            return
        if isinstance(event, Heard) and event.seat:
            policy.hear(event.seat, event.text)
        if isinstance(event, RosterChanged):
            self._meet()
        self._say(policy)

    def _meet(self) -> None:
        """Tell the policy who plays, and have it say what it has to say."""
        if isinstance(self._policy, TeamPolicy) and self._game.seats:
            kinds = {seat.player: str(seat.controller) for seat in self._game.seats}
            self._policy.meet(kinds, str(self._game.clock["clock"]))
            self._say(self._policy)

    def _say(self, policy: TeamPolicy) -> None:
        for text in policy.speak():
            self._game.say(text)

    async def _move(self) -> None:
        """Decide and act once. What was rejected is decided anew, but not for ever."""
        game, step = self._game, self._game.step
        action = await self._decide(game.state) if self._tries < MAX_TRIES else None
        if game.ended or not game.my_move:
            return
        policy = self._policy
        anticipates = isinstance(policy, TeamPolicy) and policy.anticipating
        if isinstance(policy, TeamPolicy):
            self._say(policy)
        if anticipates and (game.step != step or not game.can_anticipate):
            action, anticipates = None, False
        if action is not None and not anticipates and not game.world.applicable(game.state, action):
            self._tries += 1
            return
        if (
            action is None
            and game.clock["clock"] == "realtime"
            and game.clock["thinking"] == "wall"
        ):
            self._decided, self._tries = step, 0
            return
        result = await game.act(action, basis=step, anticipates=anticipates)
        if result.applied:
            self._decided, self._tries = step, 0
        else:
            self._tries += 1

    async def _decide(self, state: State) -> GroundAction | None:
        """Ask the policy, in a copy of the world of its own: it may think in another thread."""
        mine = self._copy(state)
        if self._policy is None:
            return None
        if self._threaded:
            action = await asyncio.to_thread(self._policy.act, mine)
        else:
            action = self._policy.act(mine)
        return None if action is None else state.world.action(action.name, *action.arguments)

    def _copy(self, state: State) -> State:
        if self._world is None or self._world.task != state.world.task:
            self._world = World(state.world.task)
        return self._world.restore(state.facts, state.timer_rows(), state.timers.busy)
