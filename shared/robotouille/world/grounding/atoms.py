"""The table of ground atoms: bit *i* of a state's facts is atom *i*.

Only predicates that some action can change have bits. The others are static and kept in a set.
Bits are assigned in blocks: one for the objects of the problem, then one for each generation of
created objects. Bits therefore never move and do not depend on the steps taken; see
docs/decisions/0004-bits-in-generations.md.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from math import prod

from robotouille.domain.derived import fluents
from robotouille.domain.schema import DomainFile
from robotouille.world.grounding.objects import Atom, Object, atom_name

EXISTS = "~exists"
USED = "~used"
"""Predicates of objects that play can create or delete: exists now, has ever existed.

`USED` keeps the name of a deleted object from being given to another object."""


def bits_of(mask: int) -> list[int]:
    """Return the positions of the set bits, ascending."""
    # `mask & -mask` is the lowest set bit; most masks have few bits among thousands.
    positions = []
    while mask:
        low = mask & -mask
        positions.append(low.bit_length() - 1)
        mask ^= low
    return positions


class AtomTable:
    """Ground atoms, their bits, and masks of the atoms that match a pattern."""

    def __init__(
        self, domain: DomainFile, transient: frozenset[str], static: Iterable[Atom]
    ) -> None:
        self.types = {p.name: p.param_types for p in domain.predicate_defs}
        changing = fluents(domain)
        self.fluents = tuple(p.name for p in domain.predicate_defs if p.name in changing)
        self.static = frozenset(atom for atom in static if atom[0] not in changing)
        self.static_predicates = frozenset(self.types) - changing
        self.transient = transient
        self._names: list[str] = []
        self._static_names = [(atom_name(atom), atom) for atom in self.static]
        self._needed: dict[Atom, int] = {}
        self.atoms: list[Atom] = []
        self.bit: dict[Atom, int] = {}
        self.by_type: dict[str, list[str]] = {kind: [] for kind in domain.object_types}
        self.internal = 0
        self.reflexive = 0
        self._mentions: dict[str, int] = {}
        self._patterns: dict[tuple[str | None, ...], int] = {}

    def add(self, objects: Iterable[Object]) -> None:
        """Assign bits to all atoms about new objects.

        The first call also adds the atoms without objects.
        """
        new = {thing.name: thing.type for thing in objects}
        for name, kind in new.items():
            self.by_type[kind].append(name)
        first = not self.atoms
        for name, kind in new.items():
            if kind in self.transient:
                self.internal |= self._append((EXISTS, name)) | self._append((USED, name))
        for predicate in self.fluents:
            pools = [self.by_type[kind] for kind in self.types[predicate]]
            for arguments in product(*pools):
                if any(a in new for a in arguments) or (first and not arguments):
                    self._append((predicate, *arguments))
        self._patterns.clear()
        if first:
            self._needed = {atom: self._existence(atom) for atom in self.static}

    def size_with(self, objects: Iterable[Object]) -> int:
        """Return the number of atoms after adding new objects."""
        count = {kind: len(names) for kind, names in self.by_type.items()}
        for thing in objects:
            count[thing.type] += 1
        transient = sum(count[kind] for kind in self.transient)
        facts = (prod(count[kind] for kind in self.types[name]) for name in self.fluents)
        return 2 * transient + sum(facts)

    def _append(self, atom: Atom) -> int:
        mask = 1 << len(self.atoms)
        self.bit[atom] = mask
        self.atoms.append(atom)
        objects = set(atom[1:])
        if len(objects) < len(atom) - 1:
            self.reflexive |= mask
        for name in objects:
            self._mentions[name] = self._mentions.get(name, 0) | mask
        return mask

    def mentions(self, name: str) -> int:
        """Return the mask of all atoms about an object."""
        return self._mentions.get(name, 0)

    def matching(self, pattern: tuple[str | None, ...]) -> int:
        """Return the mask of a predicate's atoms whose arguments match; None matches any."""
        mask = self._patterns.get(pattern)
        if mask is None:
            mask = 0
            predicate = str(pattern[0])
            pools = [
                self.by_type[kind] if wanted is None else (wanted,)
                for wanted, kind in zip(pattern[1:], self.types[predicate], strict=True)
            ]
            for arguments in product(*pools):
                mask |= self.bit[(predicate, *arguments)]
            self._patterns[pattern] = mask
        return mask

    def mask(self, atoms: Iterable[Atom]) -> int:
        """Return the mask of atoms; static atoms have no bits."""
        total = 0
        for atom in atoms:
            total |= self.bit.get(atom, 0)
        return total

    def test(self, conditions: Iterable[tuple[Atom, bool]]) -> tuple[int, int, bool]:
        """Return masks `tested` and `required`, and whether the conditions can hold at all.

        They cannot hold if a static fact rules one out, or if two contradict each other. A static
        fact holds while the objects that it mentions exist, so their existence is tested instead.
        """
        required = forbidden = 0
        possible = True
        for atom, is_true in conditions:
            bit = self.bit.get(atom, 0)
            if not bit and atom in self.static:
                bit = self._existence(atom)
                possible &= is_true or bool(bit)
            elif not bit:
                possible &= not is_true
            if is_true:
                required |= bit
            else:
                forbidden |= bit
        return required | forbidden, required, possible and not required & forbidden

    def true_atoms(self, facts: int) -> list[Atom]:
        """Return all true atoms, static ones included, in no particular order."""
        atoms = [self.atoms[i] for i in bits_of(facts & ~self.internal)]
        return atoms + [atom for atom in self.static if self._exists(atom, facts)]

    def true_names(self, facts: int) -> list[str]:
        """Return the names of `true_atoms`."""
        names = self._names
        names += map(atom_name, self.atoms[len(names) :])
        found = [names[i] for i in bits_of(facts & ~self.internal)]
        return found + [name for name, atom in self._static_names if self._exists(atom, facts)]

    def _existence(self, atom: Atom) -> int:
        """Return the mask of the facts that an atom's objects exist."""
        return self.mask((EXISTS, name) for name in atom[1:])

    def _exists(self, atom: Atom, facts: int) -> bool:
        needed = self._needed[atom]
        return facts & needed == needed

    def holds(self, atom: Atom, facts: int) -> bool:
        """Return whether an atom, static or not, is true."""
        bit = self.bit.get(atom)
        if bit is not None:
            return facts & bit != 0
        return atom in self.static and self._exists(atom, facts)
