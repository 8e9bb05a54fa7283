"""Symmetry reduction: states that differ only in the names of interchangeable objects.

Two objects are interchangeable if exchanging their names maps the task to itself. Their type, kind
and static facts are equal, neither the goal nor the configuration names one of them, and walks to
them take the same time. Then exchanging them maps each course of play to another one of equal
length.

Pairwise interchangeable objects form a group. `Symmetry.key` sorts each group's objects by the
facts about them. Whatever the order, the key describes a renamed state, so states with equal keys
are equally far from the goal. Not all such states get equal keys.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from functools import reduce
from itertools import combinations
from operator import or_
from typing import Any

from robotouille.world.grounding.atoms import AtomTable, bits_of
from robotouille.world.grounding.objects import Atom, Object
from robotouille.world.timers import Timers
from robotouille.world.world import World

Renaming = tuple[tuple[str, str], ...]
"""Old names with their new names."""

MAX_KEPT = 500_000
"""Maximum number of cached keys. Most states are reached many times."""

StateKey = tuple[int, int]
"""Key that equivalent states share."""

Label = tuple[str, int, tuple[str, ...]]


def state_keys(world: World, symmetry: bool = True) -> Callable[[int, Timers], StateKey]:
    """Return a function from states to keys. With `symmetry`, equivalent states share a key."""
    if symmetry:
        groups = Symmetry(world)
        if groups:
            return groups.key
    numbers: dict[Hashable, int] = {}
    known: dict[Timers, int] = {}

    def key(facts: int, timers: Timers) -> StateKey:
        number = known.get(timers)
        if number is None:
            value = (timers.entries, timers.busy)
            number = known[timers] = numbers.setdefault(value, len(numbers))
        return facts, number

    return key


def interchangeable(world: World) -> list[tuple[str, ...]]:
    """Return the groups of pairwise interchangeable objects."""
    groups: list[list[Object]] = []
    named = _named(world)
    for thing in world.placed:
        if thing.name in named:
            continue
        for group in groups:
            if _alike(world, group[0], thing):
                group.append(thing)
                break
        else:
            groups.append([thing])
    return [tuple(o.name for o in group) for group in groups if len(group) > 1]


def _named(world: World) -> set[str]:
    """Return the objects that the task distinguishes by name or place."""
    named = {v.fixed for v in world.goal.variables.values() if v.fixed is not None}
    named |= {name for table in world.task.problem.config.values() for name in table}
    if world.task.profile.steps_per_tile:
        for schema in world.schemas:
            walked = schema.definition.travel or ()
            types = {kind for name, kind in schema.parameters if name in walked}
            named |= {o.name for o in world.placed if o.type in types}
    return named


def _alike(world: World, one: Object, other: Object) -> bool:
    if (one.type, one.kind) != (other.type, other.kind):
        return False
    exchange = {one.name: other.name, other.name: one.name}
    static = world.table.static
    return all(_rename(atom, exchange) in static for atom in static if exchange.keys() & atom[1:])


def _rename(atom: Atom, names: dict[str, str]) -> Atom:
    return (atom[0], *(names.get(name, name) for name in atom[1:]))


class Symmetry:
    """Keys that are equal only for states that differ in the names of interchangeable objects."""

    def __init__(self, world: World) -> None:
        self._table = world.table
        names = interchangeable(world)
        self._blank = dict.fromkeys((name for group in names for name in group), "?")
        self._groups = [_Group(world.table, group, self._blank) for group in names]
        self._size = len(world.table.atoms)
        self._timer_keys: dict[tuple[Timers, Renaming], int] = {}
        self._numbers: dict[Hashable, int] = {}
        self._keys: dict[tuple[int, Timers], StateKey] = {}

    def __bool__(self) -> bool:
        return bool(self._groups)

    def key(self, facts: int, timers: Timers) -> StateKey:
        """Return the key of a state."""
        key = self._keys.get((facts, timers))
        if key is None:
            if len(self._keys) > MAX_KEPT:
                self._keys.clear()
            key = self._keys[facts, timers] = self._new_key(facts, timers)
        return key

    def _new_key(self, facts: int, timers: Timers) -> StateKey:
        if len(self._table.atoms) != self._size:
            self._size = len(self._table.atoms)
            self._groups = [_Group(self._table, g.names, self._blank) for g in self._groups]
        renaming: Renaming = ()
        for group in self._groups:
            order = group.order(facts, timers)
            if order:
                facts = group.rename(facts, order)
                renaming += order
        if not timers.pending:
            return facts, -1
        number = self._timer_keys.get((timers, renaming))
        if number is None:
            value = _timer_value(timers, dict(renaming))
            number = self._numbers.setdefault(value, len(self._numbers))
            self._timer_keys[timers, renaming] = number
        return facts, number


def _timer_value(timers: Timers, names: dict[str, str]) -> Hashable:
    """Return the value of timers with renamed objects, in the timers' order."""
    rows = tuple(
        (action, index, tuple(names.get(name, name) for name in arguments), progress)
        for (action, index, arguments), progress in _rows(timers)
    )
    return rows, tuple(sorted((names.get(name, name), steps) for name, steps in timers.busy))


def _rows(timers: Timers) -> Iterator[tuple[Label, tuple[int, ...]]]:
    for effect, progress in timers.entries:
        yield effect.label, progress


class _Group:
    """Interchangeable objects, the bits about them, and their order.

    A *mark* is a number for the facts about an object in which its own name and the group's names
    are blank. Equal facts have equal marks for all objects.
    """

    def __init__(self, table: AtomTable, names: tuple[str, ...], blank: dict[str, str]) -> None:
        self.names = names
        self._table = table
        self._blank = blank
        masks = [table.mentions(name) for name in names]
        self._together = reduce(or_, (one & other for one, other in combinations(masks, 2)))
        self._alone = [mask & ~self._together for mask in masks]
        self._marks: dict[Hashable, int] = {}
        self._alone_marks: list[dict[int, int]] = [{} for _ in names]
        self._together_marks: dict[int, tuple[int, ...]] = {0: (0,) * len(names)}
        self._timer_marks: dict[Timers, tuple[int, ...]] = {}
        self._renamed: dict[tuple[int, Renaming], int] = {}

    def order(self, facts: int, timers: Timers) -> Renaming:
        """Return the renaming that sorts the objects by their marks; empty if they are sorted."""
        marks: list[Any] = [
            known.get(facts & mask, -1)
            for known, mask in zip(self._alone_marks, self._alone, strict=True)
        ]
        if -1 in marks:
            marks = [self._alone_mark(place, facts) for place in range(len(marks))]
        together = facts & self._together
        if together:
            marks = list(zip(marks, self._together_mark(together), strict=True))
        if timers.pending:
            marks = list(zip(marks, self._timer_mark(timers), strict=True))
        if marks == sorted(marks):
            return ()
        names = self.names
        order = sorted(range(len(marks)), key=marks.__getitem__)
        return tuple([(names[old], names[new]) for new, old in enumerate(order) if old != new])

    def rename(self, facts: int, renaming: Renaming) -> int:
        """Return facts with the group's objects renamed."""
        known, mentions = self._renamed, self._table.mentions
        result, together = facts, facts & self._together
        for old, _ in renaming:
            result &= ~mentions(old)
        for change in renaming:
            bits = facts & mentions(change[0]) & ~self._together
            if bits:
                moved = known.get((bits, (change,)))
                result |= self._rename(bits, (change,)) if moved is None else moved
        return result | self._rename(together, renaming) if together else result

    def _rename(self, bits: int, renaming: Renaming) -> int:
        known = self._renamed.get((bits, renaming))
        if known is None:
            names, table = dict(renaming), self._table
            known = table.mask(_rename(table.atoms[bit], names) for bit in bits_of(bits))
            self._renamed[bits, renaming] = known
        return known

    def _mark(self, value: Hashable) -> int:
        return self._marks.setdefault(value, len(self._marks))

    def _alone_mark(self, place: int, facts: int) -> int:
        bits = facts & self._alone[place]
        known = self._alone_marks[place]
        if bits not in known:
            known[bits] = self._mark(self._blanked(self.names[place], bits))
        return known[bits]

    def _together_mark(self, bits: int) -> tuple[int, ...]:
        known = self._together_marks.get(bits)
        if known is None:
            known = self._together_marks[bits] = tuple(
                self._mark(self._blanked(name, bits & self._table.mentions(name)))
                for name in self.names
            )
        return known

    def _blanked(self, name: str, bits: int) -> Hashable:
        blank = {other: "=" if other == name else "?" for other in self.names}
        return tuple(sorted(_rename(self._table.atoms[bit], blank) for bit in bits_of(bits)))

    def _timer_mark(self, timers: Timers) -> tuple[int, ...]:
        known = self._timer_marks.get(timers)
        if known is None:
            known = self._timer_marks[timers] = tuple(
                self._mark(self._role(name, timers)) for name in self.names
            )
        return known

    def _role(self, name: str, timers: Timers) -> Hashable:
        """Return an object's part in the timers."""
        blank = {**self._blank, name: "="}
        rows = [
            (place, tuple(blank.get(a, a) for a in label[2]), progress)
            for place, (label, progress) in enumerate(_rows(timers))
            if name in label[2]
        ]
        return timers.busy_steps(name), tuple(rows)
