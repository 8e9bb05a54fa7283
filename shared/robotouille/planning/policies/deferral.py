"""Reordering of a plan whose first actions are blocked by another participant.

A plan that assumes that others step aside may begin at a station where one of them still stands.
Pieces of work that need neither such a station nor any deferred work come first.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import count
from operator import or_
from typing import NamedTuple

from robotouille.planning.plan import Plan
from robotouille.planning.policies.policy import depend, running_effects
from robotouille.planning.policies.standing import standing_at, walk_to, walks_aside
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille.world.world import State

MAX_STEPS = 500
"""Maximum number of steps of an attempt."""


class _PlannedAction(NamedTuple):
    """An action other than a walk, with its place in the plan.

    It has its number, the player's station, and the effects that ended before it.
    """

    number: int
    action: GroundAction
    at: str | None
    over: frozenset[str]


@dataclass(eq=False, slots=True)
class _WorkPiece:
    """The actions of a player from free hands to free hands, or to the end of the plan.

    `before` are the facts before the first action. A search may let a player who waits take an
    object and put it back; then `useful` is false.
    """

    player: str
    before: int
    actions: list[_PlannedAction] = field(default_factory=list)
    leaves_hands_free: bool = False
    useful: bool = True

    def finish(self, after: int) -> None:
        """Process the facts after the last action, with free hands."""
        self.leaves_hands_free = True
        actions = [each.action for each in self.actions]
        touched = reduce(or_, (action.touched for action in actions))
        self.useful = any(a.effects for a in actions) or bool((self.before ^ after) & touched)


class _Attempt:
    """A simulated execution by a team: its state and its steps so far."""

    def __init__(
        self, state: State, team: Sequence[str], steps: Sequence[tuple[GroundAction, ...]] = ()
    ) -> None:
        self.state = state
        self._team = team
        self.steps = list(steps)

    def take(self, works: Sequence[_WorkPiece], traces: int) -> list[_WorkPiece]:
        """Execute as many pieces of work as possible and return the others.

        Args:
            traces: Facts that no piece of work changes permanently.
        """
        left, before = list(works), 0
        # A finished piece can enable an earlier one, so the pieces are tried until nothing changes.
        while len(left) != before:
            before = len(left)
            for work in works:
                others = [other for other in left if other is not work]
                if len(others) == len(left) or _depends(work, others, traces):
                    continue
                after = self._attempt(work)
                if after is not None:
                    self.state, self.steps, left = after.state, after.steps, others
        return left

    def reaches_goal(self) -> bool:
        """Return whether the goal is reached by waiting."""
        while not self.state.goal_reached and running_effects(self.state):
            if not self._wait():
                return False
        return self.state.goal_reached

    def _attempt(self, work: _WorkPiece) -> _Attempt | None:
        attempt = _Attempt(self.state, self._team, self.steps)
        return (
            attempt
            if all(attempt._perform(work.player, planned) for planned in work.actions)
            else None
        )

    def _perform(self, player: str, planned: _PlannedAction) -> bool:
        """Execute an action with the walk that it needs. Return False if it is not possible."""
        if standing_at(self.state, player) != planned.at:
            walk = self._walk_to(player, planned.at)
            if walk is None:
                return False
            self._step((walk,))
        while running_effects(self.state) & planned.over:
            if not self._wait():
                return False
        if not self.state.world.applicable(self.state, planned.action):
            return False
        self._step((planned.action,))
        return True

    def _walk_to(self, player: str, station: str | None) -> GroundAction | None:
        """Return a walk, before which a member of the team may have to leave the station."""
        walk = walk_to(self.state, player, station)
        for member in self._team:
            if walk is None and standing_at(self.state, member) == station:
                for away in walks_aside(self.state, member)[:1]:
                    self._step((away,))
                walk = walk_to(self.state, player, station)
        return walk

    def _wait(self) -> bool:
        before = self.state
        self._step(())
        return self.state != before and len(self.steps) < MAX_STEPS

    def _step(self, joint: tuple[GroundAction, ...]) -> None:
        self.steps.append(joint)
        self.state = self.state.step(list(joint)).state


def defer_blocked(plan: Plan, start: State, here: State, team: Sequence[str]) -> Plan:
    """Return the plan with all work first that is possible while the others stand still.

    Args:
        plan: A plan that reaches the goal from `start`.
        start: The state in which the others have stepped aside.
        here: The current state.

    Returns:
        The plan itself if no other order helps or reaches the goal.
    """
    # Whole pieces of work move, never single actions: a player who stopped in between would keep an
    # object in hand and could do nothing else.
    every = _work_pieces(plan, start, team)
    works = [work for work in every if work.useful]
    traces = _traces(plan, start, team)
    later = _Attempt(here, team).take(works, traces)
    first = [work for work in works if work not in later]
    if [*first, *later] == every:
        return plan
    attempt = _Attempt(start, team)
    if attempt.take(first, traces) or attempt.take(later, traces) or not attempt.reaches_goal():
        return plan
    return Plan(tuple(attempt.steps))


def who_can_begin(plan: Plan, start: State, here: State, team: Sequence[str]) -> set[str]:
    """Return the members with work in a plan that is possible while the others stand still.

    The arguments are those of `defer_blocked`.
    """
    _, begun = _possible(plan, start, here, team)
    return {work.player for work in begun}


def possible_part(plan: Plan, start: State, here: State, team: Sequence[str]) -> Plan:
    """Return the work of a plan that is possible while the others stand still.

    The arguments are those of `defer_blocked`. The plan need not reach the goal.
    """
    attempt, _ = _possible(plan, start, here, team)
    return Plan(tuple(attempt.steps))


def after_possible(plan: Plan, start: State, here: State, team: Sequence[str]) -> State:
    """Return the state after all work of a plan that is possible while the others stand still.

    The arguments are those of `defer_blocked`.
    """
    attempt, _ = _possible(plan, start, here, team)
    return attempt.state


def _possible(
    plan: Plan, start: State, here: State, team: Sequence[str]
) -> tuple[_Attempt, list[_WorkPiece]]:
    """Return an attempt at all useful work of a plan, and the work that is possible."""
    works = [work for work in _work_pieces(plan, start, team) if work.useful]
    attempt = _Attempt(here, team)
    later = attempt.take(works, _traces(plan, start, team))
    return attempt, [work for work in works if work not in later]


def _work_pieces(plan: Plan, state: State, team: Sequence[str]) -> list[_WorkPiece]:
    """Return the pieces of work of a plan in the order in which they begin."""
    works: list[_WorkPiece] = []
    open_works: dict[str, _WorkPiece] = {}
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
                works.append(open_works.setdefault(player, _WorkPiece(player, state.facts)))
            open_works[player].actions.append(
                _PlannedAction(next(number), action, at[player], over)
            )
        state = state.step(list(joint)).state
        begun |= running_effects(state)
        laden = {placed.host for placed in scene(state).values()}
        for player in open_works.keys() - laden:
            open_works.pop(player).finish(state.facts)
    return works


def _traces(plan: Plan, state: State, team: Sequence[str]) -> int:
    """Return the facts about players' places and hands, which every piece of work restores."""
    traces = 0
    for player in team:
        traces |= state.world.table.mentions(player)
    for joint in plan:
        for action in joint:
            traces |= action.touched if action.destination is not None else 0
    return traces


def _depends(work: _WorkPiece, others: Iterable[_WorkPiece], traces: int) -> bool:
    """Return whether another piece of work has to come before a piece of work."""
    return any(
        (other.player == work.player and not work.leaves_hands_free)
        or any(
            one.number < planned.number and depend(one.action, planned.action, but=traces)
            for one in other.actions
            for planned in work.actions
        )
        for other in others
    )
