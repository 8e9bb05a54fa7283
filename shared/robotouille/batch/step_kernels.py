"""Kernels that take one step: `World.step` on a row of integers.

`t` holds the tables, `row` the state of a copy, and `work` temporary values; see `layout`. Effects
are updated as by `EffectRun` in `world/grounding/effects.py`, but without recursion. Created
objects keep their slots during a step. At its end, they move up into slots that became empty.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.rules import CONDITIONAL, CREATION, DELETION, REPETITIVE
from robotouille.batch.state_kernels import get, goal_reached, holds, kernel
from robotouille.batch.tables import CopyRange, Ints
from robotouille.compiling import unsigned

PAUSED, HOLDING, DONE = 0, 1, -1


@kernel
def _writes_of(t: Ints, rule: int) -> int:
    """Return the position of a rule's writes in `t`, where their count is."""
    place = t[at.RULE] + get(t, at.RULE_AT, rule)
    writes: int = place + 1 + t[unsigned(place)]
    return writes


@kernel
def _write(t: Ints, row: Ints, work: Ints, rule: int, negated: bool) -> None:
    """Make atoms false, then true, except atoms about objects that this run has deleted."""
    place = _writes_of(t, rule)
    for write in range(place + 1, place + 1 + t[unsigned(place)], 3):
        word, sets, clears = t[unsigned(write)], t[unsigned(write + 1)], t[unsigned(write + 2)]
        if negated:
            sets, clears = clears, sets
        # If one write both clears and sets an atom, it becomes true, as in `World.step`.
        before = row[unsigned(word)]
        row[unsigned(word)] = (before & ~clears) | (sets & ~work[unsigned(t[at.GONE] + word)])
        work[at.TOUCHED] |= (before ^ row[unsigned(word)]) & get(t, at.RELEVANT, word)


# Effects


@kernel
def _concerns_deleted(t: Ints, work: Ints, effect: int) -> bool:
    # Nearly all runs delete nothing, and this is called for every effect.
    if work[at.DELETED] == 0:
        return False
    for i in range(get(t, at.ABOUT_AT, effect), get(t, at.ABOUT_AT, effect + 1)):
        if work[unsigned(t[at.IS_DELETED] + get(t, at.ABOUT, i))] != 0:
            return True
    return False


@kernel
def _update(t: Ints, row: Ints, work: Ints, effect: int, active: bool) -> None:
    """Update an effect: visit its nodes forward, then mark completed nodes backward.

    Args:
        active: An action has started or repeated the effect. Only such updates advance
            repetitive nodes; only passive updates, one at the end of each step, advance delays.
    """
    first, last = get(t, at.EFFECT_AT, effect), get(t, at.EFFECT_AT, effect + 1)
    node = first
    while node < last:
        place = t[at.PROGRESS] + node
        kind = get(t, at.KIND, node)
        if row[unsigned(place)] == DONE:
            node = get(t, at.END, node)
        elif kind == CONDITIONAL:
            if holds(t, row, t[at.FIRST_NODE] + node):
                row[unsigned(place)] = HOLDING
                _write(t, row, work, t[at.FIRST_NODE] + node, False)
                node += 1
            else:
                # The condition held before, so its results are taken back.
                if row[unsigned(place)] == HOLDING:
                    row[unsigned(place)] = PAUSED
                    _write(t, row, work, t[at.FIRST_NODE] + node, True)
                node = get(t, at.END, node)
        elif kind == CREATION:
            _create(t, row, work, node)
            row[unsigned(place)] = DONE
            node += 1
        elif kind == DELETION:
            _delete(t, row, work, node)
            row[unsigned(place)] = DONE
            node += 1
        # This node took effect earlier, but nested nodes have not completed: only visit these.
        elif row[unsigned(place)] >= get(t, at.TOTAL, node):
            node += 1
        # Actions advance repetitive nodes, and the passage of time advances delayed nodes.
        elif active != (kind == REPETITIVE):
            node = get(t, at.END, node)
        else:
            row[unsigned(place)] += 1
            if row[unsigned(place)] < get(t, at.TOTAL, node):
                node = get(t, at.END, node)
            else:
                _write(t, row, work, t[at.FIRST_NODE] + node, False)
                node += 1
    # Nested nodes follow the node that they are in. Backward, they are marked before it.
    node = last - 1
    while node >= first:
        if _has_completed(t, row, node):
            row[unsigned(t[at.PROGRESS] + node)] = DONE
        node -= 1


@kernel
def _has_completed(t: Ints, row: Ints, node: int) -> bool:
    """Return whether a node has taken place and all nodes nested in it have completed."""
    kind, progress = get(t, at.KIND, node), row[unsigned(t[at.PROGRESS] + node)]
    if kind == CONDITIONAL:
        if progress != HOLDING:
            return False
    elif kind in (CREATION, DELETION) or progress < get(t, at.TOTAL, node):
        return False
    child = node + 1
    while child < get(t, at.END, node):
        if row[unsigned(t[at.PROGRESS] + child)] != DONE:
            return False
        child = get(t, at.END, child)
    return True


@kernel
def _create(t: Ints, row: Ints, work: Ints, node: int) -> None:
    kind = get(t, at.CREATES, node)
    slot = row[unsigned(t[at.TOP] + kind)]
    # Rows have a fixed width, so a copy without a free slot has to stop (`overflowed`).
    if slot >= get(t, at.SLOT_AT, kind + 1) - get(t, at.SLOT_AT, kind):
        work[at.OVERFLOWED] = 1
        return
    row[unsigned(t[at.TOP] + kind)] = slot + 1
    outcome = get(t, at.OUTCOME, node) + slot
    _write(t, row, work, t[at.FIRST_OUTCOME] + outcome, False)
    _start(t, work, outcome)


@kernel
def _delete(t: Ints, row: Ints, work: Ints, node: int) -> None:
    _write(t, row, work, t[at.FIRST_NODE] + node, False)
    subject = get(t, at.SUBJECT, node)
    for i in range(get(t, at.MENTION_AT, subject), get(t, at.MENTION_AT, subject + 1)):
        word = get(t, at.MENTION_WORD, i)
        row[unsigned(word)] &= ~get(t, at.MENTIONS, i)
        work[unsigned(t[at.GONE] + word)] |= get(t, at.MENTIONS, i)
    # Atoms that the goal mentions may be among them; testing the goal is simpler than finding out.
    work[at.TOUCHED] = 1
    work[at.DELETED] += 1
    work[unsigned(t[at.IS_DELETED] + subject)] = 1
    if get(t, at.SLOT_OF, subject) != 0:
        work[at.HOLES] = 1
    _start(t, work, get(t, at.OUTCOME, node))


@kernel
def _start(t: Ints, work: Ints, outcome: int) -> None:
    """Record the effects that a creation or deletion starts, each once."""
    for i in range(get(t, at.BORN_AT, outcome), get(t, at.BORN_AT, outcome + 1)):
        count = work[at.STARTED]
        # Few effects start at once, so a linear search suffices.
        place = 0
        while place < count and work[unsigned(t[at.IS_STARTED] + place)] != get(t, at.BORN, i):
            place += 1
        if place == count and not _concerns_deleted(t, work, get(t, at.BORN, i)):
            work[unsigned(t[at.IS_STARTED] + count)] = get(t, at.BORN, i)
            work[at.STARTED] = count + 1


@kernel
def _place_of(t: Ints, row: Ints, effect: int) -> int:
    """Return an effect's position in `ORDER`, or -1 if it is not active."""
    for i in range(row[unsigned(t[at.COUNT])]):
        if row[unsigned(t[at.ORDER] + i)] == effect:
            return i
    return -1


@kernel
def _append(t: Ints, row: Ints, effect: int) -> None:
    row[unsigned(t[at.ORDER] + row[unsigned(t[at.COUNT])])] = effect
    row[unsigned(t[at.COUNT])] += 1


@kernel
def _settle(t: Ints, row: Ints, work: Ints, ends: bool) -> None:
    """Add effects that have been started, drop effects that have ended, and clear `work`.

    Args:
        ends: The step ends. Only then are completed effects dropped: an effect that completed in
            this step must not be started again by another player's action.
    """
    for i in range(work[at.STARTED]):
        if _place_of(t, row, work[unsigned(t[at.IS_STARTED] + i)]) < 0:
            _append(t, row, work[unsigned(t[at.IS_STARTED] + i)])
    # Kept effects move forward in place, which preserves the order of creation.
    count = row[unsigned(t[at.COUNT])]
    kept = 0
    for i in range(count):
        effect = row[unsigned(t[at.ORDER] + i)]
        done = ends and row[unsigned(t[at.PROGRESS] + get(t, at.EFFECT_AT, effect))] == DONE
        if done or _concerns_deleted(t, work, effect):
            # Counters of inactive effects are 0, so that equal states have equal rows.
            for node in range(get(t, at.EFFECT_AT, effect), get(t, at.EFFECT_AT, effect + 1)):
                row[unsigned(t[at.PROGRESS] + node)] = 0
        else:
            row[unsigned(t[at.ORDER] + kept)] = effect
            kept += 1
    for i in range(kept, count):
        row[unsigned(t[at.ORDER] + i)] = 0
    row[unsigned(t[at.COUNT])] = kept
    work[at.STARTED] = 0
    if work[at.DELETED] != 0:
        work[at.DELETED] = 0
        for place in range(t[at.GONE], t[at.IS_STARTED]):
            work[unsigned(place)] = 0


# Steps


@kernel
def _apply(t: Ints, row: Ints, work: Ints, player: int, number: int) -> bool:
    """Apply a player's action if it is valid now, and return whether it was."""
    action = get(t, at.ACTION_AT, player) + number
    if row[unsigned(t[at.BUSY] + player)] != 0 or not holds(t, row, action):
        return False
    _write(t, row, work, action, False)
    # An action's record continues after its writes with its duration and the effects it starts.
    duration = _writes_of(t, action)
    duration += 1 + t[unsigned(duration)]
    if t[unsigned(duration)] != 0:
        row[unsigned(t[at.BUSY] + player)] = t[unsigned(duration)]
    starts = duration + 2
    if t[unsigned(duration + 1)] != 0:
        for i in range(starts, starts + t[unsigned(duration + 1)]):
            if not _concerns_deleted(t, work, t[i]):
                if _place_of(t, row, t[i]) < 0:
                    _append(t, row, t[i])
                _update(t, row, work, t[i], True)
        _settle(t, row, work, False)
    return True


@kernel
def _tick(t: Ints, row: Ints, work: Ints) -> None:
    """Update all effects passively, and count down the steps of busy players."""
    for player in range(t[at.PLAYERS]):
        if row[unsigned(t[at.BUSY] + player)] != 0:
            row[unsigned(t[at.BUSY] + player)] -= 1
    if row[unsigned(t[at.COUNT])] != 0:
        for i in range(row[unsigned(t[at.COUNT])]):
            effect = row[unsigned(t[at.ORDER] + i)]
            if not _concerns_deleted(t, work, effect):
                _update(t, row, work, effect, False)
        _settle(t, row, work, True)


@kernel
def _move_up(t: Ints, row: Ints, work: Ints) -> None:
    """Move objects into slots that have become empty.

    The last empty slot comes first, so that the slots behind the next one are all filled. Without
    gaps, a row needs only the number of filled slots (`TOP`), and equal kitchens have equal rows.
    """
    # Vectors and masks name created objects by slot, so the order of creation has to be kept.
    for kind in range(t[at.KINDS]):
        first = get(t, at.SLOT_AT, kind)
        slot = row[unsigned(t[at.TOP] + kind)] - 1
        while slot >= 0:
            atom = get(t, at.EXISTS, first + slot)
            if row[unsigned(atom // at.WORD)] >> (atom % at.WORD) & 1 == 0:
                _shift(t, row, work, first + slot)
                row[unsigned(t[at.TOP] + kind)] -= 1
            slot -= 1


@kernel
def _shift(t: Ints, row: Ints, work: Ints, slot: int) -> None:
    """Move all values about objects behind a slot up by one."""
    before = t[at.ROW_COPY]
    for place in range(t[at.WIDTH]):
        work[unsigned(before + place)] = row[unsigned(place)]
        if place < t[at.WORDS] or place >= t[at.PROGRESS]:
            row[unsigned(place)] = 0
    for atom in range(t[at.ATOMS]):
        source = get(t, at.ATOM_FROM, slot * t[at.ATOMS] + atom)
        if source >= 0:
            true = work[unsigned(before + source // at.WORD)] >> (source % at.WORD) & 1
            row[unsigned(atom // at.WORD)] |= true << (atom % at.WORD)
    for effect in range(t[at.EFFECTS]):
        source = get(t, at.EFFECT_FROM, slot * t[at.EFFECTS] + effect)
        if source >= 0:
            first = t[at.PROGRESS] + get(t, at.EFFECT_AT, effect)
            came = before + t[at.PROGRESS] + get(t, at.EFFECT_AT, source)
            for i in range(get(t, at.EFFECT_AT, effect + 1) - get(t, at.EFFECT_AT, effect)):
                row[unsigned(first + i)] = work[unsigned(came + i)]
            for place in range(t[at.ORDER], t[at.ORDER] + row[unsigned(t[at.COUNT])]):
                if work[unsigned(before + place)] == source:
                    row[unsigned(place)] = effect


@kernel
def step_row(
    t: Ints,
    row: Ints,
    work: Ints,
    actions: npt.NDArray[np.int64],
    applied: npt.NDArray[np.bool_],
    copy: int,
) -> bool:
    """Take one step in a row and return whether the goal holds.

    The players' actions are applied in the order of their seats. `work[OVERFLOWED]` is not 0 if a
    slot was missing; the row is then meaningless.
    """
    for i in range(at.TOUCHED + 1):
        work[i] = 0
    for player in range(t[at.PLAYERS]):
        number = actions[copy, player]
        applied[copy, player] = number >= 0 and _apply(t, row, work, player, number)
    _tick(t, row, work)
    if work[at.HOLES] != 0 and t[at.SHIFTS] != 0:
        _move_up(t, row, work)
    # The search for the goal is the slowest part of a step. Most steps change no atom that the
    # goal mentions, so the row remembers that the goal does not hold.
    if work[at.TOUCHED] != 0 or row[unsigned(t[at.GOAL])] != 0:
        row[unsigned(t[at.GOAL])] = goal_reached(t, row, work)
    reached: bool = row[unsigned(t[at.GOAL])] != 0 and work[at.OVERFLOWED] == 0
    return reached


@kernel
def step_copies(
    block: CopyRange,
    initial: Ints,
    actions: npt.NDArray[np.int64],
    terminated: npt.NDArray[np.bool_],
    applied: npt.NDArray[np.bool_],
    overflowed: npt.NDArray[np.bool_],
    auto_reset: bool,
) -> None:
    """Take one step in each copy; copies that have overflowed stand still."""
    t, rows, row, work = block.tables, block.rows, block.row, block.work
    for copy in range(block.first, block.last):
        if overflowed[copy]:
            continue
        # Copying a row to `row` and back costs less than making a view of it.
        for i in range(t[at.WIDTH]):
            row[i] = rows[copy, i]
        terminated[copy] = step_row(t, row, work, actions, applied, copy)
        overflowed[copy] = work[at.OVERFLOWED] != 0
        if auto_reset and (terminated[copy] or overflowed[copy]):
            for i in range(t[at.WIDTH]):
                row[i] = initial[i]
        for i in range(t[at.WIDTH]):
            rows[copy, i] = row[i]


@kernel
def first_invalid(t: Ints, actions: npt.NDArray[np.int64]) -> int:
    """Return the position of the first number that is not an action's, or -1."""
    players: int = t[at.PLAYERS]
    for copy in range(len(actions)):
        for player in range(players):
            count = get(t, at.ACTION_AT, player + 1) - get(t, at.ACTION_AT, player)
            if not -1 <= actions[copy, player] < count:
                return copy * players + player
    return -1
