"""What both encodings say of a world: its types, facts, actions and timers over variables."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise, product

from robotouille.domain.schema import Creation, EffectDef
from robotouille.planning.pddl.lifting.timer_facts import QUIET, TimerFacts, TimerPart, literals
from robotouille.planning.pddl.syntax import Literal, Term, Variable
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.objects import Object
from robotouille.world.world import World

__all__ = ["SEAT", "THERE", "Lifted", "follows", "fresh", "roomy"]

SEAT = "~seat"
THERE = "~there"


def roomy(world: World, created: int | None = None) -> World:
    """A world of the same task with room for a number of created objects of each kind.

    By default one more than the goal speaks of, and at least two.
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
    """The predicate of the object of a kind that is created next."""
    return f"~next-{kind}"


def follows(kind: str) -> str:
    """The predicate of two objects of a kind of which the second is created after the first."""
    return f"~follows-{kind}"


class Lifted:
    """A world (with room for what play creates) over variables."""

    def __init__(self, world: World) -> None:
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
        """The world's types with the types above them."""
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
        """What can be due of creations and deletions, as far as static facts allow."""
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
        """The objects that actions name: those of which something can be due."""
        named = {name for term in self.dues for name in term[1:]}
        return tuple(pair for pair in self._objects if pair[0] in named)

    @property
    def objects(self) -> tuple[Variable, ...]:
        """The objects that only the problem names."""
        return tuple(pair for pair in self._objects if pair not in self.constants)

    @property
    def _objects(self) -> tuple[Variable, ...]:
        return tuple((thing.name, f"={thing.type}") for thing in self.world.all_objects())

    def facts(self) -> Iterator[Term]:
        """What is true at first: the initial facts, what exists, and what is created next."""
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
        """How many objects can be created, in words."""
        for kind, things in self.created.items():
            yield f"Bound: at most {len(things)} of {kind} are created."

    def last_counts(self) -> Iterator[tuple[Term, int]]:
        """Of every part that counts and every subject: the term that tells its last count but
        for the number, and that number."""
        for timer in self.timers:
            for part in (p for p in timer.parts if p.counts):
                kind = dict(timer.variables)[part.subject].removeprefix("=")
                for name in self.world.table.by_type[kind]:
                    total = self.world._count(part.definition, name)
                    yield timer.last(part, name, "")[:2], total - 1

    def parameters(self, schema: ActionSchema) -> tuple[Variable, ...]:
        return tuple((f"?{name}", f"={kind}") for name, kind in schema.parameters)

    def condition(self, schema: ActionSchema) -> tuple[Literal, ...]:
        """The preconditions of an action, the existence of its arguments included."""
        there = (
            ((THERE, f"?{name}"), True)
            for name, kind in schema.parameters
            if kind in self.transient
        )
        return (*literals(schema.definition.precons), *there)


def typed(*kinds: str) -> tuple[str, ...]:
    """The world's types, told from the encoding's own."""
    return tuple(f"={kind}" for kind in kinds)


def _is_idle(schema: ActionSchema) -> bool:
    """Whether an action may be taken at any time and does nothing, as `wait` does."""
    definition = schema.definition
    return not (definition.precons or definition.immediate_fx or definition.sfx)
