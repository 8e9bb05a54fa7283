"""One step of a copy, as kernels: what `World.step` does, on a row of integers.

`t` are the `Tables`, `row` the state of a copy, `work` what is written on meanwhile: see `Work`.
Updates of effects are those of `EffectRun` in `world/grounding/effects.py`, without recursion. In a
step created objects keep the slots that they stand in; at its end they move up.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from robotouille.batch.goal_kernel import goal_reached
from robotouille.batch.rules import CONDITIONAL, CREATION, DELETION, REPETITIVE
from robotouille.batch.tables import Ints, Tables
from robotouille.compiling import compiler

__all__ = ["OVERFLOW", "Work", "step_copy", "work_for"]

kernel = compiler(Path(__file__).parent, nogil=True)

PAUSED, HOLDING, DONE = 0, 1, -1
WORD = 63

STARTED, DELETED, HOLES, OVERFLOW = range(4)
"""Places in `Work.flags`: effects that a run has started, objects that it has deleted; whether a
slot has become empty, whether there were too few, in this step."""


class Work(NamedTuple):
    """Room for one step: `flags`; by word, atoms about objects that this run has deleted; by
    object, whether it has; the effects that this run has started; a copy of a row; and places in
    the goal's lists of choices, with the object that stands for each variable."""

    flags: Ints
    gone: Ints
    deleted: Ints
    started: Ints
    row: Ints
    cursor: Ints
    binding: Ints


def work_for(t: Tables) -> Work:
    """Room for steps of copies, one after the other."""

    def zeros(size: int) -> Ints:
        return np.zeros(size, dtype=np.int64)

    return Work(
        flags=zeros(4),
        gone=zeros(t.words),
        deleted=zeros(len(t.mention_at) - 1),
        started=zeros(len(t.about_at)),
        row=zeros(len(t.initial)),
        cursor=zeros(len(t.variable_at)),
        binding=zeros(len(t.variable_kind)),
    )


@kernel
def _holds(t: Tables, row: Ints, test: int) -> bool:
    for i in range(t.test_at[test], t.test_at[test + 1]):
        if row[t.test_word[i]] & t.tested[i] != t.required[i]:
            return False
    return True


@kernel
def _write(t: Tables, row: Ints, work: Work, write: int, negated: bool) -> None:
    """Make atoms false, then true, but none about what this run has deleted."""
    for i in range(t.write_at[write], t.write_at[write + 1]):
        word = t.write_word[i]
        sets, clears = t.sets[i], t.clears[i]
        if negated:
            sets, clears = clears, sets
        row[word] = (row[word] & ~clears) | (sets & ~work.gone[word])


# Effects


@kernel
def _concerns_deleted(t: Tables, work: Work, effect: int) -> bool:
    if work.flags[DELETED] == 0:
        return False
    for i in range(t.about_at[effect], t.about_at[effect + 1]):
        if work.deleted[t.about[i]] != 0:
            return True
    return False


@kernel
def _update(t: Tables, row: Ints, work: Work, effect: int, active: bool) -> None:
    """One update of an effect: nodes forward, then backward, which of them have completed."""
    first, last = t.effect_at[effect], t.effect_at[effect + 1]
    node = first
    while node < last:
        place = t.progress + node
        kind = t.kind[node]
        if row[place] == DONE:
            node = t.end[node]
        elif kind == CONDITIONAL:
            if t.possible[node] != 0 and _holds(t, row, t.first_node + node):
                row[place] = HOLDING
                _write(t, row, work, t.first_node + node, False)
                node += 1
            else:
                if row[place] == HOLDING:
                    row[place] = PAUSED
                    _write(t, row, work, t.first_node + node, True)
                node = t.end[node]
        elif kind == CREATION:
            _create(t, row, work, node)
            row[place] = DONE
            node += 1
        elif kind == DELETION:
            _delete(t, row, work, node)
            row[place] = DONE
            node += 1
        elif row[place] >= t.total[node]:
            node += 1
        elif active != (kind == REPETITIVE):
            node = t.end[node]
        else:
            row[place] += 1
            if row[place] < t.total[node]:
                node = t.end[node]
            else:
                _write(t, row, work, t.first_node + node, False)
                node += 1
    node = last - 1
    while node >= first:
        if _has_completed(t, row, node):
            row[t.progress + node] = DONE
        node -= 1


@kernel
def _has_completed(t: Tables, row: Ints, node: int) -> bool:
    """Whether a node is past what it waits for, and all that is nested in it has completed."""
    kind, progress = t.kind[node], row[t.progress + node]
    if kind == CONDITIONAL:
        if progress != HOLDING:
            return False
    elif kind == CREATION or kind == DELETION or progress < t.total[node]:  # noqa: PLR1714
        return False
    child = node + 1
    while child < t.end[node]:
        if row[t.progress + child] != DONE:
            return False
        child = t.end[child]
    return True


@kernel
def _create(t: Tables, row: Ints, work: Work, node: int) -> None:
    kind = t.creates[node]
    slot = row[t.top + kind]
    if slot >= t.slot_at[kind + 1] - t.slot_at[kind]:
        work.flags[OVERFLOW] = 1
        return
    row[t.top + kind] = slot + 1
    outcome = t.outcome[node] + slot
    _write(t, row, work, t.first_outcome + outcome, False)
    _start(t, work, outcome)


@kernel
def _delete(t: Tables, row: Ints, work: Work, node: int) -> None:
    _write(t, row, work, t.first_node + node, False)
    subject = t.subject[node]
    for i in range(t.mention_at[subject], t.mention_at[subject + 1]):
        word = t.mention_word[i]
        row[word] &= ~t.mentions[i]
        work.gone[word] |= t.mentions[i]
    work.flags[DELETED] += 1
    work.deleted[subject] = 1
    if t.slot_of[subject] != 0:
        work.flags[HOLES] = 1
    _start(t, work, t.outcome[node])


@kernel
def _start(t: Tables, work: Work, outcome: int) -> None:
    """Note the effects that a creation or deletion starts, each once."""
    for i in range(t.born_at[outcome], t.born_at[outcome + 1]):
        count = work.flags[STARTED]
        place = 0
        while place < count and work.started[place] != t.born[i]:
            place += 1
        if place == count and not _concerns_deleted(t, work, t.born[i]):
            work.started[count] = t.born[i]
            work.flags[STARTED] = count + 1


@kernel
def _place_of(t: Tables, row: Ints, effect: int) -> int:
    """Where an effect stands among those that are active; -1 if it does not."""
    for i in range(row[t.count]):
        if row[t.order + i] == effect:
            return i
    return -1


@kernel
def _append(t: Tables, row: Ints, effect: int) -> None:
    row[t.order + row[t.count]] = effect
    row[t.count] += 1


@kernel
def _settle(t: Tables, row: Ints, work: Work, ends: bool) -> None:
    """Add what has been started, drop what has ended, and be ready for another run.

    What has completed is dropped at the end of a step only (`ends`).
    """
    for i in range(work.flags[STARTED]):
        if _place_of(t, row, work.started[i]) < 0:
            _append(t, row, work.started[i])
    count = row[t.count]
    kept = 0
    for i in range(count):
        effect = row[t.order + i]
        done = ends and row[t.progress + t.effect_at[effect]] == DONE
        if done or _concerns_deleted(t, work, effect):
            for node in range(t.effect_at[effect], t.effect_at[effect + 1]):
                row[t.progress + node] = 0
        else:
            row[t.order + kept] = effect
            kept += 1
    for i in range(kept, count):
        row[t.order + i] = 0
    row[t.count] = kept
    work.flags[STARTED] = 0
    if work.flags[DELETED] != 0:
        work.flags[DELETED] = 0
        work.gone[:] = 0
        work.deleted[:] = 0


# Steps


@kernel
def _apply(t: Tables, row: Ints, work: Work, player: int, number: int) -> bool:
    """Apply a player's action if its preconditions hold now."""
    action = t.action_at[player] + number
    if row[t.busy + player] != 0 or not _holds(t, row, action):
        return False
    _write(t, row, work, action, False)
    if t.duration[action] != 0:
        row[t.busy + player] = t.duration[action]
    if t.starts_at[action] < t.starts_at[action + 1]:
        for i in range(t.starts_at[action], t.starts_at[action + 1]):
            effect = t.starts[i]
            if not _concerns_deleted(t, work, effect):
                if _place_of(t, row, effect) < 0:
                    _append(t, row, effect)
                _update(t, row, work, effect, True)
        _settle(t, row, work, False)
    return True


@kernel
def _tick(t: Tables, row: Ints, work: Work) -> None:
    """The passive update of all effects, and a step less for players that are busy."""
    for player in range(t.players):
        if row[t.busy + player] != 0:
            row[t.busy + player] -= 1
    if row[t.count] != 0:
        for i in range(row[t.count]):
            effect = row[t.order + i]
            if not _concerns_deleted(t, work, effect):
                _update(t, row, work, effect, False)
        _settle(t, row, work, True)


@kernel
def _move_up(t: Tables, row: Ints, work: Work) -> None:
    """Objects move into slots that have become empty, the last of these first."""
    for kind in range(len(t.slot_at) - 1):
        first = t.slot_at[kind]
        slot = row[t.top + kind] - 1
        while slot >= 0:
            atom = t.exists[first + slot]
            if row[atom // WORD] >> (atom % WORD) & 1 == 0:
                _shift(t, row, work, first + slot)
                row[t.top + kind] -= 1
            slot -= 1


@kernel
def _shift(t: Tables, row: Ints, work: Work, slot: int) -> None:
    before = work.row
    before[:] = row
    row[: t.words] = 0
    for atom in range(t.atoms):
        source = t.atom_from[slot, atom]
        if source >= 0:
            row[atom // WORD] |= (before[source // WORD] >> (source % WORD) & 1) << (atom % WORD)
    row[t.progress :] = 0
    for effect in range(len(t.effect_at) - 1):
        source = t.effect_from[slot, effect]
        if source >= 0:
            for i in range(t.effect_at[effect + 1] - t.effect_at[effect]):
                row[t.progress + t.effect_at[effect] + i] = before[
                    t.progress + t.effect_at[source] + i
                ]
            place = _place_of(t, before, source)
            if place >= 0:
                row[t.order + place] = effect


@kernel
def step_copy(t: Tables, row: Ints, work: Work, actions: Ints, applied: npt.NDArray[np.bool_]) -> bool:
    """One step of a copy: the players' actions in the order of their seats, then time.

    `applied` says which were applied. Returns whether the goal holds. Where a slot was
    missing, `work.flags[OVERFLOW]` says so, and the row is of no use.
    """
    work.flags[:] = 0
    for player in range(t.players):
        applied[player] = False
        if actions[player] >= 0 and _apply(t, row, work, player, actions[player]):
            applied[player] = True
    _tick(t, row, work)
    if work.flags[HOLES] != 0 and t.shifts != 0:
        _move_up(t, row, work)
    return goal_reached(t, row, work.cursor, work.binding)
