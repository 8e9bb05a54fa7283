"""Rules as flat arrays of integers for kernels.

A copy's state is a row of 64-bit integers: words of atoms, then for each kind of created objects
how many slots are in use, for each player how many steps it is busy, the number of active effects,
these in order of creation, and a counter for each node. A word holds 63 atoms, so it is never
negative.

Lists of unequal length lie one behind the other; where the i-th begins, an array that ends in
`_at` says, and the i-th ends where the next begins. Tests and writes go by words: one holds where
`word & tested == required`, the other makes of a word `word & ~clears | sets`. Their numbers:
actions first, all players' one behind the other, then nodes, then outcomes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.batch.match_tree import MatchTree, match_tree
from robotouille.batch.rules import Rules

__all__ = ["Ints", "Tables", "in_words", "tables"]

Ints = npt.NDArray[np.int64]

WORD = 63
"""Atoms in a word."""


class Tables(NamedTuple):
    """What kernels read. `top`, `busy`, `count`, `order` and `progress` are places in a row."""

    initial: Ints
    words: int
    atoms: int
    top: int
    busy: int
    count: int
    order: int
    progress: int
    players: int
    # Actions: those of player p begin at `action_at[p]`.
    action_at: Ints
    duration: Ints
    starts_at: Ints
    starts: Ints
    # Tests and writes.
    test_at: Ints
    test_word: Ints
    tested: Ints
    required: Ints
    write_at: Ints
    write_word: Ints
    sets: Ints
    clears: Ints
    # Effects, their nodes, and what creations and deletions do.
    effect_at: Ints
    about_at: Ints
    about: Ints
    kind: Ints
    end: Ints
    total: Ints
    possible: Ints
    subject: Ints
    creates: Ints
    outcome: Ints
    born_at: Ints
    born: Ints
    first_node: int
    first_outcome: int
    # Objects: their words, and the places of slots.
    mention_at: Ints
    mention_word: Ints
    mentions: Ints
    slot_of: Ints
    slot_at: Ints
    exists: Ints
    shifts: int
    atom_from: Ints
    effect_from: Ints
    # The goal: conditions in order, their choices of objects, the atoms that these need.
    need_at: Ints
    need_word: Ints
    need_mask: Ints
    variable_at: Ints
    variable: Ints
    variable_kind: Ints
    fresh: Ints
    choice_at: Ints
    chosen: Ints
    chosen_atoms: Ints
    # Which actions are valid: a tree of tests for each player, see `match_tree`.
    tree: MatchTree


def tables(rules: Rules) -> Tables:
    """The rules of a world, laid out for kernels."""
    actions = [action for each in rules.actions for action in each]
    outcomes = [outcome for node in rules.nodes for outcome in node.outcomes]
    tests = [*actions, *rules.nodes]
    test_at, test_word, tested, required = _tests((t.required, t.forbidden) for t in tests)
    writes = [(each.sets, each.clears) for each in (*tests, *outcomes)]
    write_at, write_word, sets, clears = _pairs(writes)
    starts_at, starts = _lists(action.effects for action in actions)
    about_at, about = _lists(effect.objects for effect in rules.effects)
    born_at, born = _lists(outcome.born for outcome in outcomes)
    mention_at, mention_word, mentions, _ = _pairs((atoms, ()) for atoms in rules.mentions)
    slot_at, exists = _lists(rules.exists)
    shifts = [shift for each in rules.shifts for shift in each]
    words = 1 + (len(rules.encoding.atoms) - 1) // WORD
    top, players = words, len(rules.players)
    busy = top + len(rules.kinds)
    order = busy + players + 1
    progress = order + len(rules.effects)
    initial = np.zeros(progress + len(rules.nodes), dtype=np.int64)
    for word, mask in in_words(rules.atoms_of(rules.world.initial.facts)).items():
        initial[word] = mask
    return Tables(
        initial=initial,
        words=words,
        atoms=len(rules.encoding.atoms),
        top=top,
        busy=busy,
        count=order - 1,
        order=order,
        progress=progress,
        players=players,
        action_at=_starts(len(each) for each in rules.actions),
        duration=_ints(action.duration for action in actions),
        starts_at=starts_at,
        starts=starts,
        test_at=test_at,
        test_word=test_word,
        tested=tested,
        required=required,
        write_at=write_at,
        write_word=write_word,
        sets=sets,
        clears=clears,
        effect_at=_ints([*(effect.first for effect in rules.effects), len(rules.nodes)]),
        about_at=about_at,
        about=about,
        kind=_ints(node.kind for node in rules.nodes),
        end=_ints(node.end for node in rules.nodes),
        total=_ints(node.total for node in rules.nodes),
        possible=_ints(node.possible for node in rules.nodes),
        subject=_ints(node.subject for node in rules.nodes),
        creates=_ints(node.creates for node in rules.nodes),
        outcome=_starts(len(node.outcomes) for node in rules.nodes),
        born_at=born_at,
        born=born,
        first_node=len(actions),
        first_outcome=len(tests),
        mention_at=mention_at,
        mention_word=mention_word,
        mentions=mentions,
        slot_of=_slot_of(rules),
        slot_at=slot_at,
        exists=exists,
        shifts=len(shifts),
        atom_from=_table([shift.atoms for shift in shifts]),
        effect_from=_table([shift.effects for shift in shifts]),
        **_goal(rules),
        tree=match_tree(rules),
    )


def in_words(atoms: Iterable[int]) -> dict[int, int]:
    """Atoms as a mask for each word that has some."""
    masks: dict[int, int] = {}
    for atom in atoms:
        masks[atom // WORD] = masks.get(atom // WORD, 0) | 1 << atom % WORD
    return masks


def _slot_of(rules: Rules) -> Ints:
    """Whether each object stands in a slot."""
    names = {name for slots in rules.slots for name in slots}
    return _ints(name in names for name in rules.object)


def _ints(values: Iterable[int]) -> Ints:
    return np.array(list(values), dtype=np.int64)


def _starts(sizes: Iterable[int]) -> Ints:
    return _ints([0, *accumulate(sizes)])


def _lists(lists: Iterable[Sequence[int]]) -> tuple[Ints, Ints]:
    rows = list(lists)
    return _starts(map(len, rows)), _ints(value for row in rows for value in row)


def _table(rows: Sequence[Sequence[int]]) -> Ints:
    return np.array(rows, dtype=np.int64).reshape(len(rows), len(rows[0]) if rows else 0)


def _pairs(lists: Iterable[tuple[Iterable[int], Iterable[int]]]) -> tuple[Ints, Ints, Ints, Ints]:
    """Pairs of lists of atoms: where each begins, words, and the masks of both."""
    sizes, rows = [], []
    for one, other in lists:
        first, second = in_words(one), in_words(other)
        both = sorted(first.keys() | second.keys())
        sizes.append(len(both))
        rows += [(word, first.get(word, 0), second.get(word, 0)) for word in both]
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    columns = (np.ascontiguousarray(column) for column in table.T)
    word, masks, others = columns
    return _starts(sizes), word, masks, others


def _tests(lists: Iterable[tuple[Iterable[int], Iterable[int]]]) -> tuple[Ints, Ints, Ints, Ints]:
    """Where each begins, words, what is tested, and what is required of it."""
    at, word, required, forbidden = _pairs(lists)
    return at, word, required | forbidden, required


def _goal(rules: Rules) -> dict[str, Ints]:
    conditions, kinds = rules.goal.conditions, rules.goal.kinds
    choices = [choice for condition in conditions for choice in condition.choices]
    # A condition that needs an atom cannot hold while none of these is true.
    needs: list[Iterable[int]] = [
        {atom for choice in condition.choices for atom in choice.atoms}
        if all(choice.atoms for choice in condition.choices)
        else ()
        for condition in conditions
    ]
    need_at, need_word, need_mask, _ = _pairs((atoms, ()) for atoms in needs)
    variable_at, variable = _lists(condition.variables for condition in conditions)
    numbers = variable.tolist()
    fresh = (number not in numbers[:i] for i, number in enumerate(numbers))
    widest = max((len(choice.objects) for choice in choices), default=0)
    deepest = max((len(choice.atoms) for choice in choices), default=0)
    return {
        "need_at": need_at,
        "need_word": need_word,
        "need_mask": need_mask,
        "variable_at": variable_at,
        "variable": variable,
        "variable_kind": _ints(kinds),
        "fresh": _ints(fresh),
        "choice_at": _starts(len(condition.choices) for condition in conditions),
        "chosen": _filled([choice.objects for choice in choices], widest),
        "chosen_atoms": _filled([choice.atoms for choice in choices], deepest),
    }


def _filled(rows: Sequence[Sequence[int]], width: int) -> Ints:
    """Rows of one length, filled up with -1."""
    return _table([[*row, *[-1] * (width - len(row))] for row in rows])
