"""Playing a seat on a server with a policy."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from robotouille.episode import TEAM_TOPIC
from robotouille.planning.policies.policy import Policy, Speech, TeamPolicy, waits
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import (
    ChatReceived,
    GameEvent,
    RosterChanged,
    StateChanged,
    TeamTold,
)

HeardEvent = StateChanged | ChatReceived | TeamTold | RosterChanged
"""Events that a policy learns of."""
MAX_UNHEARD = 1000
"""Number of events that wait for the end of a decision. Further ones replace the oldest."""

MakePolicy = Callable[[State, str], Policy]
"""Makes the policy of a seat from the initial state and the player."""


def step_seconds(clock: Mapping[str, Any]) -> float:
    """Return the seconds of a step by a game's `clock`; 0 in games that wait for players."""
    return 1 / float(clock["step_rate"]) if clock.get("clock") == "realtime" else 0.0


class SeatPolicy:
    """The policy of a seat, with its own copy of the world.

    The policy runs in one thread at a time. Events that arrive while it decides are passed to it
    afterwards, so it decides on the state that it has seen, even if the game is a step further.

    Args:
        game: A game joined with a view that includes the state.
        make_policy: Called once the state is known.
        threaded: True to decide in a thread, so that the connection stays alive during a
            search. Without it, decisions are made at once and games can be repeated exactly.

    Attributes:
        waiting: True if the last decision was to wait for a place or a teammate.
    """

    def __init__(self, game: Game, make_policy: MakePolicy, *, threaded: bool = True) -> None:
        self._game = game
        self._make_policy = make_policy
        self._threaded = threaded
        self._policy: Policy | None = None
        self._world: World | None = None
        self._state: State | None = None
        self._deciding: asyncio.Task[GroundAction | None] | None = None
        self._unheard: deque[HeardEvent] = deque(maxlen=MAX_UNHEARD)
        self.waiting = False

    @property
    def anticipating(self) -> bool:
        """True if the last decision needs another action of the same step to become valid."""
        return isinstance(self._policy, TeamPolicy) and self._policy.anticipating

    def begin(self) -> None:
        """Make the policy once the state is known. It observes all events from then on."""
        if self._policy is None and self._game.has_state:
            self._state = self._game.state
            self._policy = self._make_policy(self._copy(self._state), self._game.seat or "")
            self._meet()
            self._say()

    def heed(self, event: GameEvent) -> None:
        """Pass an event of the game to the policy."""
        if self._policy is None or not isinstance(event, HeardEvent):
            return
        self._unheard.append(event)
        if self._deciding is None or self._deciding.done():
            self._catch_up(self._policy)

    async def decide(self) -> GroundAction | None:
        """Return the policy's action, or None to do nothing.

        The action may no longer be valid when it is returned. If the call is cancelled, the thread
        goes on and its result is dropped. The next call waits for the thread and then decides on
        the state of that moment.
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
            # With unheard events, the policy speaks after it has seen them, about that state.
            self._say()
        return action and self._game.world.action(action.name, *action.arguments)

    async def _ask(self, policy: Policy) -> GroundAction | None:
        state = self._copy(self._state or self._game.state)
        if not self._threaded:
            return policy.act(state)
        self._deciding = asyncio.create_task(asyncio.to_thread(policy.act, state))
        await asyncio.wait([self._deciding])  # Unlike `await`, this survives cancellation.
        return self._deciding.result()

    def _catch_up(self, policy: Policy) -> None:
        unheard = [*self._unheard]
        self._unheard.clear()
        for event in unheard:
            if isinstance(event, StateChanged):
                self._state = event.state
                # Users may leave `observe` out of their policies.
                observe = getattr(policy, "observe", None)
                if event.previous is not None and observe is not None:
                    observe(event.did)
            if not isinstance(policy, TeamPolicy):
                continue
            if isinstance(event, ChatReceived) and event.seat:
                policy.hear(event.seat, Speech(event.text, event.signal))
            if isinstance(event, TeamTold):
                policy.hear(event.seat, Speech(event.text, to_bots=True))
            if isinstance(event, RosterChanged):
                self._meet()
        if unheard:
            self._say()

    def _meet(self) -> None:
        if isinstance(self._policy, TeamPolicy) and self._game.seats:
            kinds = {seat.player: str(seat.controller) for seat in self._game.seats}
            self._policy.meet(kinds, str(self._game.clock["clock"]))

    def _say(self) -> None:
        if isinstance(self._policy, TeamPolicy):
            for speech in self._policy.speak():
                if speech.to_bots:
                    self._game.note(TEAM_TOPIC, speech.text)
                elif speech.signal is not None:
                    self._game.signal(*speech.signal)
                else:
                    self._game.say(speech.text)

    def _copy(self, state: State) -> State:
        if self._world is None or self._world.task != state.world.task:
            self._world = World(state.world.task)
        rows = state.timer_rows(), state.timers.busy
        return self._world.restore(state.facts, *rows, state.orders)


MAX_TRIES = 5
"""Number of decisions in one step before the seat does nothing."""


async def play(game: Game, make_policy: MakePolicy, *, threaded: bool = True) -> Mapping[str, Any]:
    """Play a game to its end and return the outcome, which is empty if the connection was lost.

    Args:
        game: A game joined with a view that includes the state.
        make_policy: Makes the policy from the initial state and the player.
        threaded: True to decide in a thread, so that the connection stays alive during a
            search. Without it, decisions are made at once and games can be repeated exactly.
    """
    await _Player(game, SeatPolicy(game, make_policy, threaded=threaded)).run()
    return game.outcome or {}


class _Player:
    def __init__(self, game: Game, policy: SeatPolicy) -> None:
        self._game = game
        self._policy = policy
        self._decided = -1
        self._tries = 0

    async def run(self) -> None:
        game = self._game
        while not game.ended:
            self._policy.begin()
            for event in game.poll():
                self._policy.heed(event)
            if game.has_state and game.my_move and self._decided < game.step:
                await self._move()
            elif not game.ended:
                self._policy.heed(await game.next_event())

    async def _move(self) -> None:
        game, step = self._game, self._game.step
        action = await self._policy.decide() if self._tries < MAX_TRIES else None
        if game.ended or not game.my_move:
            return
        anticipates = self._policy.anticipating
        if anticipates and game.step != step:
            action, anticipates = None, False
        if action is not None and not anticipates and not game.world.applicable(game.state, action):
            self._tries += 1
            return
        # In real time a step passes by itself, so there is no need to send "do nothing".
        if (
            action is None
            and not self._policy.waiting
            and game.clock["clock"] == "realtime"
            and game.clock["thinking"] == "wall"
        ):
            self._decided, self._tries = step, 0
            return
        waits = action is None and self._policy.waiting
        result = await game.act(action, basis=step, anticipates=anticipates, waits=waits)
        if result.applied:
            self._decided, self._tries = step, 0
        else:
            self._tries += 1
