"""Parts of a world that both encodings share: types, facts, actions and timers over variables."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import combinations, pairwise, product

from robotouille.domain.schema import Creation, EffectDef
from robotouille.planning.pddl.syntax import Literal, PddlAction, PddlEffect, Term, Variable
from robotouille.planning.pddl.timer_facts import QUIET, TimerFacts, TimerPart, literals
from robotouille.planning.solvers import check_has_goal
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.objects import Object
from robotouille.world.world import World

SEAT = "~seat"
THERE = "~there"


def roomy(world: World, created: int | None = None) -> World:
    """Return a world of the same task with room for created objects of each kind.

    The default is one more than the goal mentions, and at least two.
    """
    own = World(world.task)
    wanted = [variable.kind for variable in own.goal.variables.values()]
    placed = [thing.kind for thing in own.placed]
    bounds = {}
    for effect in _creations(own):
        kind = effect.created_obj.name
        number = max(2, wanted.count(kind) + 1) if created is None else created
        bounds[kind] = placed.count(kind) + number
    own.make_room(bounds)
    return own


def _creations(world: World) -> Iterator[Creation]:
    for schema in world.schemas:
        effects = _walk(schema.definition.sfx)
        yield from (effect for effect in effects if isinstance(effect, Creation))


def _walk(effects: tuple[EffectDef, ...]) -> Iterator[EffectDef]:
    for effect in effects:
        yield effect
        yield from _walk(effect.sfx)


def fresh(kind: str) -> str:
    """Return the predicate of the next created object of a kind."""
    return f"~next-{kind}"


def follows(kind: str) -> str:
    """Return the predicate that one object of a kind is created after another."""
    return f"~follows-{kind}"


class Lifted:
    """A world over variables, with room for created objects."""

    def __init__(self, world: World) -> None:
        check_has_goal(world)
        self.world = world
        self.transient = world.table.transient
        self.schemas = tuple(schema for schema in world.schemas if not _is_idle(schema))
        self.own = {s.name: tuple(self._timers(s, born=False)) for s in self.schemas}
        born = [timer for s in self.schemas for timer in self._timers(s, born=True)]
        self.timers = (*(t for timers in self.own.values() for t in timers), *born)
        self.born = {id(timer.definition): timer for timer in born}
        self.created: dict[str, list[Object]] = {}
        for thing in world.all_objects():
            if thing.tile is None:
                self.created.setdefault(thing.kind, []).append(thing)

    def _timers(self, schema: ActionSchema, *, born: bool) -> Iterator[TimerFacts]:
        types = dict(schema.parameters)
        for effect in _walk(schema.definition.sfx):
            if isinstance(effect, Creation):
                types[effect.created_obj.param] = effect.created_obj.type
        for index, found in enumerate(schema.all_effects):
            if (index >= len(schema.effects)) == born:
                variables = tuple((f"?{name}", f"={types[name]}") for name in found.variables)
                yield TimerFacts(schema.name, index, variables, found.definition)

    @property
    def instants(self) -> list[tuple[TimerFacts, TimerPart]]:
        """The creations and deletions."""
        return [(timer, part) for timer in self.timers for part in timer.parts if part.instant]

    @cached_property
    def types(self) -> dict[str, str]:
        """The world's types with their supertypes."""
        domain = self.world.task.domain
        above = {t: SEAT if t in domain.player_types else "object" for t in domain.object_types}
        return {f"={kind}": supertype for kind, supertype in above.items()}

    @cached_property
    def predicates(self) -> dict[str, tuple[str, ...]]:
        """Every predicate of the world, its timers and its bookkeeping, with its types."""
        found = {name: typed(*types) for name, types in self.world.table.types.items()}
        if self.transient:
            found[THERE] = ("object",)
        for kind, things in self.created.items():
            found[fresh(kind)] = typed(things[0].type)
            found[follows(kind)] = typed(things[0].type, things[0].type)
        for timer in self.timers:
            found.update(timer.predicates)
        return found

    @cached_property
    def dues(self) -> tuple[Term, ...]:
        """Possible due creations and deletions, as far as static facts allow."""
        return tuple(term for timer, part in self.instants for term in self._dues(timer, part))

    def _dues(self, timer: TimerFacts, part: TimerPart) -> Iterator[Term]:
        table = self.world.table
        names = [name for name, _ in timer.variables]
        definition = next(s.definition for s in self.schemas if s.name == timer.action)
        static = [
            (term, value)
            for term, value in literals(definition.precons)
            if term[0] in table.static_predicates and set(term[1:]) <= set(names)
        ]
        pools = [table.by_type[kind.removeprefix("=")] for _, kind in timer.variables]
        for values in product(*pools):
            chosen = dict(zip(names, values, strict=True))
            if all(((t[0], *(chosen[a] for a in t[1:])) in table.static) == v for t, v in static):
                yield (timer.due(part)[0], *values)

    @property
    def constants(self) -> tuple[Variable, ...]:
        """Objects that actions name, because a creation or deletion may be about them."""
        named = {name for term in self.dues for name in term[1:]}
        return tuple(pair for pair in self._objects if pair[0] in named)

    @property
    def objects(self) -> tuple[Variable, ...]:
        """Objects that only the problem names."""
        return tuple(pair for pair in self._objects if pair not in self.constants)

    @property
    def _objects(self) -> tuple[Variable, ...]:
        return tuple((thing.name, f"={thing.type}") for thing in self.world.all_objects())

    def facts(self) -> Iterator[Term]:
        """Yield the initial facts, the existing objects, and the order of created objects."""
        yield from self.world.initial.atoms()
        for thing in self.world.placed:
            if thing.type in self.transient:
                yield (THERE, thing.name)
        for kind, things in self.created.items():
            yield (fresh(kind), things[0].name)
            for first, second in pairwise(things):
                yield (follows(kind), first.name, second.name)
        if self.instants:
            yield QUIET

    def bounds(self) -> Iterator[str]:
        """Yield the maximum numbers of created objects, in words."""
        for kind, things in self.created.items():
            yield f"Bound: at most {len(things)} of {kind} are created."

    def last_counts(self) -> Iterator[tuple[Term, int]]:
        """Yield the term of each part's last count without its number, and the number."""
        for timer in self.timers:
            for part in (p for p in timer.parts if p.counts):
                kind = dict(timer.variables)[part.subject].removeprefix("=")
                for name in self.world.table.by_type[kind]:
                    total = self.world._count(part.definition, name)
                    yield timer.last(part, name, "")[:2], total - 1

    def parameters(self, schema: ActionSchema) -> tuple[Variable, ...]:
        return tuple((f"?{name}", f"={kind}") for name, kind in schema.parameters)

    def condition(self, schema: ActionSchema) -> tuple[Literal, ...]:
        """Return the preconditions of an action, including that its arguments exist."""
        there = (
            ((THERE, f"?{name}"), True)
            for name, kind in schema.parameters
            if kind in self.transient
        )
        return (*literals(schema.definition.precons), *there)


def typed(*kinds: str) -> tuple[str, ...]:
    """Return the world's types, marked to differ from the encoding's own types."""
    return tuple(f"={kind}" for kind in kinds)


def _is_idle(schema: ActionSchema) -> bool:
    """Return whether an action is always possible and does nothing, like `wait`."""
    definition = schema.definition
    return not (definition.precons or definition.immediate_fx or definition.sfx)


DONE: Term = ("~done",)


def finish(
    lifted: Lifted, parameters: tuple[Variable, ...] = (), condition: tuple[Literal, ...] = ()
) -> PddlAction:
    """Return the action that ends a plan if some choice of objects meets the goal.

    `condition`, over `parameters`, is an additional precondition.
    """
    goal = lifted.world.goal
    variables: tuple[Variable, ...] = tuple((_name(i), _type(lifted, i)) for i in goal.variables)
    chosen = [((_may_be(i), _name(i)), True) for i in goal.variables]
    wanted = [((t.predicate, *map(_name, t.ids)), True) for t in goal.terms]
    different = [
        (("=", _name(one.id), _name(other.id)), False)
        for one, other in combinations(goal.variables.values(), 2)
        if one.kind == other.kind
    ]
    there = [((THERE, name), True) for name in _must_exist(lifted)]
    literals: tuple[Literal, ...] = (*condition, *wanted, *chosen, *there, *different)
    return PddlAction(
        "~finish", (*parameters, *variables), literals, (PddlEffect(((DONE, True),)),)
    )


def candidate_predicates(lifted: Lifted) -> dict[str, tuple[str, ...]]:
    """Return for each variable of the goal a predicate of its possible objects."""
    return {_may_be(i): (_type(lifted, i),) for i in lifted.world.goal.variables}


def candidate_facts(lifted: Lifted) -> Iterator[Term]:
    """Yield the possible objects of the goal's variables."""
    goal = lifted.world.goal
    for identifier in goal.variables:
        kind = _type(lifted, identifier)
        for name in goal.candidates(identifier):
            if f"={lifted.world.thing(name).type}" == kind:
                yield (_may_be(identifier), name)


def _must_exist(lifted: Lifted) -> list[str]:
    """Return the goal's variables that need an explicit test for existence."""
    # Static facts stay true in PDDL when their object is deleted.
    static = lifted.world.table.static_predicates
    terms = [t for t in lifted.world.goal.terms if t.predicate in static]
    names = dict.fromkeys(i for term in terms for i in term.ids)
    return [_name(i) for i in names if _type(lifted, i).removeprefix("=") in lifted.transient]


def _name(identifier: int | str) -> str:
    return f"?~g{identifier}"


def _may_be(identifier: int | str) -> str:
    return f"~goal-{identifier}"


def _type(lifted: Lifted, identifier: int | str) -> str:
    for term in lifted.world.goal.terms:
        if identifier in term.ids:
            return lifted.predicates[term.predicate][term.ids.index(identifier)]
    raise KeyError(identifier)
