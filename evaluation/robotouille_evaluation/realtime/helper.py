"""Who acts in a model's seat on a server while the model thinks: a policy, on the state."""

from __future__ import annotations

import asyncio

from robotouille.planning.policies.policy import Policy, TeamPolicy
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client import Game
from robotouille_client.bots.player import MakePolicy
from robotouille_client.sansio.game_events import Changed, GameEvent, Heard, RosterChanged

__all__ = ["NetworkHelper"]


class NetworkHelper:
    """A policy that acts when it is asked to; one that knows of a team hears and speaks meanwhile.

    Args:
        game: Joined with its state.
        make_policy: Makes the policy, once the state is known.
    """

    def __init__(self, game: Game, make_policy: MakePolicy) -> None:
        self._game = game
        self._make_policy = make_policy
        self._policy: Policy | None = None
        self._world: World | None = None

    def heed(self, event: GameEvent) -> None:
        """Something has happened in the game."""
        policy = self._policy
        if policy is None:
            return
        if isinstance(event, Changed) and event.previous is not None:
            policy.observe(event.did)
        if isinstance(policy, TeamPolicy):
            if isinstance(event, Heard) and event.seat:
                policy.hear(event.seat, event.text)
            if isinstance(event, RosterChanged):
                self._meet(policy)
            self._say(policy)

    async def act(self) -> GroundAction | None:
        """What to do now; None to do nothing. It searches in a thread, in a world of its own: the
        connection stays alive. What it finds after the step is over counts, if it is valid still.
        """
        game, state = self._game, self._game.state
        mine = self._copy(state)
        policy = self._policy
        if policy is None:
            policy = self._policy = self._make_policy(mine, game.seat or "")
            if isinstance(policy, TeamPolicy):
                self._meet(policy)
        found = await asyncio.to_thread(policy.act, mine)
        if isinstance(policy, TeamPolicy) and not game.ended:
            self._say(policy)
        action = found and state.world.action(found.name, *found.arguments)
        return action if action and game.world.applicable(game.state, action) else None

    def _meet(self, policy: TeamPolicy) -> None:
        kinds = {seat.player: str(seat.controller) for seat in self._game.seats}
        policy.meet(kinds, str(self._game.clock["clock"]))

    def _say(self, policy: TeamPolicy) -> None:
        for text in policy.speak():
            self._game.say(text)

    def _copy(self, state: State) -> State:
        if self._world is None:
            self._world = World(state.world.task)
        return self._world.restore(state.facts, state.timer_rows(), state.timers.busy)
