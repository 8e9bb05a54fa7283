"""Which actions of a player are valid: a tree that visits little but the valid ones.

At a node all atoms on the way to it hold. What needs nothing more is valid there; the other actions
stand below an atom each, the one that is likely to rule out most of those that are left. The atoms
below a node are tested by words, 63 at once, and only what is below a true one is visited.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.batch.layout import WORD
from robotouille.batch.rules import ActionRule, Rules

__all__ = ["MatchTree", "match_tree"]

Left = tuple[int, frozenset[int]]
"""An action, and the atoms that it needs beside those on the way."""


class MatchTree(NamedTuple):
    """Nodes, one behind the other; player p's tree begins at node `root[p]`.

    The actions at node n are `action[action_at[n]:action_at[n + 1]]`: a number of the player's, or
    -1 - number, if atoms have to be false, too. Its tests are `group_at[n]` up to the next one's:
    the node below the atom of bit b of a word is `child[child_at[group] + b]`, or -2 - number where
    nothing stands there but that action. `deepest` nodes wait to be visited at most.
    """

    root: npt.NDArray[np.int64]
    action_at: npt.NDArray[np.int32]
    action: npt.NDArray[np.int32]
    group_at: npt.NDArray[np.int32]
    group_word: npt.NDArray[np.int32]
    group_mask: npt.NDArray[np.int64]
    child_at: npt.NDArray[np.int32]
    child: npt.NDArray[np.int32]
    deepest: int


def match_tree(rules: Rules) -> MatchTree:
    """The trees of all players."""
    builder = _Builder(_likely_false(rules))
    roots = [builder.add_player(actions) for actions in rules.actions]
    return builder.tree(roots)


class _Builder:
    def __init__(self, likely_false: list[float]) -> None:
        self._likely_false = likely_false
        self._actions: list[list[int]] = []
        self._groups: list[list[tuple[int, int, int]]] = []
        self._children: list[int] = []
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
        if waiting > 1 and len(left) == 1 and not left[0][1]:
            ((number, _),) = left
            if not actions[number].forbidden:
                return -2 - number
        place = len(self._actions)
        here = [number for number, atoms in left if not atoms]
        self._actions.append([-1 - n if actions[n].forbidden else n for n in here])
        self._groups.append([])
        below = self._split([each for each in left if each[1]])
        self.deepest = max(self.deepest, waiting + len(below))
        nodes = {
            atom: self._node(actions, chosen, waiting + len(below))
            for atom, chosen in below.items()
        }
        words: dict[int, list[int]] = {}
        for atom in sorted(nodes):
            words.setdefault(atom // WORD, []).append(atom)
        for word, atoms in words.items():
            mask = sum(1 << atom % WORD for atom in atoms)
            low, high = atoms[0] % WORD, atoms[-1] % WORD
            self._groups[place].append((word, mask, len(self._children) - low))
            self._children += [nodes.get(word * WORD + bit, -1) for bit in range(low, high + 1)]
        return place

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

    def tree(self, roots: list[int]) -> MatchTree:
        groups = [group for each in self._groups for group in each]
        return MatchTree(
            root=np.array(roots, dtype=np.int64),
            action_at=_starts(self._actions),
            action=np.array([a for each in self._actions for a in each], dtype=np.int32),
            group_at=_starts(self._groups),
            group_word=np.array([word for word, _, _ in groups], dtype=np.int32),
            group_mask=np.array([mask for _, mask, _ in groups], dtype=np.int64),
            child_at=np.array([at for _, _, at in groups], dtype=np.int32),
            child=np.array(self._children, dtype=np.int32),
            deepest=self.deepest,
        )


def _starts(lists: Iterable[list[object]] | Iterable[list[int]]) -> npt.NDArray[np.int32]:
    sizes = [0, *(len(each) for each in lists)]
    return np.cumsum(sizes, dtype=np.int32)


def _likely_false(rules: Rules) -> list[float]:
    """How likely each atom is to be false: as most of its predicate are in the initial state."""
    initial = set(rules.atoms_of(rules.world.initial.facts))
    atoms = rules.encoding.atoms
    all_of = Counter(atom[0] for atom in atoms)
    true_of = Counter(atom[0] for i, atom in enumerate(atoms) if i in initial)
    return [1 - (true_of[atom[0]] + 1) / (all_of[atom[0]] + 2) for atom in atoms]
