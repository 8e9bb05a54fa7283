"""What kind of thing an action is, told from the domain alone: no kitchen words here."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.domain.schema import Creation, Delayed, EffectDef
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World

__all__ = [
    "is_asynchronous",
    "is_joining",
    "is_travel",
    "is_waiting",
    "is_work",
    "needs_asynchronous_work",
    "work_stations",
]


def is_waiting(action: GroundAction) -> bool:
    """Whether it lets time pass and does nothing else, as `wait` does."""
    definition = action.schema.definition
    return not (definition.precons or definition.immediate_fx or definition.sfx)


def is_travel(action: GroundAction) -> bool:
    """Whether it takes a player from one station to another, as `move` does."""
    return action.destination is not None


def is_asynchronous(action: GroundAction) -> bool:
    """Whether it starts what then goes on by itself for some steps: cook, fry, fill, boil.

    With a delay of 0 it does not: that is one update of the effect.
    """
    return any(
        node.kind == "delayed" and node.total > 1
        for effect in action.effects
        for node in effect.counters()
    )


def is_joining(action: GroundAction) -> bool:
    """Whether it puts one thing to another: stack, add to a soup, pour into a bowl."""
    domain = action.source.task.domain
    places = {*domain.station_types, *domain.player_types}
    types = {p.name: p.param_types for p in domain.predicate_defs}
    return any(
        fact.is_true
        and len(types[fact.predicate]) > 1
        and not places.intersection(types[fact.predicate])
        for fact in action.schema.definition.immediate_fx
    )


def is_work(action: GroundAction) -> bool:
    """Whether it prepares or joins things: what a recipe speaks of, unlike walking and carrying."""
    return bool(action.schema.definition.sfx) or is_joining(action)


def work_stations(world: World) -> frozenset[str]:
    """The stations at which something can be prepared: those for which an action with a special
    effect asks by a predicate that never changes, as `isboard`, `isstove`."""
    kinds = set()
    for schema in world.schemas:
        if schema.definition.sfx:
            for condition in schema.definition.precons:
                static = condition.predicate in world.table.static_predicates
                if static and len(condition.params) == 1 and condition.is_true:
                    kinds.add(condition.predicate)
    stations = set(world.task.domain.station_types)
    return frozenset(
        thing.name
        for thing in world.placed
        if thing.type in stations and any((k, thing.name) in world.table.static for k in kinds)
    )


def needs_asynchronous_work(world: World) -> bool:
    """Whether the goal asks for more than there is at first of something that only a delay with
    more than 0 steps brings about."""
    brought = _brought_by_delays(world)
    wanted: dict[tuple[str, tuple[str, ...]], int] = {}
    there: dict[tuple[str, tuple[str, ...]], int] = {}
    for term in set(world.goal.terms):
        if term.predicate in brought or brought.intersection(term.args):
            key = (term.predicate, term.args)
            wanted[key] = wanted.get(key, 0) + 1
            mask = world.goal.possible_mask(term)
            there[key] = there.get(key, 0) | (world.initial.facts & mask)
    return any(count > there[key].bit_count() for key, count in wanted.items())


def _brought_by_delays(world: World) -> frozenset[str]:
    """The predicates and kinds of objects that delays bring about, without those of 0 steps."""
    found: set[str] = set()

    def walk(effects: Iterable[EffectDef], delayed: bool) -> None:
        for effect in effects:
            late = delayed or (isinstance(effect, Delayed) and _steps(world, effect) > 0)
            if late:
                found.update(fact.predicate for fact in effect.fx if fact.is_true)
                if isinstance(effect, Creation):
                    found.add(effect.created_obj.name)
            walk(effect.sfx, late)

    for schema in world.schemas:
        walk(schema.definition.sfx, False)
    return frozenset(found)


def _steps(world: World, effect: Delayed) -> int:
    """The longest that a delay takes for any object of the task, in its own steps."""
    table = world.task.problem.config.get(effect.config or "", {})
    return max(table.values(), default=effect.default)
