"""Atoms, actions and effects that play can reach, by a delete relaxation of the initial state.

The relaxation ignores that facts become false. Its result contains everything that play can
reach, and is far smaller than all combinations of objects.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from robotouille.domain.schema import Creation
from robotouille.errors import SlotOverflowError, TooHardError, WrongArgumentError
from robotouille.world.grounding.actions import ActionSchema, GroundAction
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.effects import Effect, EffectNode
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Atom, Object, bound
from robotouille.world.slot_counts import slot_counts

Names = Mapping[str, str]
"""Slots whose object has another name, with the name of the object."""

MIN_SLOTS = 4
"""Default number of slots of a kind."""

MAX_BITS = 500_000_000
"""Largest number of actions, times the number of facts: each action has a few masks of all facts,
so this takes about 300 MiB. Shipped tasks need up to 6 million."""

MAX_KEPT = 1_000
"""Largest number of sets of created objects whose slots are cached."""


class Slots:
    """The slots of a task for created objects, and the objects of a state that fill them.

    Vectors have a fixed length, but created objects get new numbers without end. Slots give them
    fixed places; see docs/decisions/0028-arrays-and-slots.md.

    Args:
        task: The task. It gets atoms for objects with the names of the slots.
        capacity: Number of slots of each kind. The default is 4 or, if the problem has more
            objects that can contain this kind, such as pots for water, their number.

    Raises:
        WrongArgumentError: `capacity` is invalid, or has a kind that cannot be created.
    """

    def __init__(self, task: GroundTask, capacity: Mapping[str, int] | None = None) -> None:
        self._task = task
        kinds = _created_kinds(task)
        sizes = {**kinds, **dict(slot_counts(capacity))}
        if wrong := sorted(set(sizes) - set(kinds)):
            raise WrongArgumentError(f"slots: play cannot create objects of kind {wrong[0]!r}")
        first = {kind: _problem_objects(task, kind) for kind in kinds}
        task.make_room({kind: first[kind] + size for kind, size in sizes.items()})
        self.by_kind = {
            kind: tuple(f"{kind}{first[kind] + i}" for i in range(1, size + 1))
            for kind, size in sizes.items()
        }
        self.names = frozenset(name for names in self.by_kind.values() for name in names)
        self._kept: dict[tuple[int, int], Names] = {}

    def objects(self) -> tuple[Object, ...]:
        """Return the problem's objects and one object for each slot, by type."""
        order = {kind: i for i, kind in enumerate(self._task.task.domain.object_types)}
        there = [
            thing
            for thing in self._task.all_objects()
            if thing.tile is not None or thing.name in self.names
        ]
        return tuple(sorted(there, key=lambda thing: order[thing.type]))

    def filled(self, facts: int) -> Names:
        """Return the slots filled by objects of other names; empty in most states.

        Raises:
            SlotOverflowError: There are more created objects than slots.
        """
        if not self.by_kind:
            return {}
        task = self._task
        key = (facts & task.table.internal, len(task.table.atoms))
        found = self._kept.get(key)
        if found is None:
            if len(self._kept) >= MAX_KEPT:
                self._kept.clear()
            found = self._kept[key] = self._work_out(facts)
        return found

    def _work_out(self, facts: int) -> Names:
        table = self._task.table
        found: dict[str, str] = {}
        for kind, slots in self.by_kind.items():
            there = [
                thing.name
                for thing in self._task.all_objects()
                if thing.tile is None
                and thing.kind == kind
                and facts & table.bit[EXISTS, thing.name]
            ]
            if len(there) > len(slots):
                raise SlotOverflowError(kind, len(there), len(slots))
            found |= {slot: name for slot, name in zip(slots, there, strict=False) if slot != name}
            # A slot without an object must not show one that stands in another slot.
            found |= {slot: "" for slot in slots[len(there) :] if slot in there}
        return found


def _created_kinds(task: GroundTask) -> dict[str, int]:
    """Return the kinds that play can create, with their default number of slots."""
    sizes: dict[str, int] = {}
    for schema in task.schemas:
        for creation in _creations(schema):
            kind = creation.created_obj.name
            types = dict(schema.parameters)
            beside = {
                types[name]
                for condition in creation.fx
                for name in condition.params
                if name in types
            }
            number = max((sum(o.type == t for o in task.placed) for t in beside), default=0)
            sizes[kind] = max(sizes.get(kind, MIN_SLOTS), number)
    return dict(sorted(sizes.items()))


def _creations(schema: ActionSchema) -> Iterable[Creation]:
    effects = list(schema.definition.sfx)
    for effect in effects:
        effects += effect.sfx
        if isinstance(effect, Creation):
            yield effect


def _problem_objects(task: GroundTask, kind: str) -> int:
    return sum(thing.kind == kind for thing in task.placed)


Binding = dict[str, str]


class Precondition(NamedTuple):
    """A precondition, with its arguments as indices into the action's arguments."""

    predicate: str
    places: tuple[int, ...]
    is_true: bool


class Reachable:
    """Atoms, actions and effects that play can reach, in a fixed order.

    Attributes:
        facts: Mask of the atoms.
        actions: The actions, sorted by key.
        effects: The effects, sorted by label.

    Raises:
        TooHardError: The task has too many objects to number its actions.
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
        # Static and negative preconditions never change in the relaxation, so a fixed point of the
        # growing sets is reached after a few rounds.
        while grown:
            before = self.facts, len(found), len(self._effects)
            for schema in task.schemas:
                for arguments in self._arguments(schema):
                    action = task.ground_action(schema, arguments)
                    if action not in found and action.required & ~self.facts == 0:
                        found[action] = None
                        self._apply(action)
                        self._check_size(len(found))
            grown = before != (self.facts, len(found), len(self._effects))
        self.actions: tuple[GroundAction, ...] = tuple(sorted(found, key=lambda a: a.key))
        self.effects: tuple[Effect, ...] = tuple(sorted(self._effects, key=self._effect_key))

    def _check_size(self, actions: int) -> None:
        facts = len(self._task.table.atoms)
        if actions * facts > MAX_BITS:
            raise TooHardError(
                f"{self._task.task.name}: too many objects for arrays: at least {actions:,} "
                f"actions and {facts:,} facts, whose product is above {MAX_BITS:,}"
            )

    def _effect_key(self, effect: Effect) -> tuple[object, ...]:
        action, index, arguments = effect.label
        names = [schema.name for schema in self._task.schemas]
        table = self._task.table
        types = {thing.name: thing.type for thing in self._slots.objects()}
        order = [table.by_type[types[name]].index(name) for name in arguments]
        return names.index(action), index, *order

    # Actions

    def _arguments(self, schema: ActionSchema) -> Iterator[tuple[str, ...]]:
        """Yield the arguments for which all preconditions can hold."""
        # Each precondition is tested as soon as its last argument is chosen, which prunes most
        # combinations early.
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
        """Add what a node can make true; a node that reverts can also negate its results."""
        self.facts |= node.sets
        if node.reverts:
            self.facts |= node.clears
        for child in node.nested:
            self._reach(child)
        if node.created is not None:
            self._create(node)
        elif node.instant:
            self._begin_nested(node, dict(node.binding))

    def _create(self, node: EffectNode) -> None:
        if node.created is None:
            raise AssertionError("a creation effect without an object")
        # Any slot can hold the new object, so what it makes possible is added for all slots.
        for name in self._slots.by_kind[node.created.name]:
            binding = {**dict(node.binding), node.created.param: name}
            self.facts |= self._task.table.mask([(EXISTS, name)])
            self.facts |= self._task.table.mask(bound(c, binding) for c in node.fx if c.is_true)
            self._begin_nested(node, binding)

    def _begin_nested(self, node: EffectNode, binding: Binding) -> None:
        for definition in node.sfx:
            self._start(self._task.born_effect(definition, binding))
