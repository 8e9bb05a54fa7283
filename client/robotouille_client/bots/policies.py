"""What a bot does: policies choose an action of their seat in a state.

A policy holds its own copy of the world and whatever memory it has explicitly; it never waits.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World

if TYPE_CHECKING:
    from robotouille.planning.plan import Plan

__all__ = ["Did", "Policy", "RandomPolicy", "ScriptedPolicy"]

Did = Sequence[tuple[str, GroundAction, bool]]
"""The actions of a step: player, action, and whether it was applied."""


class Policy(Protocol):
    """Chooses the actions of one seat."""

    def act(self, state: State) -> GroundAction | None:
        """The action to take in a state; None to do nothing this step."""

    def observe(self, did: Did) -> None:
        """What everybody did in a step; called once for each step before `act`."""


class RandomPolicy:
    """A valid action at random; one seed, one course."""

    def __init__(self, player: str, seed: int = 0) -> None:
        self._player = player
        self._random = random.Random(f"{seed}:{player}")

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        actions = state.actions(self._player)
        return self._random.choice(actions) if actions else None


class ScriptedPolicy:
    """Plays one seat's part of a plan, under any clock and timing profile.

    A plan says what happens in which step; elsewhere things take longer. So an action waits for
    all actions of earlier steps of the plan, the other seats' included, and for every effect that
    had run its course by then in the plan (a patty is not picked up before it is cooked).
    """

    def __init__(self, world: World, player: str, plan: Plan) -> None:
        self._player = player
        self._rows: list[tuple[int, str, GroundAction]] = []
        self._finished: list[frozenset[str]] = []
        self._cursor: dict[str, int] = dict.fromkeys(world.players, 0)
        self._rehearse(world, plan)

    def _rehearse(self, world: World, plan: Plan) -> None:
        state = world.initial
        begun: set[str] = set()
        for step, actions in enumerate(plan):
            running = {str(effect) for effect, _ in state.timers.entries}
            self._finished.append(frozenset(begun - running))
            begun |= running
            self._rows += [(step, a.player or self._player, a) for a in actions]
            state = state.step(list(actions)).state
            begun |= {str(effect) for effect, _ in state.timers.entries}

    def observe(self, did: Did) -> None:
        for player, action, applied in did:
            wanted = self._next(player)
            if applied and wanted is not None and str(wanted[1]) == str(action):
                self._cursor[player] += 1

    def _next(self, player: str) -> tuple[int, GroundAction] | None:
        own = [(step, action) for step, who, action in self._rows if who == player]
        position = self._cursor.get(player, 0)
        return own[position] if position < len(own) else None

    def act(self, state: State) -> GroundAction | None:
        mine = self._next(self._player)
        if mine is None:
            return None
        step, action = mine
        for player in self._cursor:
            other = self._next(player)
            if player != self._player and other is not None and other[0] < step:
                return None
        running = {str(effect) for effect, _ in state.timers.entries}
        if running & self._finished[step]:
            return None
        # The plan may be of another copy of the world.
        here = state.world.action(action.name, *action.arguments)
        return here if state.world.applicable(state, here) else None
