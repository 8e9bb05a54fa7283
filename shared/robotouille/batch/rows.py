"""States as rows of integers, and back; what is in a row is told in `tables`."""

from __future__ import annotations

import numpy as np

from robotouille.batch import layout as at
from robotouille.batch.rules import Rules
from robotouille.batch.tables import Ints, in_words
from robotouille.errors import WrongWorldError
from robotouille.world.grounding.atoms import EXISTS, USED, bits_of
from robotouille.world.world import State

__all__ = ["row_of", "state_of"]


def row_of(state: State, rules: Rules, t: Ints) -> Ints:
    """A state as a row.

    Raises:
        SlotOverflowError: It has more created objects than there are slots.
        WrongWorldError: It is one of another task.
    """
    if state.world.task.digest != rules.world.task.digest:
        raise WrongWorldError(f"the state is one of another task, {state.world.task.name}")
    if state.world is not rules.world:
        state = rules.world.restore(state.facts, state.timer_rows(), state.timers.busy)
    encoding = rules.encoding
    vector = encoding.vector(state.facts, state.timers)
    row = np.zeros(t[at.WIDTH], dtype=np.int64)
    for word, mask in in_words(np.flatnonzero(vector[: t[at.ATOMS]]).tolist()).items():
        row[word] = mask
    for place, atoms in enumerate(rules.exists):
        row[t[at.TOP] + place] = np.count_nonzero(vector[list(atoms)])
    for place, player in enumerate(rules.players):
        row[t[at.BUSY] + place] = state.busy_steps(player)
    row[t[at.GOAL]] = 1
    names = encoding.slots.filled(state.facts)
    slots = {name: slot for slot, name in names.items() if name}
    row[t[at.COUNT]] = len(state.timer_rows())
    for i, (action, index, arguments, counters) in enumerate(state.timer_rows()):
        label = (action, index, tuple(slots.get(name, name) for name in arguments))
        effect = rules.effect_number(label)
        row[t[at.ORDER] + i] = effect
        first = t[at.PROGRESS] + rules.effects[effect].first
        row[first : first + len(counters)] = counters
    return row


def state_of(row: Ints, rules: Rules, t: Ints) -> State:
    """The state of a row. Created objects are called by their slots."""
    world, encoding = rules.world, rules.encoding
    table = world.table
    facts = world.initial_facts & table.mask((USED, thing.name) for thing in world.placed)
    for word in range(t[at.WORDS]):
        for bit in bits_of(int(row[word])):
            name, *arguments = encoding.atoms[word * at.WORD + bit]
            facts |= table.bit[name, *arguments]
            if name == EXISTS:
                facts |= table.mask([(USED, *arguments)])
    timers = []
    for effect in row[t[at.ORDER] : t[at.ORDER] + row[t[at.COUNT]]].tolist():
        rule = rules.effects[effect]
        counters = row[t[at.PROGRESS] + rule.first : t[at.PROGRESS] + rule.end].tolist()
        timers.append((*encoding.effects[effect].label, tuple(counters)))
    steps = row[t[at.BUSY] : t[at.BUSY] + t[at.PLAYERS]].tolist()
    busy = sorted((name, n) for name, n in zip(rules.players, steps, strict=True) if n)
    return world.restore(facts, timers, busy)
