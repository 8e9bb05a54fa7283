"""Plays a seat over the network with a policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robotouille_client.bots.seat_policy import MakePolicy, SeatPolicy
from robotouille_client.game import Game

__all__ = ["play"]

MAX_TRIES = 5


async def play(game: Game, make_policy: MakePolicy, *, threaded: bool = True) -> Mapping[str, Any]:
    """Play a game to its end; returns the outcome as data, empty if the connection was lost.

    `threaded` thinks in a thread, so that the connection stays alive while a policy searches.
    Otherwise each decision is made at once, and the same messages lead to the same course.
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
        """Decide and act once. What was rejected is decided anew, but not for ever."""
        game, step = self._game, self._game.step
        action = await self._policy.decide() if self._tries < MAX_TRIES else None
        if game.ended or not game.my_move:
            return
        anticipates = self._policy.anticipating
        if anticipates and (game.step != step or not game.can_anticipate):
            action, anticipates = None, False
        if action is not None and not anticipates and not game.world.applicable(game.state, action):
            self._tries += 1
            return
        if (
            action is None
            and not (self._policy.waiting and game.can_wait)
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
