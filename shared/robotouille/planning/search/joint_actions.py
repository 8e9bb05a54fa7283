"""Every step that can be taken in a state: joint actions in every order in which they matter."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from robotouille.planning.plan import Joint
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

__all__ = ["JointMove", "Transitions"]


class JointMove(NamedTuple):
    """The facts and timers after a step, and the joint action that it took."""

    facts: int
    timers: Timers
    joint: Joint


class Transitions:
    """The steps of the players of `team` (all, if empty) together (world.md, "A step").

    Each seat takes one action or none, one after the other: a seat may use what an earlier one
    has done in the same step, so all orders are tried. Partial steps that agree in facts, timers
    and who has acted are continued once.
    """

    def __init__(self, world: World, team: Sequence[str] = ()) -> None:
        self._world = world
        self._players = tuple(p for p in world.players if p in team or not team)

    def moves(self, facts: int, timers: Timers) -> Iterable[JointMove]:
        """All steps that change anything or let time pass, each result once for each way."""
        if len(self._players) == 1:
            return self._alone(facts, timers)
        return self._together(facts, timers)

    def _alone(self, facts: int, timers: Timers) -> list[JointMove]:
        found = []
        if timers:
            found.append(JointMove(*_let_time_pass(facts, timers), ()))
        for action in self._world.actions(State(self._world, facts, timers), self._players[0]):
            after, running = _act(facts, timers, action)
            if running:
                after, running = _let_time_pass(after, running)
            found.append(JointMove(after, running, (action,)))
        return found

    def _together(self, facts: int, timers: Timers) -> Iterator[JointMove]:
        """Continue what the players can have done before time passes, and let it pass."""
        if timers:
            yield JointMove(*_let_time_pass(facts, timers), ())
        start = (facts, timers, frozenset[str]())
        found: dict[tuple[int, Timers, frozenset[str]], Joint] = {start: ()}
        frontier = deque([start])
        while frontier:
            key = frontier.popleft()
            now, running, acted = key
            state = State(self._world, now, running)
            for player in self._players:
                if player in acted:
                    continue
                for action in self._world.actions(state, player):
                    after, started = _act(now, running, action)
                    reached = (after, started, acted | {player})
                    if reached in found or (after == now and started is running):
                        continue
                    joint = found[reached] = (*found[key], action)
                    frontier.append(reached)
                    yield JointMove(*_let_time_pass(after, started), joint)


def _act(facts: int, timers: Timers, action: GroundAction) -> tuple[int, Timers]:
    """An applicable action, before time passes."""
    facts = (facts | action.touched) ^ action.removed
    if action.effects or action.duration > 1:
        touched, removed, timers = timers.begin(action, facts)
        facts = (facts | touched) ^ removed
    return facts, timers


def _let_time_pass(facts: int, timers: Timers) -> tuple[int, Timers]:
    touched, removed, timers = timers.tick(facts)
    return (facts | touched) ^ removed, timers
