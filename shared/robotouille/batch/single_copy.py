"""One copy of a world in the batch engine, and the conversion between states and rows."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.rules import CompiledRules, refuse_shift
from robotouille.batch.state_kernels import observe_row
from robotouille.batch.step_kernels import step_row
from robotouille.batch.tables import Ints, in_words, initial_row, tables
from robotouille.errors import WrongWorldError
from robotouille.world.grounding.atoms import EXISTS, USED, bits_of
from robotouille.world.world import State, World


def row_of(state: State, rules: CompiledRules, t: Ints) -> Ints:
    """Return a state as a row.

    Raises:
        SlotOverflowError: The state has more created objects than there are slots.
        WrongWorldError: The state belongs to another task.
    """
    if state.world.task.digest != rules.world.task.digest:
        raise WrongWorldError(f"the state belongs to another task, {state.world.task.name}")
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
    row[t[at.GOAL]] = 1  # not known: the next step tests the goal
    # Rows know created objects only by their slots, so names in timers change, too.
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


def state_of(row: Ints, rules: CompiledRules, t: Ints) -> State:
    """Return a row as a state, with created objects named after their slots."""
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


class _Scratch(threading.local):
    """Arrays on which kernels write. Each thread has its own because kernels release the GIL."""

    def __init__(self, work: int, found: int) -> None:
        self.work, self.found = np.zeros(work, dtype=np.int64), np.zeros(found, dtype=np.int64)


class RuleTables:
    """A world's rules in the form that kernels read.

    Compiling them takes up to a second, so all copies of a world should share one.
    """

    def __init__(self, world: World) -> None:
        refuse_shift(world)
        self.rules = CompiledRules(world)
        self.numbers = tables(self.rules)
        self.initial = initial_row(self.rules, self.numbers)
        most = max(len(actions) for actions in self.rules.actions)
        self.scratch = _Scratch(int(self.numbers[at.WORK_SIZE]), most + 1)


class SingleCopy:
    """One copy of a world for callers that play one episode at a time.

    It does what a `BatchWorld` with one copy does. Its kernels take arrays instead of a
    `CopyRange`, because passing a tuple from Python takes longer (0.8 µs) than a step does.

    Args:
        rule_tables: Rules of the world.
        starts: Index at which each player's mask begins in an array of all masks.

    Attributes:
        row: The state, at first the initial one. It changes in place; copy it to keep it.
    """

    def __init__(self, rule_tables: RuleTables, starts: Sequence[int]) -> None:
        self._shared = rule_tables
        self.row = rule_tables.initial.copy()
        self._starts = np.array(starts, dtype=np.int64)
        self._actions = np.zeros((1, len(starts)), dtype=np.int64)
        self._applied = np.zeros((1, len(starts)), dtype=np.bool_)

    def set_state(self, state: State) -> None:
        """Go to a state.

        Raises:
            SlotOverflowError: The state has more created objects than there are slots.
        """
        self.row[:] = row_of(state, self._shared.rules, self._shared.numbers)

    def step(self, numbers: Sequence[int]) -> tuple[tuple[bool, ...], bool, bool]:
        """Take a joint action.

        Args:
            numbers: Number of each player's action, or -1 for no action. They are not checked.

        Returns:
            Booleans for each player's action (applied or not), for the goal (reached or not), and
            for the slots (one was missing or not). If a slot was missing, call `set_state` before
            the next step.
        """
        for player, number in enumerate(numbers):
            self._actions[0, player] = number
        work = self._shared.scratch.work
        reached = step_row(self._shared.numbers, self.row, work, self._actions, self._applied, 0)
        return tuple(self._applied[0].tolist()), bool(reached), bool(work[at.OVERFLOWED])

    def observe(self, vector: npt.NDArray[np.float32], masks: npt.NDArray[np.int8]) -> None:
        """Write the state's vector and the masks of all players into arrays of zeros.

        See `State.vector` and `State.mask`.
        """
        shared, scratch = self._shared, self._shared.scratch
        observe_row(
            shared.numbers,
            self.row,
            scratch.work,
            scratch.found,
            vector[None],
            masks[None],
            self._starts,
        )
