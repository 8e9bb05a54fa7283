"""The delete relaxation of a domain: what can come true by what, if nothing were ever undone.

A *proposition* is a fact that is true (`+`), a fact that is false (`-`), or progress of a special
effect: it runs, its condition holds, it has been performed so often. Once reached, a proposition
stays. Actions and updates of effects become *operators*: an action costs 1, an update nothing, so
that a shortest way to the goal by operators is never longer than a real plan.

* A conditional takes effect if its conditions are reached. If it can stop holding, its results
  are undone as well.
* A delay costs nothing, but `RelaxedOperator.delay` tells how long it takes.
* One repetitive effect of each action counts performances; any further one fires at the first.
* A creation brings in the one object that stands for all future ones of its kind: every real
  course of play becomes one of operators if created objects are renamed to it.
* A deletion makes every fact about its object false (effects updated in the same breath may test
  that), but leaves the true ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from robotouille.domain.schema import (
    Condition,
    Conditional,
    Creation,
    Delayed,
    Deletion,
    EffectDef,
    Repetitive,
)
from robotouille.planning.search.relaxation.abstract_objects import AbstractObjects, future_name
from robotouille.planning.search.relaxation.schema_grounding import Grounding
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.objects import Atom, bound
from robotouille.world.world import World

__all__ = ["MAX_COUNTED", "Label", "Prop", "RelaxedOperator", "RelaxedOperators"]

MAX_COUNTED = 64
"""Performances of an action that are told apart; of more, the bound counts only so many."""

Prop = tuple[Any, ...]
Label = tuple[str, int, tuple[str, ...]]
Binding = dict[str, str]


@dataclass(slots=True)
class RelaxedOperator:
    """If all of `preconditions` are reached, so are all of `add_effects`.

    `cost` is 1 for an action, 0 for what the world does by itself. `delay` is the number of steps
    that a delayed effect waits; `clock` says which.
    """

    preconditions: list[Prop]
    add_effects: list[Prop]
    cost: int = 0
    delay: int = 0
    clock: tuple[Label, int] | None = None


@dataclass
class RelaxedOperators:
    """The operators of a world's domain over some objects, the goal apart."""

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
        """Write all operators; effects in `running` are included even if no action starts them."""
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
        """The repetitive effect of an action whose performances are counted."""
        place = _counted_place(schema)
        return (self._label(schema, place[0], binding), place[1]) if place else None

    def conditions(self, conditions: Iterable[Condition], binding: Binding) -> list[Prop] | None:
        """The propositions that conditions ask for; None if they can never hold together.

        What is always true becomes false by a deletion only.
        """
        preconditions: list[Prop] = []
        for condition in conditions:
            atom = bound(condition, binding)
            if self._grounding.is_static(condition):
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
        """What is made true and false; where both, true wins, unless an argument is many."""
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
        """The proposition that an effect runs; its operators are written when first asked for."""
        label = self._label(schema, index, binding)
        if label not in self.labels:
            self.labels.add(label)
            place = _counted_place(schema)
            counted = place[1] if place is not None and place[0] == index else None
            writer = _EffectWriter(self, label, counted, index < len(schema.effects))
            writer.write(schema.all_effects[index].definition, binding)
        return ("runs", label, 0)

    def born(self, definition: EffectDef, binding: Binding) -> Prop:
        """An effect nested in a creation or deletion goes on as one of its own."""
        schema, index = self._origins[id(definition)]
        return self._effect(schema, index, binding)

    def deletes(self, operator: RelaxedOperator, subject: str) -> None:
        self._deletions.append((operator, subject))

    def _forget_the_deleted(self) -> None:
        """Let deletions add the falsehood of all facts about their object that anything asks."""
        asked_for = (need for operator in self.operators for need in operator.preconditions)
        asked = dict.fromkeys(need for need in asked_for if need[0] == "-")
        for operator, subject in self._deletions:
            operator.add_effects += [need for need in asked if subject in need[1][1:]]


class _EffectWriter:
    """Writes the operators of one effect's tree, its nodes numbered as the world numbers them."""

    def __init__(
        self, relaxed: RelaxedOperators, label: Label, counted: int | None, active: bool
    ) -> None:
        self._relaxed = relaxed
        self._label = label
        self._counted = counted
        self._active = active
        self._slots = count()

    def write(self, definition: EffectDef, binding: Binding) -> Prop:
        """Write a node and what is nested in it; the proposition that the node gets updates."""
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
        definition: Conditional | Delayed | Repetitive,
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
        undone = [c.model_copy(update={"is_true": not c.is_true}) for c in definition.fx]
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

    def _updates(self, definition: Delayed | Repetitive, binding: Binding) -> int:
        """How often (a lower bound, if the object is yet to be created)."""
        config = self._relaxed.world.task.problem.config
        table = config.get(definition.config, {}) if definition.config is not None else {}
        member = self._relaxed.objects.by_name[binding[definition.param]]
        if member.future:
            return min([definition.default, *table.values()])
        for key in (member.name, member.kind, "default"):
            if key in table:
                return table[key]
        return definition.default


def _counted_place(schema: ActionSchema) -> tuple[int, int] | None:
    """Which repetitive effect of an action is counted: the effect's index and the node's slot."""
    for index, effect in enumerate(schema.effects):
        for slot, node in enumerate(_nodes(effect.definition)):
            if isinstance(node, Repetitive):
                return index, slot
    return None


def _nodes(effect: EffectDef) -> Iterator[EffectDef]:
    """The nodes of an effect that have a counter: not those that become effects of their own."""
    yield effect
    if not isinstance(effect, Creation | Deletion):
        for inner in effect.sfx:
            yield from _nodes(inner)
