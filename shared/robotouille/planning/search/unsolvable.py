"""Why there is no plan: the parts of a goal that nothing can bring about."""

from __future__ import annotations

from collections.abc import Collection

from robotouille.domain.schema import GoalTerm
from robotouille.planning.search.joint_actions import Transitions
from robotouille.planning.search.relaxation.relaxed_task import Relaxation
from robotouille.planning.search.relaxation.schema_grounding import TooLargeError
from robotouille.planning.search_result import Limits
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.text import describe
from robotouille.world.world import State, World

__all__ = ["CutOff", "unreachable_goal"]

EXHAUSTIVE = Limits(states=100_000)


def unreachable_goal(
    world: World, state: State | None = None, *, limits: Limits = EXHAUSTIVE
) -> tuple[str, ...]:
    """The predicates of the goal, in words, that cannot come true from a state.

    First those that cannot even if nothing is ever undone. If there are none, every state is
    visited, and those that held in none of them are named; nothing is if the limits are too
    narrow for that, or if each comes true but never all at once.
    """
    start = world.initial if state is None else state
    terms = _relaxed(world, start) or _visited(world, start, limits)
    return tuple(dict.fromkeys(_in_words(world, term) for term in terms))


class CutOff:
    """Tells of the states of one world whether a team cannot reach the goal while all others stand
    still. What is asked first takes most time: what is made for it is kept."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._acted_on = any(_players(world, schema) > 1 for schema in world.schemas)
        self._relaxations: dict[tuple[int, int], Relaxation] = {}

    def __call__(self, state: State, team: Collection[str]) -> bool:
        """Whether that is proven: not even if nothing is ever undone. Where players act on one
        another nothing is."""
        others = frozenset(self._world.players) - set(team)
        if not others or self._acted_on:
            return False
        facts = state.facts
        for player in others:  # Who is nowhere and has nothing can do nothing, and leaves nothing.
            facts &= ~self._world.table.mentions(player)
        try:
            relaxation = self._begin(State(self._world, facts, state.timers))
        except TooLargeError:
            return False
        if not all(relaxation.may_come_true(term) for term in self._world.goal.terms):
            return True
        return not relaxation.may_reach_goal(facts)

    def _begin(self, start: State) -> Relaxation:
        """A relaxation is of the objects that exist, and those that there is room for."""
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
        if _beyond(limits, expansions, len(known)):
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


def _beyond(limits: Limits, expansions: int, states: int) -> bool:
    if limits.expansions is not None and expansions >= limits.expansions:
        return True
    if limits.states is not None and states >= limits.states:
        return True
    return limits.stop is not None and not expansions % 256 and limits.stop()


def _in_words(world: World, term: GoalTerm) -> str:
    return describe(world.task.domain, (term.predicate, *term.args))
