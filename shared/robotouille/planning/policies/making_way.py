"""Actions of a planner bot while it waits for participants outside its team."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Sequence

from robotouille.planning.policies.aside import after, held_by, put_down
from robotouille.planning.policies.plan_watch import facts_apart_from
from robotouille.planning.policies.standing import walks_aside, walks_out_of_the_way
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

POLITE = 3
"""Steps for which a seat waits for participants outside the team before it makes way for them."""

UNBURDENED = 12
"""Steps of waiting for participants after which a seat puts down what it holds in real time."""


class MakingWay:
    """Walks out of the way of others, and objects that a seat lays down while it waits.

    Attributes:
        waited: Number of steps for which the seat has waited.

    Args:
        rng: Source of the places to go to. Places that are equally near are chosen at random,
            because two bots would otherwise step aside to the same one.
    """

    def __init__(self, player: str, rng: random.Random) -> None:
        self._player = player
        self._random = rng
        # Objects that were laid down, and the facts about the rest of the kitchen at that time.
        self._laid_down: list[str] = []
        self._elsewhere = 0
        self.waited = 0

    def worked_with(self, objects: Iterable[str]) -> None:
        """Notice work of the seat. Work with other objects may have opened a way."""
        if set(self._laid_down).isdisjoint(objects):
            self._laid_down = []

    def takes_back(self, action: GroundAction, state: State, team: Collection[str]) -> bool:
        """Return whether an action takes what had to be laid down, though nothing has changed."""
        if set(self._laid_down).isdisjoint(action.arguments):
            return False
        return facts_apart_from({*team, *self._laid_down}, state) == self._elsewhere

    def step_aside(self, state: State) -> GroundAction | None:
        """Return a short walk to an empty place, or None if the seat is at one."""
        return self._shortest(walks_aside(state, self._player))

    def act(self, state: State, team: Collection[str], *, hurried: bool) -> GroundAction | None:
        """Return what to do after some steps of waiting: step aside, then put down what is held."""
        if hurried and self.waited >= UNBURDENED:
            # The next plan begins with other work, or takes the object again.
            for action in put_down(state, self._player)[:1]:
                self._laid_down = held_by(state, self._player)
                apart = {*team, *self._laid_down}
                self._elsewhere = facts_apart_from(apart, after(state, action))
                return action
        if self.waited < POLITE:
            return None
        return self._shortest(walks_out_of_the_way(state, self._player))

    def _shortest(self, walks: Sequence[GroundAction]) -> GroundAction | None:
        shortest = min((walk.duration for walk in walks), default=0)
        near = [walk for walk in walks if walk.duration == shortest]
        return self._random.choice(near) if near else None
