"""A world's rules as JAX arrays, with all rows of a table padded to the same length.

Atoms are padded with an index beyond the last atom, which JAX ignores. Other numbers are padded
with -1.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from robotouille.batch.rules import ActionRule, CompiledRules, EffectOutcome, GoalRule, NodeRule

Array = Any
"""A JAX array, traced or not."""


class Tests(NamedTuple):
    """Conditions, one row for each rule.

    A rule holds if it is possible, all required atoms are true and no forbidden atom is.
    """

    possible: Array
    required: Array
    forbidden: Array


class Writes(NamedTuple):
    """One row for each rule: the atoms that it sets and clears, padded to one width."""

    sets: Array
    clears: Array


class GoalTable(NamedTuple):
    """The goal, with one row for each condition in all arrays but `kinds`.

    Attributes:
        objects: For each choice, an object for each variable.
        atoms: For each choice, the atoms that it needs.
        there: True for choices, false for padding.
        variable: The condition's variables.
        fresh: True if no earlier condition has the variable.
        kinds: The kind of each variable.
    """

    objects: Array
    atoms: Array
    there: Array
    variable: Array
    fresh: Array
    kinds: Array


class Padded(NamedTuple):
    """The rules of a world.

    Rows about actions have those of all players in turn. Rows about nodes have those of all
    effects; `effect_of` has the effect of each node. Shifts are by kind and slot, with the last
    slot first.
    """

    actions: Tests
    action_writes: Writes
    duration: Array
    starts: Array
    first: Array
    size: Array
    about: Array
    nodes: Tests
    node_writes: Writes
    kind: Array
    end: Array
    children: Array
    total: Array
    subject: Array
    creates: Array
    outcome: Array
    effect_of: Array
    outcome_writes: Writes
    born: Array
    mentions: Array
    in_slot: Array
    slots: Array
    shift_kind: Array
    shift_slot: Array
    shift_exists: Array
    atom_from: Array
    effect_from: Array
    node_from: Array
    goal: GoalTable
    vector_from: Array
    initial: Array


def padded(rules: CompiledRules) -> Padded:
    """Return a world's rules as arrays."""
    none = len(rules.encoding.atoms)
    actions = [action for each in rules.actions for action in each]
    nodes, effects = rules.nodes, rules.effects
    outcomes = [outcome for node in nodes for outcome in node.outcomes]
    outcome_at = np.cumsum([0, *(len(node.outcomes) for node in nodes)])[:-1]
    owner = [i for i, effect in enumerate(effects) for _ in range(effect.first, effect.end)]
    about = np.zeros((len(effects), len(rules.object)), bool)
    for i, effect in enumerate(effects):
        about[i, list(effect.objects)] = True
    mentions = np.zeros((len(rules.object), none), bool)
    for i, atoms in enumerate(rules.mentions):
        mentions[i, list(atoms)] = True
    initial = np.zeros(none, bool)
    initial[list(rules.atoms_of(rules.world.initial.facts))] = True
    in_slots = {name for names in rules.slots for name in names}
    return Padded(
        actions=_tests(actions, none),
        action_writes=_writes(actions, none),
        duration=ints(action.duration for action in actions),
        starts=rows((action.effects for action in actions), -1),
        first=ints(effect.first for effect in effects),
        size=ints(effect.end - effect.first for effect in effects),
        about=jnp.asarray(about),
        nodes=_tests(nodes, none),
        node_writes=_writes(nodes, none),
        kind=ints(node.kind for node in nodes),
        end=ints(node.end for node in nodes),
        children=rows((_children(nodes, i) for i in range(len(nodes))), -1),
        total=ints(node.total for node in nodes),
        subject=ints(node.subject for node in nodes),
        creates=ints(node.creates for node in nodes),
        outcome=ints(outcome_at.tolist()),
        effect_of=ints(owner),
        outcome_writes=_writes(outcomes, none),
        born=rows((outcome.born for outcome in outcomes), -1),
        mentions=jnp.asarray(mentions),
        in_slot=jnp.asarray([name in in_slots for name in rules.object]),
        slots=ints(len(atoms) for atoms in rules.exists),
        **_shifts(rules, owner),
        goal=goal_table(rules.goal, none),
        vector_from=_vector_from(rules),
        initial=jnp.asarray(initial),
    )


def _tests(rules: Sequence[ActionRule | NodeRule], none: int) -> Tests:
    return Tests(
        jnp.asarray([rule.possible for rule in rules], bool),
        rows((rule.required for rule in rules), none),
        rows((rule.forbidden for rule in rules), none),
    )


def _writes(rules: Sequence[ActionRule | NodeRule | EffectOutcome], none: int) -> Writes:
    both = rows([*(rule.sets for rule in rules), *(rule.clears for rule in rules)], none)
    return Writes(both[: len(rules)], both[len(rules) :])


def _children(nodes: Sequence[NodeRule], node: int) -> list[int]:
    children = []
    child = node + 1
    while child < nodes[node].end:
        children.append(child)
        child = nodes[child].end
    return children


def _shifts(rules: CompiledRules, owner: Sequence[int]) -> dict[str, Array]:
    """Return the tables of shifts, with the last slot of each kind first."""
    places = [
        (kind, slot)
        for kind, shifts in enumerate(rules.shifts)
        for slot in reversed(range(len(shifts)))
    ]
    shifts = [rules.shifts[kind][slot] for kind, slot in places]
    nodes = []
    for shift in shifts:
        sources = [shift.effects[effect] for effect in owner]
        firsts = [rules.effects[effect].first for effect in owner]
        nodes.append([
            -1 if source < 0 else rules.effects[source].first + node - first
            for node, (source, first) in enumerate(zip(sources, firsts, strict=True))
        ])  # fmt: skip
    return {
        "shift_kind": ints(kind for kind, _ in places),
        "shift_slot": ints(slot for _, slot in places),
        "shift_exists": ints(rules.exists[kind][slot] for kind, slot in places),
        "atom_from": rows((shift.atoms for shift in shifts), -1),
        "effect_from": rows((shift.effects for shift in shifts), -1),
        "node_from": rows(nodes, -1),
    }


def goal_table(goal: GoalRule, none: int) -> GoalTable:
    """Return a goal as arrays."""
    conditions, variables = goal.conditions, len(goal.kinds)
    most = max((len(c.choices) for c in conditions), default=0)
    width = max((len(c.variables) for c in conditions), default=0)
    deepest = max((len(x.atoms) for c in conditions for x in c.choices), default=0)
    objects = np.full((len(conditions), most, width), -1)
    atoms = np.full((len(conditions), most, deepest), none)
    there = np.zeros((len(conditions), most), bool)
    variable = np.full((len(conditions), width), variables)
    fresh = np.zeros((len(conditions), width), bool)
    seen: set[int] = set()
    for i, condition in enumerate(conditions):
        variable[i, : len(condition.variables)] = condition.variables
        fresh[i, : len(condition.variables)] = [v not in seen for v in condition.variables]
        seen.update(condition.variables)
        for j, choice in enumerate(condition.choices):
            there[i, j] = True
            objects[i, j, : len(choice.objects)] = choice.objects
            atoms[i, j, : len(choice.atoms)] = choice.atoms
    tables = (objects, atoms, there, variable, fresh, np.array([*goal.kinds, -1]))
    return GoalTable(*map(jnp.asarray, tables))


def _vector_from(rules: CompiledRules) -> Array:
    """Return the sources of an effect's numbers in a vector: its activity, then its counters."""
    sources: list[int] = []
    for i, effect in enumerate(rules.effects):
        sources += [i, *range(len(rules.effects) + effect.first, len(rules.effects) + effect.end)]
    return ints(sources)


def ints(values: Iterable[int]) -> Array:
    return jnp.asarray(np.array(list(values), dtype=np.int32))


def rows(given: Iterable[Sequence[int]], fill: int) -> Array:
    """Return rows padded to one length of at least 1."""
    listed = [list(row) for row in given]
    width = max(1, *map(len, listed)) if listed else 1
    full = [row + [fill] * (width - len(row)) for row in listed]
    return jnp.asarray(np.array(full, dtype=np.int32).reshape(len(full), width))
