"""The delete relaxation of a domain: what can become true if nothing were ever undone.

Actions are grounded over abstract objects: the existing ones, and one future object for all objects
that play can create of a kind.

A *proposition* is a true fact (`+`), a false fact (`-`), or progress of a special effect: it runs,
its condition holds, or its action was performed a number of times. Once reached, a proposition
stays. Actions and updates of effects become *operators*. An action costs 1 and an update 0, so a
shortest path of operators is never longer than a real plan.

* A conditional takes effect if its conditions are reached. If it can stop holding, its results are
  undone as well.
* A delay costs nothing, but `RelaxedOperator.delay` contains its length.
* One repetitive effect of each action counts performances. Any other one takes effect at the first
  performance.
* A creation adds the one object that stands for all future ones of its kind. Every real course of
  play becomes one of operators if created objects are renamed to it.
* A deletion makes every fact about its object false, which effects updated at the same time may
  test. It leaves true facts true.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import count
from math import prod
from typing import Any

from robotouille.domain.schema import (
    Condition,
    Conditional,
    CountedEffect,
    Creation,
    Delayed,
    Deletion,
    EffectDef,
    InstantEffect,
    Repetitive,
)
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.atoms import EXISTS, AtomTable
from robotouille.world.grounding.objects import Atom, bound
from robotouille.world.world import World


@dataclass(frozen=True, slots=True)
class AbstractObject:
    """An object by name, kind and type. A `future` object stands for all that will be created."""

    name: str
    kind: str
    type: str
    future: bool


@dataclass(frozen=True)
class AbstractObjects:
    """The objects of a relaxation."""

    members: tuple[AbstractObject, ...]

    @cached_property
    def by_name(self) -> dict[str, AbstractObject]:
        return {member.name: member for member in self.members}

    @cached_property
    def future(self) -> frozenset[str]:
        """Names that stand for objects to be created."""
        return frozenset(m.name for m in self.members if m.future)

    def of_type(self, kind: str) -> list[str]:
        return [m.name for m in self.members if m.type == kind]


def abstract_objects(world: World, facts: int) -> AbstractObjects:
    """Return the objects that exist in `facts` and one future object of each creatable kind."""
    present = [AbstractObject(o.name, o.kind, o.type, False) for o in world.objects_in(facts)]
    created = {
        (effect.created_obj.name, effect.created_obj.type)
        for schema in world.schemas
        for effect in _walk(schema.definition.sfx)
        if isinstance(effect, Creation)
    }
    future = [AbstractObject(future_name(kind, of), kind, of, True) for kind, of in sorted(created)]
    return AbstractObjects((*present, *future))


def future_name(kind: str, type_: str) -> str:
    """Return a name that no object has."""
    return f"{kind}+{type_}"


def _walk(effects: tuple[EffectDef, ...]) -> Iterator[EffectDef]:
    for effect in effects:
        yield effect
        yield from _walk(effect.sfx)


MAX_CHOICES = 100_000


class TooLargeError(ValueError):
    """A task has too many ground actions for a useful relaxation."""


class Grounding:
    """Grounds action schemas and resolves conditions on static predicates."""

    def __init__(self, table: AtomTable, objects: AbstractObjects) -> None:
        self._table = table
        self._objects = objects

    def bindings(self, schema: ActionSchema) -> Iterator[dict[str, str]]:
        """Yield arguments for an action's parameters.

        Raises:
            TooLargeError: There are more than MAX_CHOICES choices.
        """
        static = [c for c in schema.definition.precons if self.is_static(c)]
        pools = [
            [
                choice
                for choice in self._objects.of_type(kind)
                if all(
                    self.static_holds(c, {name: choice}) for c in static if set(c.params) == {name}
                )
            ]
            for name, kind in schema.parameters
        ]
        if prod(map(len, pools)) > MAX_CHOICES:
            raise TooLargeError(f"more than {MAX_CHOICES} choices of arguments of {schema.name}")
        yield from self._choose(schema, pools, static, {})

    def _choose(
        self,
        schema: ActionSchema,
        pools: list[list[str]],
        static: list[Condition],
        binding: dict[str, str],
    ) -> Iterator[dict[str, str]]:
        if not all(
            self.static_holds(c, binding)
            for c in static
            if all(name in binding for name in c.params)
        ):
            return
        if len(binding) == len(pools):
            yield binding
            return
        name, _ = schema.parameters[len(binding)]
        for choice in pools[len(binding)]:
            yield from self._choose(schema, pools, static, {**binding, name: choice})

    def is_static(self, condition: Condition) -> bool:
        return condition.predicate in self._table.static_predicates

    def static_holds(self, condition: Condition, binding: dict[str, str]) -> bool:
        return (bound(condition, binding) in self._table.static) == condition.is_true


# Performances beyond this number are not counted. The bound stays valid, only lower.
MAX_COUNTED = 64

Prop = tuple[Any, ...]
Label = tuple[str, int, tuple[str, ...]]
Binding = dict[str, str]


@dataclass(slots=True)
class RelaxedOperator:
    """An operator: if all `preconditions` are reached, so are all `add_effects`.

    `cost` is 1 for an action and 0 for an update. `delay` is the number of steps of the delayed
    effect that `clock` identifies.
    """

    preconditions: list[Prop]
    add_effects: list[Prop]
    cost: int = 0
    delay: int = 0
    clock: tuple[Label, int] | None = None


@dataclass
class RelaxedOperators:
    """The operators of a world's domain over some objects, without the goal."""

    world: World
    objects: AbstractObjects
    operators: list[RelaxedOperator] = field(default_factory=list)
    labels: set[Label] = field(default_factory=set)
    totals: dict[tuple[Label, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._table = self.world.table
        self._grounding = Grounding(self._table, self.objects)
        self._schemas = {schema.name: schema for schema in self.world.schemas}
        self._origins = {
            id(effect.definition): (schema, index)
            for schema in self.world.schemas
            for index, effect in enumerate(schema.all_effects)
        }
        self._deletions: list[tuple[RelaxedOperator, str]] = []

    def write(self, running: Iterable[Label]) -> None:
        """Write all operators, also of effects in `running` that no action starts."""
        for schema in self.world.schemas:
            for binding in self._grounding.bindings(schema):
                self._write_action(schema, binding)
        for name, index, arguments in running:
            schema = self._schemas[name]
            variables = schema.all_effects[index].variables
            self._effect(schema, index, dict(zip(variables, arguments, strict=True)))
        self._forget_the_deleted()

    # Actions

    def _write_action(self, schema: ActionSchema, binding: Binding) -> None:
        preconditions = self.conditions(schema.definition.precons, binding)
        if preconditions is None:
            return
        preconditions += [("+", (EXISTS, a)) for a in binding.values() if a in self.objects.future]
        add_effects = self.results(schema.definition.immediate_fx, binding)
        add_effects += [self._effect(schema, i, binding) for i in range(len(schema.effects))]
        counted = self._counted(schema, binding)
        if counted is None:
            self.operators.append(RelaxedOperator(preconditions, add_effects, cost=1))
            return
        for number in range(1, self.totals[counted] + 1):
            before: list[Prop] = [("count", *counted, number - 1)] if number > 1 else []
            after: Prop = ("count", *counted, number)
            self.operators.append(
                RelaxedOperator([*preconditions, *before], [*add_effects, after], cost=1)
            )

    def _counted(self, schema: ActionSchema, binding: Binding) -> tuple[Label, int] | None:
        """Return the repetitive effect of an action whose performances are counted."""
        place = _counted_place(schema)
        return (self._label(schema, place[0], binding), place[1]) if place else None

    def conditions(self, conditions: Iterable[Condition], binding: Binding) -> list[Prop] | None:
        """Return the propositions of some conditions, or None if they never hold together."""
        preconditions: list[Prop] = []
        for condition in conditions:
            atom = bound(condition, binding)
            if self._grounding.is_static(condition):
                # A fact that is always true becomes false only by a deletion.
                if self._grounding.static_holds(condition, binding):
                    continue
                if condition.is_true:
                    return None
            preconditions.append(("+" if condition.is_true else "-", atom))
            opposite = ("-" if condition.is_true else "+", atom)
            if opposite in preconditions and not self.is_future(atom):
                return None
        return preconditions

    def results(self, fx: Iterable[Condition], binding: Binding) -> list[Prop]:
        """Return the facts made true and false."""
        # True wins, unless an argument is a future object, which stands for several.
        sets = [bound(c, binding) for c in fx if c.is_true]
        clears = [bound(c, binding) for c in fx if not c.is_true]
        return [
            *(("+", atom) for atom in sets),
            *(("-", atom) for atom in clears if atom not in sets or self.is_future(atom)),
        ]

    def is_future(self, atom: Atom) -> bool:
        return any(name in self.objects.future for name in atom[1:])

    # Effects

    def _label(self, schema: ActionSchema, index: int, binding: Binding) -> Label:
        variables = schema.all_effects[index].variables
        return schema.name, index, tuple(binding[name] for name in variables)

    def _effect(self, schema: ActionSchema, index: int, binding: Binding) -> Prop:
        """Return the proposition that an effect runs. The first call writes its operators."""
        label = self._label(schema, index, binding)
        if label not in self.labels:
            self.labels.add(label)
            place = _counted_place(schema)
            counted = place[1] if place is not None and place[0] == index else None
            writer = _EffectWriter(self, label, counted, index < len(schema.effects))
            writer.write(schema.all_effects[index].definition, binding)
        return ("runs", label, 0)

    def born(self, definition: EffectDef, binding: Binding) -> Prop:
        """Return the proposition of an effect nested in a creation or deletion.

        The nested effect becomes an effect of its own.
        """
        schema, index = self._origins[id(definition)]
        return self._effect(schema, index, binding)

    def deletes(self, operator: RelaxedOperator, subject: str) -> None:
        self._deletions.append((operator, subject))

    def _forget_the_deleted(self) -> None:
        """Let deletions make false all required facts about their object."""
        asked_for = (need for operator in self.operators for need in operator.preconditions)
        asked = dict.fromkeys(need for need in asked_for if need[0] == "-")
        for operator, subject in self._deletions:
            operator.add_effects += [need for need in asked if subject in need[1][1:]]


class _EffectWriter:
    """Writer of the operators of one effect's tree. Nodes have the same numbers as in the world."""

    def __init__(
        self, relaxed: RelaxedOperators, label: Label, counted: int | None, active: bool
    ) -> None:
        self._relaxed = relaxed
        self._label = label
        self._counted = counted
        self._active = active
        self._slots = count()

    def write(self, definition: EffectDef, binding: Binding) -> Prop:
        """Write a node and its nested nodes. Return the proposition that the node is updated."""
        slot = next(self._slots)
        runs: Prop = ("runs", self._label, slot)
        if isinstance(definition, Creation):
            self._creation(definition, runs, binding)
        elif isinstance(definition, Deletion):
            nested = [self._relaxed.born(inner, binding) for inner in definition.sfx]
            operator = self._operator([runs], definition.fx, binding, nested)
            self._relaxed.deletes(operator, binding[definition.param])
        else:
            nested = [self.write(inner, binding) for inner in definition.sfx]
            self._timed(definition, slot, runs, binding, nested)
        return runs

    def _timed(
        self,
        definition: EffectDef,
        slot: int,
        runs: Prop,
        binding: Binding,
        nested: list[Prop],
    ) -> None:
        if isinstance(definition, Conditional):
            self._conditional(definition, slot, runs, binding, nested)
        elif isinstance(definition, Delayed):
            operator = self._operator([runs], definition.fx, binding, nested)
            factor = self._relaxed.world.task.profile.delay_factor
            operator.delay = self._updates(definition, binding) * factor
            operator.clock = (self._label, slot)
        elif not isinstance(definition, Repetitive):
            # Nothing is known here about a new kind of effect, so it may change its facts both ways
            # at any time. That keeps the heuristics admissible.
            self._operator([runs], [*definition.fx, *_negated(definition.fx)], binding, nested)
        elif slot == self._counted:
            total = max(1, min(MAX_COUNTED, self._updates(definition, binding)))
            self._relaxed.totals[self._label, slot] = total
            performed: Prop = ("count", self._label, slot, total)
            self._operator([runs, performed], definition.fx, binding, nested)
        elif self._active:
            self._operator([runs], definition.fx, binding, nested)

    def _conditional(
        self, definition: Conditional, slot: int, runs: Prop, binding: Binding, nested: list[Prop]
    ) -> None:
        holds: Prop = ("holds", self._label, slot)
        undone = _negated(definition.fx)
        if nested:
            true = {bound(c, binding) for c in definition.fx if c.is_true}
            sets = {atom for atom in true if not self._relaxed.is_future(atom)}
            settled = [c for c in undone if not c.is_true or bound(c, binding) not in sets]
            self._operator([holds], settled, binding, [])
        preconditions = self._relaxed.conditions(definition.conditions, binding)
        if preconditions is not None:
            self._operator([runs, *preconditions], definition.fx, binding, [*nested, holds])

    def _creation(self, definition: Creation, runs: Prop, binding: Binding) -> None:
        created = definition.created_obj
        name = future_name(created.name, created.type)
        inner = {**binding, created.param: name}
        nested = [self._relaxed.born(effect, inner) for effect in definition.sfx]
        self._operator([runs], definition.fx, inner, [("+", (EXISTS, name)), *nested])

    def _operator(
        self, preconditions: list[Prop], fx: Iterable[Condition], binding: Binding, more: list[Prop]
    ) -> RelaxedOperator:
        operator = RelaxedOperator(preconditions, [*self._relaxed.results(fx, binding), *more])
        self._relaxed.operators.append(operator)
        return operator

    def _updates(self, definition: CountedEffect, binding: Binding) -> int:
        """Return the number of updates, a lower bound if the object does not exist yet."""
        config = self._relaxed.world.task.problem.config
        table = config.get(definition.config, {}) if definition.config is not None else {}
        member = self._relaxed.objects.by_name[binding[definition.param]]
        if member.future:
            return min([definition.default, *table.values()])
        for key in (member.name, member.kind, "default"):
            if key in table:
                return table[key]
        return definition.default


def _negated(fx: Iterable[Condition]) -> list[Condition]:
    return [c.model_copy(update={"is_true": not c.is_true}) for c in fx]


def _counted_place(schema: ActionSchema) -> tuple[int, int] | None:
    """Return the counted repetitive effect of an action: its index and the node's slot."""
    for index, effect in enumerate(schema.effects):
        for slot, node in enumerate(_nodes(effect.definition)):
            if isinstance(node, Repetitive):
                return index, slot
    return None


def _nodes(effect: EffectDef) -> Iterator[EffectDef]:
    """Yield the nodes of an effect with a counter.

    Nodes that become effects of their own are left out.
    """
    yield effect
    if not isinstance(effect, InstantEffect):
        for inner in effect.sfx:
            yield from _nodes(inner)
