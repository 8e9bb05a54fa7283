"""What could become true or be done if nothing were ever undone: a delete relaxation, from the
first state, over the objects of the problem and those in slots.

A superset of what play can reach, and far smaller than all combinations of objects.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from robotouille.world.arrays.slots import Slots
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.effects import Effect, EffectNode
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, bound

__all__ = ["Reachable"]

Binding = dict[str, str]


class Precondition(NamedTuple):
    """A precondition, its arguments as places among the action's."""

    predicate: str
    places: tuple[int, ...]
    is_true: bool


class Reachable:
    """`facts`, `actions` by key and `effects` by label that play can come to, all in a fixed order.

    `facts` has the bits of the atoms.
    """

    def __init__(self, task: GroundTask, slots: Slots) -> None:
        self._task = task
        self._slots = slots
        self._by_type: dict[str, list[str]] = {}
        for thing in slots.objects():
            self._by_type.setdefault(thing.type, []).append(thing.name)
        self.facts = task.initial_facts
        found: dict[GroundAction, None] = {}
        self._effects: dict[Effect, None] = {}
        grown = True
        while grown:
            before = self.facts, len(found), len(self._effects)
            for schema in task.schemas:
                for arguments in self._arguments(schema):
                    action = task.ground_action(schema, arguments)
                    if action not in found and action.required & ~self.facts == 0:
                        found[action] = None
                        self._apply(action)
            grown = before != (self.facts, len(found), len(self._effects))
        self.actions: tuple[GroundAction, ...] = tuple(sorted(found, key=lambda a: a.key))
        self.effects: tuple[Effect, ...] = tuple(sorted(self._effects, key=self._effect_key))

    def _effect_key(self, effect: Effect) -> tuple[object, ...]:
        action, index, arguments = effect.label
        names = [schema.name for schema in self._task.schemas]
        table = self._task.table
        types = {thing.name: thing.type for thing in self._slots.objects()}
        order = [table.by_type[types[name]].index(name) for name in arguments]
        return names.index(action), index, *order

    # Actions

    def _arguments(self, schema: ActionSchema) -> Iterator[tuple[str, ...]]:
        """Arguments with which all preconditions that have to hold can."""
        tests: list[list[Precondition]] = [[] for _ in schema.parameters]
        place = {name: i for i, (name, _) in enumerate(schema.parameters)}
        for condition in schema.definition.precons:
            if condition.params:
                places = tuple(place[name] for name in condition.params)
                tests[max(places)].append(
                    Precondition(condition.predicate, places, condition.is_true)
                )
        yield from self._extend(schema, tests, ())

    def _extend(
        self, schema: ActionSchema, tests: Sequence[Sequence[Precondition]], chosen: tuple[str, ...]
    ) -> Iterator[tuple[str, ...]]:
        if len(chosen) == len(schema.parameters):
            yield chosen
            return
        _, kind = schema.parameters[len(chosen)]
        for name in self._by_type.get(kind, ()):
            arguments = (*chosen, name)
            if self._exists(name) and all(
                self._possible((predicate, *[arguments[i] for i in places]), is_true)
                for predicate, places, is_true in tests[len(chosen)]
            ):
                yield from self._extend(schema, tests, arguments)

    def _exists(self, name: str) -> bool:
        bit = self._task.table.bit.get((EXISTS, name))
        return bit is None or bool(self.facts & bit)

    def _possible(self, atom: Atom, is_true: bool) -> bool:
        bit = self._task.table.bit.get(atom)
        if bit is None:
            return (atom in self._task.table.static) == is_true
        return not is_true or bool(self.facts & bit)

    # Effects

    def _apply(self, action: GroundAction) -> None:
        self.facts |= action.touched & ~action.removed
        for effect in action.effects:
            self._start(effect)

    def _start(self, effect: Effect) -> None:
        if effect not in self._effects:
            self._effects[effect] = None
            self._reach(effect.root)

    def _reach(self, node: EffectNode) -> None:
        """What a node can make true: a conditional one also what it negates."""
        self.facts |= node.sets
        if node.kind == "conditional":
            self.facts |= node.clears
        for child in node.nested:
            self._reach(child)
        if node.kind == "creation":
            self._create(node)
        elif node.kind == "deletion":
            self._begin_nested(node, dict(node.binding))

    def _create(self, node: EffectNode) -> None:
        if node.created is None:
            raise AssertionError("a creation effect without an object")
        for name in self._slots.by_kind[node.created.name]:
            binding = {**dict(node.binding), node.created.param: name}
            self.facts |= self._task.table.mask([(EXISTS, name)])
            self.facts |= self._task.table.mask(bound(c, binding) for c in node.fx if c.is_true)
            self._begin_nested(node, binding)

    def _begin_nested(self, node: EffectNode, binding: Binding) -> None:
        for definition in node.sfx:
            self._start(self._task.born_effect(definition, binding))
