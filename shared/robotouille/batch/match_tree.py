"""Which actions of a player are valid: a tree that visits little but the valid ones.

At a node all atoms on the way to it hold. What needs nothing more is valid there; the other actions
stand below an atom each, the one that is likely to rule out most of those that are left. The atoms
below a node are tested by words, 63 at once, and only what is below a true one is visited.

A tree is a list of numbers. A node is a record in it: how many actions follow, these, how many
numbers follow for tests, and these. An action is its number among the player's, or -1 - number, if
atoms have to be false, too. A test is a word, a mask, and a place: that of bit b, which is true
under the mask, has the place of the node below it b numbers further on, or -2 - number where
nothing stands but that action.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from robotouille.batch.layout import WORD
from robotouille.batch.rules import ActionRule, Rules

__all__ = ["MatchTree", "match_tree"]

Left = tuple[int, frozenset[int]]
"""An action, and the atoms that it needs beside those on the way."""


class MatchTree(NamedTuple):
    """The trees of all players: `roots`, the numbers, and how many nodes wait at most to be
    visited."""

    roots: list[int]
    numbers: list[int]
    deepest: int


def match_tree(rules: Rules) -> MatchTree:
    """The trees of all players."""
    builder = _Builder(_likely_false(rules))
    roots = [builder.add_player(actions) for actions in rules.actions]
    return MatchTree(roots, builder.numbers, builder.deepest)


class _Builder:
    def __init__(self, likely_false: list[float]) -> None:
        self._likely_false = likely_false
        self.numbers: list[int] = []
        self.deepest = 1

    def add_player(self, actions: Iterable[ActionRule]) -> int:
        listed = tuple(actions)
        left = [
            (number, frozenset(action.required))
            for number, action in enumerate(listed)
            if action.possible
        ]
        return self._node(listed, left, 1)

    def _node(self, actions: tuple[ActionRule, ...], left: list[Left], waiting: int) -> int:
        """Add a node behind all that is below it; returns its place."""
        here = [number for number, atoms in left if not atoms]
        below = self._split([each for each in left if each[1]])
        waiting += len(below)
        self.deepest = max(self.deepest, waiting)
        places = {atom: self._below(actions, below[atom], waiting) for atom in sorted(below)}
        words: dict[int, list[int]] = {}
        for atom in places:
            words.setdefault(atom // WORD, []).append(atom)
        tests = [number for atoms in words.values() for number in self._test(atoms, places)]
        place = len(self.numbers)
        self.numbers += [len(here), *(-1 - n if actions[n].forbidden else n for n in here)]
        self.numbers += [len(tests), *tests]
        return place

    def _below(self, actions: tuple[ActionRule, ...], left: list[Left], waiting: int) -> int:
        if len(left) == 1 and not left[0][1] and not actions[left[0][0]].forbidden:
            return -2 - left[0][0]
        return self._node(actions, left, waiting)

    def _test(self, atoms: list[int], places: dict[int, int]) -> tuple[int, int, int]:
        """Add the places of what is below the atoms of a word; returns word, mask and where."""
        first, start = atoms[0] % WORD, len(self.numbers)
        word = atoms[0] // WORD
        self.numbers += [places.get(atom, -1) for atom in range(atoms[0], atoms[-1] + 1)]
        return word, sum(1 << atom % WORD for atom in atoms), start - first

    def _split(self, left: list[Left]) -> dict[int, list[Left]]:
        """Actions by the atom below which they stand, each atom taken from those that need it."""
        below: dict[int, list[Left]] = {}
        counts = Counter(atom for _, atoms in left for atom in atoms)
        weight = self._likely_false
        while left:
            atom = max(counts, key=lambda a: (counts[a] * weight[a], -a))
            below[atom] = [(number, atoms - {atom}) for number, atoms in left if atom in atoms]
            left = [each for each in left if atom not in each[1]]
            for _, atoms in below[atom]:
                counts.subtract([*atoms, atom])
        return below


def _likely_false(rules: Rules) -> list[float]:
    """How likely each atom is to be false: as most of its predicate are in the initial state."""
    initial = set(rules.atoms_of(rules.world.initial.facts))
    atoms = rules.encoding.atoms
    all_of = Counter(atom[0] for atom in atoms)
    true_of = Counter(atom[0] for i, atom in enumerate(atoms) if i in initial)
    return [1 - (true_of[atom[0]] + 1) / (all_of[atom[0]] + 2) for atom in atoms]
