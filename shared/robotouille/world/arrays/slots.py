"""Slots: room for the objects that play creates, so that arrays have a fixed length.

Created objects get a new name each time (`water1`, `water2`, …), without end. How many there are at
once is limited. A slot is called by the first names of its kind; of the created objects that exist,
the one with the lowest number stands in the first slot, the next in the second, and so on.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from robotouille.domain.schema import Creation
from robotouille.errors import RobotouilleError, SlotOverflowError
from robotouille.world.grounding.actions import ActionSchema
from robotouille.world.grounding.atoms import EXISTS
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Object

__all__ = ["Names", "Slots"]

Names = Mapping[str, str]
"""Slots and the objects in them, where their names differ."""

MIN_SLOTS = 4
"""Of each kind that can be created, where nothing else is asked for."""

MAX_KEPT = 1_000
"""Sets of created objects of which it is known where they stand; then it is worked out anew."""


class Slots:
    """The slots of a task, and which objects of a state stand in them.

    Args:
        task: What is grounded; it is given room for the objects that the slots are called by.
        capacity: How many slots a kind has; by default 4, or as many as the problem has objects
            of the type that most of what is created is put into, if these are more.

    Raises:
        RobotouilleError: There are slots for a kind that cannot be created, or none for one.
    """

    def __init__(self, task: GroundTask, capacity: Mapping[str, int] | None = None) -> None:
        self._task = task
        kinds = _created_kinds(task)
        sizes = {**kinds, **(capacity or {})}
        if wrong := sorted(set(sizes) - set(kinds)):
            raise RobotouilleError(f"{wrong[0]!r} is nothing that play can create")
        if empty := [kind for kind, size in sizes.items() if size < 1]:
            raise RobotouilleError(f"{empty[0]!r} needs one slot at least")
        first = {kind: _problem_objects(task, kind) for kind in kinds}
        task.make_room({kind: first[kind] + size for kind, size in sizes.items()})
        self.by_kind = {
            kind: tuple(f"{kind}{first[kind] + i}" for i in range(1, size + 1))
            for kind, size in sizes.items()
        }
        self.names = frozenset(name for names in self.by_kind.values() for name in names)
        self._kept: dict[tuple[int, int], Names] = {}

    def objects(self) -> tuple[Object, ...]:
        """Those of the problem, and one for each slot, by type in the domain's order."""
        order = {kind: i for i, kind in enumerate(self._task.task.domain.object_types)}
        there = [
            thing
            for thing in self._task.all_objects()
            if thing.tile is not None or thing.name in self.names
        ]
        return tuple(sorted(there, key=lambda thing: order[thing.type]))

    def filled(self, facts: int) -> Names:
        """Which objects stand in slots of other names; empty in most states.

        Raises:
            SlotOverflowError: There are more than slots.
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
    """The kinds that play can create, with the usual number of slots."""
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
