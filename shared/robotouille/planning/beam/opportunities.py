"""Opportunities: whether a player could act usefully in a state, by the planner's heuristic.

A seat that does nothing may have nothing to do: the food cooks, or its partner holds what is
missing. People cannot declare such a wait, and bots declare it by their own plans. This judgement
is the same for everyone, because it depends on the state alone.
"""

from __future__ import annotations

from collections.abc import Iterator

from robotouille.planning.beam.goal_ordering import Ordering
from robotouille.planning.beam.planner import goal_assignments
from robotouille.planning.beam.remaining_work_heuristic import HeuristicContext, RemainingWork
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

MAX_KNOWN = 10_000
LESS = 1e-6
"""Difference above which work counts as less. The heuristic adds up fractions."""


class Opportunities:
    """Judge of the states of one world.

    A player could act usefully if one of its actions, where it stands or after one walk to a free
    station, would leave less work than doing nothing. Work is that of the beam planner's heuristic,
    `RemainingWork`, for the choice of objects with little work. Walks alone are never useful, and
    the places of players do not count.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._context = HeuristicContext(world)
        self._ordering: Ordering | None = None
        self._work: dict[int, RemainingWork | None] = {}
        self._known: dict[tuple[object, ...], bool] = {}

    def useful(self, state: State, player: str) -> bool:
        """Return whether a player could act usefully. A busy player could not."""
        if state.busy_steps(player):
            return False
        calm = self._calm(state)
        key = (calm.facts, calm.timers.entries, player)
        if key not in self._known:
            if len(self._known) > MAX_KNOWN:
                self._known.clear()
            self._known[key] = self._judge(calm, player)
        return self._known[key]

    def _judge(self, state: State, player: str) -> bool:
        work = self._work_of(state)
        if work is None:
            return False
        # Compared with a step in which nobody acts, because time alone brings timers to their end.
        most = self._left(work, state.step(()).state) - LESS
        return any(
            self._left(work, there.step([action]).state) < most
            for there in self._reachable(state, player)
            for action in there.actions(player)
            if action.destination is None
        )

    def _reachable(self, state: State, player: str) -> Iterator[State]:
        """Yield the state, and the states after one walk of the player that takes no time."""
        yield state
        walks = (action for action in state.actions(player) if action.destination is not None)
        yield from (State(self._world, _after(state, walk), state.timers) for walk in walks)

    def _work_of(self, state: State) -> RemainingWork | None:
        """Return the work towards the goal, or None if no choice of objects can meet it."""
        context, atoms = self._context, len(self._world.table.atoms)
        context.refresh()
        if len(self._world.table.atoms) != atoms:
            self._work.clear()
        forecast = context.forecast(state.facts, state.timers)
        facts = (state.facts | forecast.touched) ^ forecast.removed
        if facts not in self._work:
            if len(self._work) > MAX_KNOWN:
                self._work.clear()
            self._work[facts] = self._work_towards(state, facts)
        return self._work[facts]

    def _work_towards(self, state: State, facts: int) -> RemainingWork | None:
        context = self._context
        if self._ordering is None:
            initial = goal_assignments(context, self._world.initial)
            if not initial:
                return None
            # The top of a sandwich that is laid too soon has to come off again.
            self._ordering = Ordering(context, initial[0])
        choices = goal_assignments(context, state, self._ordering)
        if not choices:
            return None
        return RemainingWork(context, choices[0], facts, self._ordering.rules(choices[0]))

    def _left(self, work: RemainingWork, state: State) -> float:
        standing = 0
        for places in self._context.analysis.places.values():
            standing |= places
        return work(state.facts & ~standing, self._calm(state).timers)

    def _calm(self, state: State) -> State:
        """Return a state with its effects but without busy players."""
        timers = state.timers
        if not timers.busy:
            return state
        return State(self._world, state.facts, self._world.timers.get(timers.entries, ()))


def _after(state: State, action: GroundAction) -> int:
    return (state.facts | action.touched) ^ action.removed
