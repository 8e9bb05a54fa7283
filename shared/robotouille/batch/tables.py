"""A world's rules as one array of integers for kernels; `layout` documents the array."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.rules import (
    ActionRule,
    CompiledRules,
    ConditionRule,
    EffectOutcome,
    NodeRule,
)

Ints = npt.NDArray[np.int64]


class CopyRange(NamedTuple):
    """Copies on which one kernel call works, and arrays on which it may write.

    It keeps kernels below eight parameters. Numba passes the fields of a named tuple like
    arguments, so this costs nothing inside kernels, and 0.8 µs for each call from Python.
    """

    tables: Ints
    """The world's rules."""
    rows: npt.NDArray[np.int64]
    """The states, one row for each copy."""
    row: Ints
    """Room for one row."""
    work: Ints
    """Room for one step; see `layout`."""
    found: Ints
    """Room for the numbers of one player's valid actions."""
    first: int
    last: int


FLAGS = 5
"""Number of flags at the beginning of `work`."""

Lists = dict[int, Sequence[int]]
"""Lists by their constant in `layout`."""


def tables(rules: CompiledRules) -> Ints:
    """Return a world's rules as an array for kernels."""
    tree = match_tree(rules)
    lists = {**_rules(rules), **_effects(rules), **_objects(rules), **_goal(rules)}
    lists |= {at.ROOT: tree.roots, at.TREE: tree.numbers}
    header = np.zeros(at.NUMBERS, dtype=np.int64)
    for name, number in _sizes(rules, tree.deepest).items():
        header[name] = number
    parts, place = [header], len(header)
    for name, values in lists.items():
        header[name] = place
        parts.append(np.array(values, dtype=np.int64))
        place += len(values)
    return np.concatenate(parts)


def initial_row(rules: CompiledRules, t: Ints) -> Ints:
    """Return the row of the initial state."""
    row = np.zeros(t[at.WIDTH], dtype=np.int64)
    for word, mask in in_words(rules.atoms_of(rules.world.initial.facts)).items():
        row[word] = mask
    row[t[at.GOAL]] = 1  # not known: the first step tests the goal
    return row


def in_words(atoms: Iterable[int]) -> dict[int, int]:
    """Return the words that these atoms are in, with a mask of the atoms in each."""
    masks: dict[int, int] = {}
    for atom in atoms:
        masks[atom // at.WORD] = masks.get(atom // at.WORD, 0) | 1 << atom % at.WORD
    return masks


def _sizes(rules: CompiledRules, deepest: int) -> dict[int, int]:
    players, effects, nodes = len(rules.players), len(rules.effects), len(rules.nodes)
    conditions, variables = len(rules.goal.conditions), len(rules.goal.kinds)
    choices = [choice for condition in rules.goal.conditions for choice in condition.choices]
    words = _words(rules)
    width = words + len(rules.kinds) + players + 2 + effects + nodes
    actions = sum(len(each) for each in rules.actions)
    return {
        at.WORDS: words,
        at.ATOMS: len(rules.encoding.atoms),
        at.PLAYERS: players,
        at.EFFECTS: effects,
        at.OBJECTS: len(rules.object),
        at.KINDS: len(rules.kinds),
        at.SHIFTS: sum(len(each) for each in rules.shifts),
        at.CONDITIONS: conditions,
        at.VARIABLES: variables,
        at.CHOSEN_WIDTH: max((len(choice.objects) for choice in choices), default=0),
        at.CHOSEN_ATOMS_WIDTH: max((len(choice.atoms) for choice in choices), default=0),
        at.FIRST_NODE: actions,
        at.FIRST_OUTCOME: actions + nodes,
        **_places(
            words,
            {at.TOP: len(rules.kinds), at.BUSY: players, at.GOAL: 1, at.COUNT: 1, at.ORDER: effects,
             at.PROGRESS: nodes, at.WIDTH: 0},
        ),
        **_places(
            FLAGS,
            {at.GONE: words, at.IS_DELETED: len(rules.object), at.IS_STARTED: effects,
             at.ROW_COPY: width, at.CURSOR: conditions + 1, at.BINDING: variables,
             at.LIVE: len(choices), at.LIVE_COUNT: conditions,
             at.STACK: deepest + 1, at.WORK_SIZE: 0},
        ),
    }  # fmt: skip


def _words(rules: CompiledRules) -> int:
    return 1 + (len(rules.encoding.atoms) - 1) // at.WORD


def _places(first: int, sizes: dict[int, int]) -> dict[int, int]:
    """Return where consecutive parts of these sizes begin."""
    return dict(zip(sizes, accumulate(sizes.values(), initial=first), strict=False))


def _rules(rules: CompiledRules) -> Lists:
    """Return the tests and writes of actions, nodes and outcomes; see `layout`."""
    actions = [action for each in rules.actions for action in each]
    outcomes = [outcome for node in rules.nodes for outcome in node.outcomes]
    records = [
        *([*_rule(_tests(a), a), a.duration, *_counted(a.effects)] for a in actions),
        *(_rule(_tests(node), node) for node in rules.nodes),
        *(_rule([], outcome) for outcome in outcomes),
    ]
    rule_at, record = _lists(records)
    return {
        at.ACTION_AT: _starts(len(each) for each in rules.actions),
        at.RULE_AT: rule_at,
        at.RULE: record,
    }


def _rule(tests: Sequence[int], writes: ActionRule | NodeRule | EffectOutcome) -> list[int]:
    """Return a rule's record up to its writes: word, mask of set bits, mask of cleared bits."""
    sets, clears = in_words(writes.sets), in_words(writes.clears)
    rows = [
        (word, sets.get(word, 0), clears.get(word, 0))
        for word in sorted(sets.keys() | clears.keys())
    ]
    return [*_counted(tests), *_counted([number for row in rows for number in row])]


def _tests(rule: ActionRule | NodeRule) -> list[int]:
    """Return a rule's tests: word, mask of tested bits, their required values."""
    if not rule.possible:
        # No word equals 1 under the mask 0, so this test always fails.
        return [0, 0, 1]
    required, forbidden = in_words(rule.required), in_words(rule.forbidden)
    rows = [
        (word, required.get(word, 0) | forbidden.get(word, 0), required.get(word, 0))
        for word in sorted(required.keys() | forbidden.keys())
    ]
    return [number for row in rows for number in row]


def _counted(numbers: Sequence[int]) -> list[int]:
    """Return numbers preceded by their count."""
    return [len(numbers), *numbers]


def _effects(rules: CompiledRules) -> Lists:
    nodes: list[NodeRule] = rules.nodes
    about_at, about = _lists(effect.objects for effect in rules.effects)
    born_at, born = _lists(outcome.born for node in nodes for outcome in node.outcomes)
    return {
        at.EFFECT_AT: [*(effect.first for effect in rules.effects), len(nodes)],
        at.ABOUT_AT: about_at,
        at.ABOUT: about,
        at.KIND: [node.kind for node in nodes],
        at.END: [node.end for node in nodes],
        at.TOTAL: [node.total for node in nodes],
        at.SUBJECT: [node.subject for node in nodes],
        at.CREATES: [node.creates for node in nodes],
        at.OUTCOME: _starts(len(node.outcomes) for node in nodes),
        at.BORN_AT: born_at,
        at.BORN: born,
    }


def _objects(rules: CompiledRules) -> Lists:
    in_slots = {name for names in rules.slots for name in names}
    mention_at, mention_word, mentions = _by_word(rules.mentions)
    slot_at, exists = _lists(rules.exists)
    shifts = [shift for each in rules.shifts for shift in each]
    return {
        at.MENTION_AT: mention_at,
        at.MENTION_WORD: mention_word,
        at.MENTIONS: mentions,
        at.SLOT_OF: [name in in_slots for name in rules.object],
        at.SLOT_AT: slot_at,
        at.EXISTS: exists,
        at.ATOM_FROM: [atom for shift in shifts for atom in shift.atoms],
        at.EFFECT_FROM: [effect for shift in shifts for effect in shift.effects],
    }


def _goal(rules: CompiledRules) -> Lists:
    conditions = rules.goal.conditions
    choices = [choice for condition in conditions for choice in condition.choices]
    choice_at = _starts(len(condition.choices) for condition in conditions)
    by_atom = [_by_atom(c, first) for c, first in zip(conditions, choice_at, strict=False)]
    need_at, need_word, need_mask = _by_word(by_atom)
    need_choice, choice_of = _by_bit(by_atom)
    variable_at, variable = _lists(condition.variables for condition in conditions)
    width = max((len(choice.objects) for choice in choices), default=0)
    atoms_width = max((len(choice.atoms) for choice in choices), default=0)
    relevant = in_words(atom for choice in choices for atom in choice.atoms)
    return {
        at.RELEVANT: [relevant.get(word, 0) for word in range(_words(rules))],
        at.NEED_AT: need_at,
        at.NEED_WORD: need_word,
        at.NEED_MASK: need_mask,
        at.NEED_CHOICE: need_choice,
        at.CHOICE_OF: choice_of,
        at.VARIABLE_AT: variable_at,
        at.VARIABLE: variable,
        at.VARIABLE_KIND: rules.goal.kinds,
        at.FRESH: [number not in variable[:i] for i, number in enumerate(variable)],
        at.CHOICE_AT: choice_at,
        at.CHOSEN: _filled((choice.objects for choice in choices), width),
        at.CHOSEN_ATOMS: _filled((choice.atoms for choice in choices), atoms_width),
    }


def _by_atom(condition: ConditionRule, first: int) -> dict[int, int]:
    """Return a condition's choices by their atom; empty unless each choice needs exactly one."""
    if any(len(choice.atoms) != 1 for choice in condition.choices):
        return {}
    return {choice.atoms[0]: first + i for i, choice in enumerate(condition.choices)}


def _by_bit(by_atom: Iterable[Mapping[int, int]]) -> tuple[list[int], list[int]]:
    """Return lists that lead from a bit of a condition's atoms to the choice that needs it.

    The first list has, for each word of each condition, the start of its part of the second list.
    That part has a choice, or -1, for each bit of the word.
    """
    starts: list[int] = []
    table: list[int] = []
    for choices in by_atom:
        for word in sorted({atom // at.WORD for atom in choices}):
            starts.append(len(table))
            table += [choices.get(word * at.WORD + bit, -1) for bit in range(at.WORD)]
    return starts, table


def _starts(sizes: Iterable[int]) -> list[int]:
    return [0, *accumulate(sizes)]


def _lists(lists: Iterable[Sequence[int]]) -> tuple[list[int], list[int]]:
    rows = list(lists)
    return _starts(map(len, rows)), [value for row in rows for value in row]


def _by_word(lists: Iterable[Iterable[int]]) -> tuple[list[int], list[int], list[int]]:
    """Return lists of atoms as words and masks, with the start of each list in both."""
    rows = [sorted(in_words(atoms).items()) for atoms in lists]
    words = [word for row in rows for word, _ in row]
    return _starts(map(len, rows)), words, [mask for row in rows for _, mask in row]


def _filled(rows: Iterable[Sequence[int]], width: int) -> list[int]:
    """Return rows padded with -1 to one width, as one list."""
    return [value for row in rows for value in (*row, *[-1] * (width - len(row)))]


OpenAction = tuple[int, frozenset[int]]
"""An action's number, and the required atoms that no node above has tested."""


class MatchTree(NamedTuple):
    """Trees with which a kernel finds each player's valid actions.

    A tree node lists the actions whose required atoms its ancestors have tested. It then branches
    by atom: below an atom are actions that require it. A kernel descends only below true atoms,
    so it reaches an action only if everything that the action requires is true.

    Attributes:
        roots: Position of each player's root in `numbers`.
        numbers: The nodes; `_TreeBuilder._node` writes their format.
        deepest: Largest number of nodes that wait to be visited at once.
    """

    roots: list[int]
    numbers: list[int]
    deepest: int


def match_tree(rules: CompiledRules) -> MatchTree:
    """Build the trees of all players."""
    builder = _TreeBuilder(_likely_false(rules))
    roots = [builder.add_player(actions) for actions in rules.actions]
    return MatchTree(roots, builder.numbers, builder.deepest)


class _TreeBuilder:
    def __init__(self, likely_false: list[float]) -> None:
        self._likely_false = likely_false
        self.numbers: list[int] = []
        self.deepest = 1

    def add_player(self, actions: Iterable[ActionRule]) -> int:
        listed = tuple(actions)
        open_actions = [
            (number, frozenset(action.required))
            for number, action in enumerate(listed)
            if action.possible
        ]
        return self._node(listed, open_actions, 1)

    def _node(
        self, actions: tuple[ActionRule, ...], open_actions: list[OpenAction], waiting: int
    ) -> int:
        """Add a node after the nodes below it, and return its position.

        A node is the count of its actions, these, the count of its tests' numbers, and these. An
        action that also has forbidden atoms is stored as -1 - number.
        """
        here = [number for number, atoms in open_actions if not atoms]
        below = self._split([each for each in open_actions if each[1]])
        waiting += len(below)
        self.deepest = max(self.deepest, waiting)
        places = {atom: self._below(actions, below[atom], waiting) for atom in sorted(below)}
        words: dict[int, list[int]] = {}
        for atom in places:
            words.setdefault(atom // at.WORD, []).append(atom)
        tests = [number for atoms in words.values() for number in self._test(atoms, places)]
        place = len(self.numbers)
        self.numbers += [len(here), *(-1 - n if actions[n].forbidden else n for n in here)]
        self.numbers += [len(tests), *tests]
        return place

    def _below(
        self, actions: tuple[ActionRule, ...], open_actions: list[OpenAction], waiting: int
    ) -> int:
        # A leaf with a single action needs no node of its own: -1 means nothing, -2 action 0.
        if (
            len(open_actions) == 1
            and not open_actions[0][1]
            and not actions[open_actions[0][0]].forbidden
        ):
            return -2 - open_actions[0][0]
        return self._node(actions, open_actions, waiting)

    def _test(self, atoms: list[int], places: dict[int, int]) -> tuple[int, int, int]:
        """Add the positions of the nodes below the atoms of one word.

        Returns:
            The word, the mask of its atoms, and the position that belongs to its bit 0.
        """
        first, start = atoms[0] % at.WORD, len(self.numbers)
        word = atoms[0] // at.WORD
        self.numbers += [places.get(atom, -1) for atom in range(atoms[0], atoms[-1] + 1)]
        return word, sum(1 << atom % at.WORD for atom in atoms), start - first

    def _split(self, open_actions: list[OpenAction]) -> dict[int, list[OpenAction]]:
        """Assign each action to one of its open atoms, below which it is found.

        The choice is greedy: the next atom is one that many actions require and that is likely to
        be false, because a false atom excludes all actions below it with one test.
        """
        below: dict[int, list[OpenAction]] = {}
        counts = Counter(atom for _, atoms in open_actions for atom in atoms)
        weight = self._likely_false
        while open_actions:
            atom = max(counts, key=lambda a: (counts[a] * weight[a], -a))
            below[atom] = [
                (number, atoms - {atom}) for number, atoms in open_actions if atom in atoms
            ]
            open_actions = [each for each in open_actions if atom not in each[1]]
            for _, atoms in below[atom]:
                counts.subtract([*atoms, atom])
        return below


def _likely_false(rules: CompiledRules) -> list[float]:
    """Estimate for each atom how likely it is to be false.

    The estimate is the share of its predicate's atoms that are false in the initial state, with
    one more true and one more false so that no share is 0 or 1.
    """
    initial = set(rules.atoms_of(rules.world.initial.facts))
    atoms = rules.encoding.atoms
    all_of = Counter(atom[0] for atom in atoms)
    true_of = Counter(atom[0] for i, atom in enumerate(atoms) if i in initial)
    return [1 - (true_of[atom[0]] + 1) / (all_of[atom[0]] + 2) for atom in atoms]
