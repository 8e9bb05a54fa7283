"""Rules as one array of integers for kernels; what is where in it is told in `layout`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.goal_rule import ConditionRule
from robotouille.batch.match_tree import match_tree
from robotouille.batch.rules import ActionRule, EffectOutcome, NodeRule, Rules

__all__ = ["Ints", "in_words", "initial_row", "tables"]

Ints = npt.NDArray[np.int64]

FLAGS = 5
"""Numbers before all others in `work`."""

Lists = dict[int, Sequence[int]]
"""Lists by their name in `layout`."""


def tables(rules: Rules) -> Ints:
    """The rules of a world, laid out for kernels."""
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


def initial_row(rules: Rules, t: Ints) -> Ints:
    """The row of the initial state."""
    row = np.zeros(t[at.WIDTH], dtype=np.int64)
    for word, mask in in_words(rules.atoms_of(rules.world.initial.facts)).items():
        row[word] = mask
    row[t[at.GOAL]] = 1
    return row


def in_words(atoms: Iterable[int]) -> dict[int, int]:
    """Atoms as a mask for each word that has some."""
    masks: dict[int, int] = {}
    for atom in atoms:
        masks[atom // at.WORD] = masks.get(atom // at.WORD, 0) | 1 << atom % at.WORD
    return masks


def _sizes(rules: Rules, deepest: int) -> dict[int, int]:
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


def _words(rules: Rules) -> int:
    return 1 + (len(rules.encoding.atoms) - 1) // at.WORD


def _places(first: int, sizes: dict[int, int]) -> dict[int, int]:
    """Where parts of these sizes begin, one behind the other."""
    return dict(zip(sizes, accumulate(sizes.values(), initial=first), strict=False))


def _rules(rules: Rules) -> Lists:
    """What is tested and written, by actions, nodes and outcomes: see `layout`."""
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
    """The record of a rule, up to its writes: word, what is set, what is cleared."""
    sets, clears = in_words(writes.sets), in_words(writes.clears)
    rows = [
        (word, sets.get(word, 0), clears.get(word, 0))
        for word in sorted(sets.keys() | clears.keys())
    ]
    return [*_counted(tests), *_counted([number for row in rows for number in row])]


def _tests(rule: ActionRule | NodeRule) -> list[int]:
    """Tests as words, what is tested and what is required; one that fails if it is impossible."""
    if not rule.possible:
        return [0, 0, 1]
    required, forbidden = in_words(rule.required), in_words(rule.forbidden)
    rows = [
        (word, required.get(word, 0) | forbidden.get(word, 0), required.get(word, 0))
        for word in sorted(required.keys() | forbidden.keys())
    ]
    return [number for row in rows for number in row]


def _counted(numbers: Sequence[int]) -> list[int]:
    """Numbers, and before them how many there are."""
    return [len(numbers), *numbers]


def _effects(rules: Rules) -> Lists:
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


def _objects(rules: Rules) -> Lists:
    in_slots = {name for names in rules.slots for name in names}
    mention_at, mention_word, mentions, _ = _pairs((atoms, ()) for atoms in rules.mentions)
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


def _goal(rules: Rules) -> Lists:
    conditions = rules.goal.conditions
    choices = [choice for condition in conditions for choice in condition.choices]
    choice_at = _starts(len(condition.choices) for condition in conditions)
    by_atom = [_by_atom(c, first) for c, first in zip(conditions, choice_at, strict=False)]
    need_at, need_word, need_mask, _ = _pairs((atoms, ()) for atoms in by_atom)
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
    """The choices of a condition by the one atom that each needs; none where one is otherwise."""
    if any(len(choice.atoms) != 1 for choice in condition.choices):
        return {}
    return {choice.atoms[0]: first + i for i, choice in enumerate(condition.choices)}


def _by_bit(by_atom: Iterable[Mapping[int, int]]) -> tuple[list[int], list[int]]:
    """For each word of each condition where its choices begin, and choices by the bit of a word."""
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


def _pairs(
    lists: Iterable[tuple[Iterable[int], Iterable[int]]],
) -> tuple[list[int], list[int], list[int], list[int]]:
    """Pairs of lists of atoms: where each begins, words, and the masks of both."""
    sizes: list[int] = []
    words: list[int] = []
    masks: list[int] = []
    others: list[int] = []
    for one, other in lists:
        first, second = in_words(one), in_words(other)
        both = sorted(first.keys() | second.keys())
        sizes.append(len(both))
        words += both
        masks += [first.get(word, 0) for word in both]
        others += [second.get(word, 0) for word in both]
    return _starts(sizes), words, masks, others


def _filled(rows: Iterable[Sequence[int]], width: int) -> list[int]:
    """Rows of one length, filled up with -1, one behind the other."""
    return [value for row in rows for value in (*row, *[-1] * (width - len(row)))]
