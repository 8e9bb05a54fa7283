"""What can be done first while somebody stands in the way of what a plan begins with.

A plan for when others have walked aside may begin with work at the very station where one of them
stands. Whole pieces of work, from free hands to free hands, that need no such station and none of
the work that is put off come before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from robotouille.planning.plan import Plan
from robotouille.planning.policies.script import depend, running_effects
from robotouille.planning.policies.standing import standing_at, walk_to
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille.world.world import State

__all__ = ["defer_blocked"]

MAX_STEPS = 500
"""Of a course of play that is tried."""


class _Deed(NamedTuple):
    """An action that is more than a walk: its place in the plan, where the player stands for it,
    and the effects that are over by then."""

    number: int
    action: GroundAction
    at: str | None
    over: frozenset[str]


@dataclass(eq=False, slots=True)
class _Work:
    """The deeds of a player from free hands to free hands, or to the end of the plan."""

    player: str
    deeds: list[_Deed] = field(default_factory=list)
    leaves_hands_free: bool = False


class _Course:
    """A course of play that is tried: its state, and its steps so far."""

    def __init__(self, state: State, steps: Sequence[tuple[GroundAction, ...]] = ()) -> None:
        self.state = state
        self.steps = list(steps)

    def take(self, works: Sequence[_Work], traces: int) -> list[_Work]:
        """Do what can be done of some pieces of work; what is left of them.

        Args:
            traces: Facts that all of them leave as they were.
        """
        left, before = list(works), 0
        while len(left) != before:
            before = len(left)
            for work in works:
                others = [other for other in left if other is not work]
                if len(others) == len(left) or _depends(work, others, traces):
                    continue
                after = self._tried(work)
                if after is not None:
                    self.state, self.steps, left = after.state, after.steps, others
        return left

    def reaches_goal(self) -> bool:
        """Whether the goal is reached, if time goes by."""
        while not self.state.goal_reached and running_effects(self.state):
            if not self._wait():
                return False
        return self.state.goal_reached

    def _tried(self, work: _Work) -> _Course | None:
        course = _Course(self.state, self.steps)
        return course if all(course._do(work.player, deed) for deed in work.deeds) else None

    def _do(self, player: str, deed: _Deed) -> bool:
        """Whether a deed is possible, with the walk that it needs."""
        if standing_at(self.state, player) != deed.at:
            walk = walk_to(self.state, player, deed.at)
            if walk is None:
                return False
            self._step((walk,))
        while running_effects(self.state) & deed.over:
            if not self._wait():
                return False
        if not self.state.world.applicable(self.state, deed.action):
            return False
        self._step((deed.action,))
        return True

    def _wait(self) -> bool:
        before = self.state
        self._step(())
        return self.state != before and len(self.steps) < MAX_STEPS

    def _step(self, joint: tuple[GroundAction, ...]) -> None:
        self.steps.append(joint)
        self.state = self.state.step(list(joint)).state


def defer_blocked(plan: Plan, start: State, here: State, team: Sequence[str]) -> Plan:
    """A plan in another order: first what can be done as long as all others stand where they do.

    Args:
        plan: It reaches the goal from `start`.
        start: The state in which the others have walked aside.
        here: The state as it is.

    Returns:
        The plan as it was, if all of it can be done or nothing first, or if another order comes to
        nothing.
    """
    works = _works(plan, start, team)
    traces = _traces(plan, start, team)
    later = _Course(here).take(works, traces)
    first = [work for work in works if work not in later]
    if not later or not first or works[: len(first)] == first:
        return plan
    course = _Course(start)
    if course.take(first, traces) or course.take(later, traces) or not course.reaches_goal():
        return plan
    return Plan(tuple(course.steps))


def _works(plan: Plan, state: State, team: Sequence[str]) -> list[_Work]:
    """The pieces of work of a plan, in the order in which they begin."""
    works: list[_Work] = []
    open_works: dict[str, _Work] = {}
    begun, at = running_effects(state), {player: standing_at(state, player) for player in team}
    number = count()
    for joint in plan:
        over = frozenset(begun - running_effects(state))
        for action in joint:
            player = action.player or team[0]
            if action.destination is not None:
                at[player] = action.destination
                continue
            if player not in open_works:
                works.append(open_works.setdefault(player, _Work(player)))
            open_works[player].deeds.append(_Deed(next(number), action, at[player], over))
        state = state.step(list(joint)).state
        begun |= running_effects(state)
        laden = {placed.host for placed in scene(state).values()}
        for player in open_works.keys() - laden:
            open_works.pop(player).leaves_hands_free = True
    return works


def _traces(plan: Plan, state: State, team: Sequence[str]) -> int:
    """The facts about who stands where and who has what, which no piece of work leaves behind."""
    traces = 0
    for player in team:
        traces |= state.world.table.mentions(player)
    for joint in plan:
        for action in joint:
            traces |= action.touched if action.destination is not None else 0
    return traces


def _depends(work: _Work, others: Iterable[_Work], traces: int) -> bool:
    """Whether something of others has to be done before a piece of work."""
    return any(
        (other.player == work.player and not work.leaves_hands_free)
        or any(
            one.number < deed.number and depend(one.action, deed.action, but=traces)
            for one in other.deeds
            for deed in work.deeds
        )
        for other in others
    )
