"""Parts of a goal that nothing can achieve, which explain why a task is unsolvable."""

from __future__ import annotations

from collections.abc import Collection

from robotouille.domain.schema import GoalTerm
from robotouille.planning.plan import Limits
from robotouille.planning.search.best_first import Transitions
from robotouille.planning.search.relaxed_operators import TooLargeError
from robotouille.planning.search.relaxed_task import Relaxation
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.text import describe
from robotouille.world.world import State, World

EXHAUSTIVE = Limits(states=100_000)


def unreachable_goal(
    world: World, state: State | None = None, *, limits: Limits = EXHAUSTIVE
) -> tuple[str, ...]:
    """Return the predicates of the goal, in words, that cannot become true from a state."""
    start = world.initial if state is None else state
    # The relaxation is fast, but misses predicates that only deletions prevent. Then every state is
    # visited, and predicates that hold in none of them are named. The result is empty if the limits
    # are too narrow, or if all predicates can hold, but not together.
    terms = _relaxed(world, start) or _visited(world, start, limits)
    return tuple(dict.fromkeys(_in_words(world, term) for term in terms))


class ReachabilityCheck:
    """Test whether a team provably cannot reach the goal while all others stand still.

    The first call takes longest; later calls reuse its relaxation.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._acted_on = any(_players(world, schema) > 1 for schema in world.schemas)
        self._relaxations: dict[tuple[int, int], Relaxation] = {}

    def __call__(self, state: State, team: Collection[str]) -> bool:
        """Return whether the team provably cannot reach the goal."""
        # If players can act on one another, standing still cannot be modelled by leaving players
        # out.
        others = frozenset(self._world.players) - set(team)
        if not others or self._acted_on:
            return False
        facts = state.facts
        for player in others:  # A player without a place or object cannot act.
            facts &= ~self._world.table.mentions(player)
        try:
            relaxation = self._begin(State(self._world, facts, state.timers))
        except TooLargeError:
            return False
        # The relaxation never undoes anything, so what it cannot reach is out of reach.
        if not all(relaxation.may_come_true(term) for term in self._world.goal.terms):
            return True
        return not relaxation.may_reach_goal(facts)

    def _begin(self, start: State) -> Relaxation:
        """Return a relaxation for the existing objects and those there is room for."""
        table = self._world.table
        key = start.facts & table.internal, len(table.atoms)
        relaxation = self._relaxations.get(key)
        if relaxation is None:
            relaxation = self._relaxations[key] = Relaxation(self._world, start)
        else:
            relaxation.begin(start)
        return relaxation


def _players(world: World, schema: ActionSchema) -> int:
    kinds = world.task.domain.player_types
    return sum(kind in kinds for _, kind in schema.parameters)


def _relaxed(world: World, start: State) -> list[GoalTerm]:
    try:
        relaxation = Relaxation(world, start)
    except TooLargeError:
        return []
    return [term for term in world.goal.terms if not relaxation.may_come_true(term)]


def _visited(world: World, start: State, limits: Limits) -> list[GoalTerm]:
    mask = world.goal.possible_mask
    moves = Transitions(world).moves
    fluents = world.table.fluents
    never = [term for term in world.goal.terms if term.predicate in fluents]
    known = {start}
    frontier = [start]
    expansions = 0
    while frontier and never:
        if limits.reached(expansions, len(known)):
            return []
        state = frontier.pop()
        expansions += 1
        never = [term for term in never if not state.facts & mask(term)]
        for facts, timers, _ in moves(state.facts, state.timers):
            after = State(world, facts, timers)
            if after not in known:
                known.add(after)
                frontier.append(after)
    return never


def _in_words(world: World, term: GoalTerm) -> str:
    return describe(world.task.domain, (term.predicate, *term.args))
