"""A policy in a seat of a game on a server: it hears what happens, says what it has to say, and
decides, in a thread or at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robotouille.planning.policies.policy import Policy, TeamPolicy, waits
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import Changed, GameEvent, Heard, RosterChanged

__all__ = ["MakePolicy", "SeatPolicy"]

MakePolicy = Callable[[State, str], Policy]
"""Makes the policy of a seat, given the state at which it begins."""


class SeatPolicy:
    """The policy of a seat, with a copy of the world that nothing else uses.

    The policy is never in two threads: what happens while it decides is told to it afterwards. And
    it decides in the state of which it has been told, though the game may be a step further.
    `waiting` says that its last decision was to wait for a place or for somebody.

    Args:
        game: Joined with its state.
        make_policy: Makes the policy, once the state is known.
        threaded: Decide in a thread, so that the connection stays alive while a policy searches.
            Otherwise each decision is made at once, and the same messages lead to the same course.
    """

    def __init__(self, game: Game, make_policy: MakePolicy, *, threaded: bool = True) -> None:
        self._game = game
        self._make_policy = make_policy
        self._threaded = threaded
        self._policy: Policy | None = None
        self._world: World | None = None
        self._state: State | None = None
        self._deciding: asyncio.Task[GroundAction | None] | None = None
        self._unheard: list[GameEvent] = []
        self.waiting = False

    @property
    def anticipating(self) -> bool:
        """Whether another's action in the same step is to make the last decision possible."""
        return isinstance(self._policy, TeamPolicy) and self._policy.anticipating

    def begin(self) -> None:
        """Make the policy, if that is not done and the state is known. It hears what happens from
        now on."""
        if self._policy is None and self._game.has_state:
            self._state = self._game.state
            self._policy = self._make_policy(self._copy(self._state), self._game.seat or "")
            self._meet()
            self._say()

    def heed(self, event: GameEvent) -> None:
        """Something has happened in the game."""
        if self._policy is None:
            return
        self._unheard.append(event)
        if self._deciding is None or self._deciding.done():
            self._catch_up(self._policy)

    async def decide(self) -> GroundAction | None:
        """What to do now; None to do nothing. It may not be valid any more once it is found.

        A decision that is given up (cancelled) does not end its thread: what that finds is not
        used, and the next decision waits for it, and is then made in the state of that moment.
        """
        if self._deciding is not None:
            if not self._deciding.done():
                await asyncio.wait([self._deciding])
            self._deciding.result()
        self.begin()
        if self._policy is None:
            return None
        self._catch_up(self._policy)
        self.waiting = False
        action = await self._ask(self._policy)
        self.waiting = action is None and waits(self._policy)
        if not (self._game.ended or self._unheard):
            self._say()  # Else once it has heard all: of the state in which that is read.
        return action and self._game.world.action(action.name, *action.arguments)

    async def _ask(self, policy: Policy) -> GroundAction | None:
        state = self._copy(self._state or self._game.state)
        if not self._threaded:
            return policy.act(state)
        self._deciding = asyncio.create_task(asyncio.to_thread(policy.act, state))
        await asyncio.wait([self._deciding])  # Which leaves it alone where this is cancelled.
        return self._deciding.result()

    def _catch_up(self, policy: Policy) -> None:
        """Tell the policy what it has not heard yet."""
        unheard, self._unheard = self._unheard, []
        for event in unheard:
            if isinstance(event, Changed):
                self._state = event.state
                if event.previous is not None:
                    policy.observe(event.did)
            if not isinstance(policy, TeamPolicy):
                continue
            if isinstance(event, Heard) and event.seat:
                policy.hear(event.seat, event.text)
            if isinstance(event, RosterChanged):
                self._meet()
        if unheard:
            self._say()

    def _meet(self) -> None:
        """Tell the policy who plays."""
        if isinstance(self._policy, TeamPolicy) and self._game.seats:
            kinds = {seat.player: str(seat.controller) for seat in self._game.seats}
            self._policy.meet(kinds, str(self._game.clock["clock"]))

    def _say(self) -> None:
        if isinstance(self._policy, TeamPolicy):
            for text in self._policy.speak():
                self._game.say(text)

    def _copy(self, state: State) -> State:
        if self._world is None or self._world.task != state.world.task:
            self._world = World(state.world.task)
        return self._world.restore(state.facts, state.timer_rows(), state.timers.busy)
