"""Conversion of states and their changes to the values in messages and recordings, and back.

The server has a `StateWriter` for each episode, and a client a `StateReader` for each copy of the
state. The reader maps atoms by name, because client and server may number them differently.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Generic, TypeVar
from weakref import WeakKeyDictionary

from robotouille.errors import ProtocolError
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.effects import Effect
from robotouille.world.grounding.objects import Atom, Object
from robotouille.world.sight import ranks
from robotouille.world.timers import TimerRow
from robotouille.world.unmet import Attempt, Unmet
from robotouille.world.world import State, World

RowT = TypeVar("RowT", bound=Hashable)
Tables = dict[int, dict[str, Any]]
_tables: WeakKeyDictionary[World, Tables] = WeakKeyDictionary()
"""Tables of each world in use, by size. All episodes of a world share them."""
_ranked_tables: WeakKeyDictionary[World, Tables] = WeakKeyDictionary()
_positions: WeakKeyDictionary[World, list[int]] = WeakKeyDictionary()
"""The same for `RankedStateWriter`, and the position of each bit in its tables."""
MAX_TABLES = 4
MAX_TIMERS = 20_000
"""Timers of a state. Readers and the recorder visit all of them in each step."""


def effect_label(effect: Effect) -> str:
    """Return an effect's label: `cook.0(patty1,stove1)` is the first effect of `cook`."""
    action, index, arguments = effect.label
    return f"{action}.{index}({','.join(arguments)})"


def parse_label(label: str) -> tuple[str, int, tuple[str, ...]]:
    """Return the action, index and arguments of an effect's label.

    Raises:
        ValueError: The label is invalid.
    """
    head, bracket, rest = label.partition("(")
    action, dot, index = head.rpartition(".")
    if not (bracket and dot and rest.endswith(")")):
        raise ValueError(f"not an effect: {label!r}")
    # A label has one spelling. Readers would keep a timer for each of `cook.0(…)` and `cook.00(…)`.
    number = int(index)
    if index != str(number):
        raise ValueError(f"not the number of an effect: {label!r}")
    arguments = tuple(rest[:-1].split(",")) if rest != ")" else ()
    return action, number, arguments


def unmet_rows(attempts: Iterable[Attempt]) -> dict[str, list[str]]:
    """Return the reasons for rejected attempts as text, by the position of the attempt."""
    return {str(i): list(a.reasons) for i, a in enumerate(attempts) if not a.applied}


def why_rows(attempts: Iterable[Attempt]) -> dict[str, list[dict[str, Any]]]:
    """Return the reasons for rejected attempts as fields of `messages.Why`."""
    return {
        str(i): [why_row(unmet) for unmet in a.unmet] for i, a in enumerate(attempts) if a.unmet
    }


def why_row(unmet: Unmet) -> dict[str, Any]:
    """Return a reason as fields of `messages.Why`."""
    row: dict[str, Any] = {"kind": unmet.kind.value}
    if unmet.predicate:
        row["predicate"] = unmet.predicate
    if unmet.objects:
        row["objects"] = list(unmet.objects)
    if not unmet.expected:
        row["expected"] = False
    return row


class GrowingTable(Generic[RowT]):
    """Table of objects or atoms, which grows whenever a change creates objects.

    Attributes:
        rows: The rows in order. Messages and recordings refer to them by position.
    """

    def __init__(self, rows: Iterable[RowT] = ()) -> None:
        self.rows: list[RowT] = []
        self._known: set[RowT] = set()
        self.extend(rows)

    def extend(self, rows: Iterable[RowT]) -> list[RowT]:
        """Append the rows that the table lacks, and return them.

        A change lists an object and its atoms whenever the object is created, also if it had
        existed before, because a change depends on two states only.
        """
        new = [row for row in dict.fromkeys(rows) if row not in self._known]
        self.rows += new
        self._known.update(new)
        return new


def _rows(objects: Iterable[Object]) -> list[list[str]]:
    return [[thing.name, thing.kind, thing.type] for thing in objects]


class StateWriter:
    """Writer of the states of one episode."""

    __slots__ = (
        "_digest",
        "_last",
        "predicates",
        "world",
    )

    def __init__(self, world: World) -> None:
        self.world = world
        self.predicates = list(world.table.fluents)
        self._last: tuple[State, State, dict[str, Any]] | None = None
        self._digest: tuple[State, str] | None = None

    def tables(self, state: State) -> dict[str, Any]:
        """Return the tables for reading the facts of a state. The caller must not change them."""
        size = self.world.table_size(state.facts)
        made = self._made()
        if size not in made:
            # The largest tables belong to states with many created objects, which are rare.
            if len(made) >= MAX_TABLES:
                del made[max(made)]
            objects = self._objects(0, size)
            made[size] = {
                "predicates": self.predicates,
                "objects": _rows(objects),
                "atoms": self._atoms(0, size, [thing.name for thing in objects]),
            }
        return made[size]

    # Facts are positions in the tables. Each name is sent once, with the tables.
    def values(self, state: State) -> dict[str, Any]:
        """Return the facts, timers, busy players and orders of a state."""
        timers = [[effect_label(e), list(counters)] for e, counters in state.timers.entries]
        values = {
            "facts": self._bits(state.facts),
            "timers": timers,
            "busy": dict(state.timers.busy),
        }
        if state.orders is not None:
            values["orders"] = state.orders.row
        return values

    def digest(self, state: State) -> str:
        """Return the content hash of a state."""
        # Recording and sending a step ask for the same hash.
        if self._digest is None or self._digest[0] is not state:
            self._digest = state, state.digest
        return self._digest[1]

    def changes(self, before: State, after: State) -> dict[str, Any]:
        """Return the differences between two states, without empty fields."""
        # The last result is kept, because a step is both recorded and sent.
        if self._last is None or self._last[0] is not before or self._last[1] is not after:
            self._last = (before, after, self._changes(before, after))
        return self._last[2]

    def _changes(self, before: State, after: State) -> dict[str, Any]:
        fields: dict[str, Any] = {}
        if before.facts.bit_length() != after.facts.bit_length():
            known_size = self.world.table_size(before.facts)
            size = self.world.table_size(after.facts)
        else:
            known_size = size = 0
        if size > known_size:
            known = [thing.name for thing in self._objects(0, known_size)]
            new = self._objects(known_size, size)
            names = known + [thing.name for thing in new]
            fields["objects"] = _rows(new)
            fields["atoms"] = self._atoms(known_size, size, names)
        if added := after.facts & ~before.facts:
            fields["add"] = self._bits(added)
        if removed := before.facts & ~after.facts:
            fields["remove"] = self._bits(removed)
        # Equal timer values are the same object (docs/decisions/0002), so this comparison is
        # enough.
        if after.timers is not before.timers:
            timers = _timer_changes(before, after)
            if timers:
                fields["timers"] = timers
            if after.timers.busy != before.timers.busy:
                fields["busy"] = dict(after.timers.busy)
        # Readers count the steps themselves.
        orders = after.orders
        if before.orders is not None and orders not in (None, before.orders.waited()):
            fields["orders"] = orders.row if orders is not None else None
        return fields

    def _objects(self, start: int, stop: int) -> list[Object]:
        """Return the objects whose atoms begin in a range of the table, in the table's order."""
        everything = self.world.all_objects()
        initial = len(self.world.placed)
        sizes = self.world.table_sizes
        creatable = (len(everything) - initial) // (len(sizes) - 1) if len(sizes) > 1 else 0
        counts = {size: initial + i * creatable for i, size in enumerate(sizes)} | {0: 0}
        return list(everything[counts[start] : counts[stop]])

    def _atoms(self, start: int, stop: int, names: Sequence[str]) -> list[list[int]]:
        place = {name: i for i, name in enumerate(names)}
        predicate = {name: i for i, name in enumerate(self.predicates)}
        return [
            [
                # The two bookkeeping predicates of created objects have no names on the wire
                # (docs/decisions/0004).
                predicate.get(atom[0], -1 if atom[0] == "~exists" else -2),
                *(place[a] for a in atom[1:]),
            ]
            for atom in self._ordered_atoms(start, stop)
        ]

    # Parts with another order in `RankedStateWriter`

    def _made(self) -> Tables:
        return _tables.setdefault(self.world, {})

    def _bits(self, facts: int) -> list[int]:
        return bits_of(facts)

    def _ordered_atoms(self, start: int, stop: int) -> Sequence[Atom]:
        return self.world.table.atoms[start:stop]


class RankedStateWriter(StateWriter):
    """Writer whose tables have the order of `sight.ranks`, for players with limited sight."""

    __slots__ = ()

    def _made(self) -> Tables:
        return _ranked_tables.setdefault(self.world, {})

    def _bits(self, facts: int) -> list[int]:
        positions = _positions.setdefault(self.world, [])
        for start, stop in self._generations():
            if start >= len(positions):
                order = sorted(range(start, stop), key=self._rank_of_atom)
                place = {bit: start + i for i, bit in enumerate(order)}
                positions += [place[bit] for bit in range(start, stop)]
        return sorted(positions[bit] for bit in bits_of(facts))

    def _ordered_atoms(self, start: int, stop: int) -> Sequence[Atom]:
        blocks = [range(a, b) for a, b in self._generations() if start <= a and b <= stop]
        order = (bit for block in blocks for bit in sorted(block, key=self._rank_of_atom))
        return [self.world.table.atoms[bit] for bit in order]

    def _objects(self, start: int, stop: int) -> list[Object]:
        rank, found = ranks(self.world), list[Object]()
        for a, b in self._generations():
            if start <= a and b <= stop:
                found += sorted(super()._objects(a, b), key=lambda thing: rank[thing.name])
        return found

    def _generations(self) -> Iterable[tuple[int, int]]:
        return pairwise((0, *self.world.table_sizes))

    def _rank_of_atom(self, bit: int) -> tuple[str, list[int]]:
        rank, (predicate, *arguments) = ranks(self.world), self.world.table.atoms[bit]
        return predicate, [rank[name] for name in arguments]


def _timer_changes(before: State, after: State) -> dict[str, list[int] | None]:
    old = dict(before.timers.entries)
    new = dict(after.timers.entries)
    changes: dict[str, list[int] | None] = {}
    for effect in old:
        if effect not in new:
            changes[effect_label(effect)] = None
    for effect, counters in new.items():
        if old.get(effect) != counters:
            changes[effect_label(effect)] = list(counters)
    return changes


class StateReader:
    """A client's copy of an episode's state, updated by deltas.

    Args:
        tables: The value of `StateWriter.tables` for the state.
        values: The value of `StateWriter.values` for the state.

    Raises:
        ProtocolError: `state/mismatch` if the values do not fit this world. Request a snapshot.
    """

    def __init__(
        self,
        world: World,
        tables: Mapping[str, Any],
        values: Mapping[str, Any],
    ) -> None:
        self.world = world
        self._predicates: list[str] = list(tables["predicates"])
        self._objects = GrowingTable[str]()
        self._atoms = GrowingTable[int]()
        self._facts = 0
        self._timers: dict[str, TimerRow] = {}
        self._busy: dict[str, int] = {}
        self._orders: Sequence[Any] | None = None
        try:
            self._extend(tables["objects"], tables["atoms"])
            self._facts = self._mask(values["facts"])
            self._timers = {label: _timer(label, counters) for label, counters in values["timers"]}
            self._busy = dict(values["busy"])
            self._orders = values.get("orders")
            self.state = self._state()
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise ProtocolError("state/mismatch", f"unreadable snapshot: {error}") from None

    def apply(self, changes: Mapping[str, Any]) -> State:
        """Apply a delta's changes and return the new state.

        Raises:
            ProtocolError: `state/mismatch`.
        """
        try:
            if "objects" in changes or "atoms" in changes:  # Rare, and slow in large kitchens.
                self._extend(changes.get("objects", ()), changes.get("atoms", ()))
            self._facts |= self._mask(changes.get("add", ()))
            # The order does not matter: a delta never adds and removes the same fact.
            self._facts &= ~self._mask(changes.get("remove", ()))
            for label, counters in changes.get("timers", {}).items():
                if counters is None:
                    self._timers.pop(label, None)
                else:
                    self._timers[label] = _timer(label, counters)
            if changes.get("busy") is not None:
                self._busy = dict(changes["busy"])
            if self.state.orders is not None:
                self._orders = changes.get("orders") or self.state.orders.waited().row
            self.state = self._state()
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise ProtocolError("state/mismatch", f"unreadable change: {error}") from None
        return self.state

    def _extend(self, objects: Iterable[Sequence[str]], atoms: Iterable[Sequence[int]]) -> None:
        # The client's world may have played less than the server's and may not know these objects
        # yet.
        self.world.admit(self._objects.extend([row[0] for row in objects]))
        # A hostile server could send new names, which belong to no world, in every delta.
        if len(self._objects.rows) > len(self.world.all_objects()):
            raise ValueError("more objects than the world has")
        names, bit = self._objects.rows, self.world.table.bit
        special = {-1: "~exists", -2: "~used"}
        found = []
        for predicate, *arguments in atoms:
            name = special[predicate] if predicate < 0 else self._predicates[predicate]
            found.append(bit[(name, *(names[i] for i in arguments))])
        self._atoms.extend(found)

    def _mask(self, positions: Iterable[int]) -> int:
        mask, bits = 0, self._atoms.rows
        for position in positions:
            mask |= bits[position]
        return mask

    def _state(self) -> State:
        # Deltas of a hostile server could add timers without end.
        if len(self._timers) > MAX_TIMERS:
            raise ValueError(f"more than {MAX_TIMERS:,} timers")
        busy = tuple(sorted(self._busy.items()))
        return self.world.restore(self._facts, [*self._timers.values()], busy, self._orders)


def _timer(label: str, counters: Iterable[int]) -> TimerRow:
    # Kept parsed, because a state may have 20,000 timers and a step changes few of them.
    return (*parse_label(label), tuple(counters))
