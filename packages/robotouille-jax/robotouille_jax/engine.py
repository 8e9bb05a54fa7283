"""Steps of one copy as pure JAX functions: `World.step` without branches.

JAX traces both sides of a branch, so everything is computed and takes effect only if `when` is
true. Effects are updated as in `robotouille.batch.step_kernels`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from robotouille.batch.rules import CONDITIONAL, CREATION, DELETION, REPETITIVE, CompiledRules
from robotouille_jax.goal_progress import progress_of
from robotouille_jax.goal_search import goal_reached
from robotouille_jax.padded import Array, Padded, Tests, Writes, padded
from robotouille_jax.shift import CopyOrders, JaxShift

HOLDING, DONE = 1, -1


class CopyState(NamedTuple):
    """State of a copy.

    Attributes:
        atoms: Truth of each atom.
        progress: Counter of each node.
        rank: Position of each effect in the order of creation, from 1; 0 if it is not active.
        top: Number of filled slots of each kind.
        busy: Steps for which each player is busy.
        overflowed: True if a slot was missing.
        orders: The orders of a shift; None in other tasks.
    """

    atoms: Array
    progress: Array
    rank: Array
    top: Array
    busy: Array
    overflowed: Array
    orders: CopyOrders | None = None


class CopyStep(NamedTuple):
    """Result of a step; see `BatchStep`."""

    rewards: Array
    terminated: Array
    applied: Array
    overflowed: Array


class _Run(NamedTuple):
    """Temporary values of a run of effect updates.

    Attributes:
        gone: Atoms about deleted objects.
        deleted: Deleted objects.
        started: Position of each effect in the order in which the run started them, from 1.
        count: Number of started effects.
    """

    gone: Array
    deleted: Array
    started: Array
    count: Array


class JaxEngine:
    """A world's rules as pure functions of one copy's state, for `jax.vmap` and `jax.jit`.

    Attributes:
        initial: The initial state.
    """

    def __init__(self, rules: CompiledRules) -> None:
        self._t = t = padded(rules)
        self.players = len(rules.players)
        self._offsets = [sum(map(len, rules.actions[:i])) for i in range(self.players + 1)]
        self._longest = max((e.end - e.first for e in rules.effects), default=0)
        self._mask_tables = [mask_table(t, *each) for each in pairwise(self._offsets)]
        kinds = {node.kind for node in rules.nodes}
        self._creates, self._deletes = CREATION in kinds, DELETION in kinds
        world = rules.world
        self._shift = None if world.shift is None else JaxShift(rules, world.shift, t.mentions)
        self._rules = rules
        self._any_born = any(o.born for node in rules.nodes for o in node.outcomes)
        self.initial = CopyState(
            atoms=t.initial,
            progress=jnp.zeros(len(rules.nodes), jnp.int32),
            rank=jnp.zeros(len(rules.effects), jnp.int32),
            top=jnp.zeros(len(rules.kinds), jnp.int32),
            busy=jnp.zeros(self.players, jnp.int32),
            overflowed=jnp.zeros((), bool),
            orders=None if self._shift is None else self._shift.initial,
        )

    @cached_property
    def _progress(self) -> Callable[[Array], Array]:
        # Large goals take a while, and only shaped rewards need this.
        return progress_of(self._rules.goal, len(self._rules.encoding.atoms))

    def step(self, state: CopyState, actions: Array) -> tuple[CopyState, CopyStep]:
        """Apply the players' actions in the order of their seats, then let time pass.

        -1 stands for no action.
        """
        before, applied = state, []
        for seat in range(self.players):
            state, done = self._apply(state, seat, actions[seat])
            applied.append(done)
        state = self._move_up(self._tick(state))
        if self._shift is not None and state.orders is not None:
            state = self._with_orders(state, self._shift, state.orders)
        # JAX has computed a step for overflowed copies, too; discard it.
        still = before.overflowed
        state = jax.tree.map(lambda new, old: jnp.where(still, old, new), state, before)
        reward, ends = self._result(before, state)
        return state, CopyStep(reward, ends, jnp.stack(applied) & ~still, state.overflowed)

    def _result(self, before: CopyState, state: CopyState) -> tuple[Array, Array]:
        """Return the reward of a step, and whether it ends the episode."""
        if self._shift is None or before.orders is None or state.orders is None:
            reached = goal_reached(self._t.goal, state.atoms) & ~state.overflowed
            return reached.astype(jnp.float32), reached
        points = (state.orders.score - before.orders.score).astype(jnp.float32)
        return points, state.orders.time >= self._shift.steps

    def _with_orders(self, state: CopyState, shift: JaxShift, orders: CopyOrders) -> CopyState:
        """Serve dishes, let orders expire and arrive; forget the effects of returned things."""
        atoms, gone, orders = shift.advance(state.atoms, orders)
        state = state._replace(atoms=atoms, orders=orders)
        return self._without(state, state.rank, jnp.any(self._t.about & gone, axis=1))

    def mask(self, state: CopyState, seat: int) -> Array:
        """Return which actions of a seat are valid."""
        # A product with a matrix tests all actions at once, much faster than reading each atom.
        weights, needed = self._mask_tables[seat]
        valid = state.atoms.astype(jnp.float32) @ weights >= needed
        return valid & (state.busy[seat] == 0)

    def vector(self, state: CopyState) -> Array:
        """Return the state as a vector."""
        effects = jnp.concatenate([state.rank > 0, state.progress])[self._t.vector_from]
        parts = [state.atoms, effects, state.busy]
        if self._shift is not None and state.orders is not None:
            parts.append(self._shift.vector(state.orders))
        return jnp.concatenate([part.astype(jnp.float32) for part in parts])

    def potential(self, state: CopyState) -> Array:
        """Return minus the share of goal conditions that do not hold, for shaped rewards.

        The variables of the goal stand for the objects for which most conditions hold; see
        `goal_progress`. The potential is 0 in states with the goal.
        """
        if self._shift is not None and state.orders is not None:
            return self._shift.potential(state.atoms, state.orders)
        return self._progress(state.atoms)

    # Actions

    def _apply(self, state: CopyState, seat: int, number: Array) -> tuple[CopyState, Array]:
        t, action = self._t, self._offsets[seat] + number
        tests = Tests(*(x[action] for x in t.actions))
        when = (number >= 0) & (state.busy[seat] == 0) & _hold(tests, state.atoms)
        run = self._run()
        state = _write(state, run, Writes(*(x[action] for x in t.action_writes)), when)
        steps = t.duration[action]
        busy = jnp.where(when & (steps > 0), steps, state.busy[seat])
        state = state._replace(busy=state.busy.at[seat].set(busy))
        if not len(t.first):
            return state, when
        for i in range(t.starts.shape[1]):
            effect = t.starts[action, i]
            begins = when & (effect >= 0) & ~self._concerns_deleted(run, effect)
            rank = jnp.where(begins & (state.rank[effect] == 0), _last(state) + 1, 0)
            state = state._replace(rank=state.rank.at[effect].add(rank))
            state, run = self._update(state, run, effect, True, begins)
        return self._settle(state, run, ends=False), when

    def _tick(self, state: CopyState) -> CopyState:
        state = state._replace(busy=jnp.maximum(state.busy - 1, 0))
        effects = len(self._t.first)
        if not effects:
            return state
        # Effects are updated in the order of their creation. Their ranks have no gaps, so no sort
        # is needed, which would take long to compile.
        places = jnp.where(state.rank > 0, state.rank - 1, effects)
        order = jnp.zeros(effects, jnp.int32).at[places].set(jnp.arange(effects), mode="drop")
        count = _last(state)

        def update(i: Array, both: tuple[CopyState, _Run]) -> tuple[CopyState, _Run]:
            state, run = both
            when = (i < count) & ~self._concerns_deleted(run, order[i])
            return self._update(state, run, order[i], False, when)

        state, run = jax.lax.fori_loop(0, effects, update, (state, self._run()))
        return self._settle(state, run, ends=True)

    # Effects

    def _run(self) -> _Run:
        t = self._t
        return _Run(
            jnp.zeros(len(t.initial), bool),
            jnp.zeros(len(t.mentions), bool),
            jnp.zeros(len(t.first), jnp.int32),
            jnp.zeros((), jnp.int32),
        )

    def _concerns_deleted(self, run: _Run, effect: Array) -> Array:
        if not self._deletes:
            return jnp.zeros((), bool)
        return jnp.any(self._t.about[effect] & run.deleted)

    def _update(
        self, state: CopyState, run: _Run, effect: Array, active: bool, when: Array
    ) -> tuple[CopyState, _Run]:
        """Update an effect: visit its nodes forward, then mark completed nodes backward."""
        first, size = self._t.first[effect], self._t.size[effect]
        upto = first
        for i in range(self._longest):
            node = first + i
            state, run, upto = self._visit(
                state, run, node, active, when & (i < size) & (node >= upto), upto
            )
        for i in reversed(range(self._longest)):
            state = self._complete(state, first + i, when & (i < size))
        return state, run

    def _visit(
        self, state: CopyState, run: _Run, node: Array, active: bool, when: Array, upto: Array
    ) -> tuple[CopyState, _Run, Array]:
        """Update a node; also return the next node to visit, which skips paused nested nodes."""
        t = self._t
        kind, total, progress = t.kind[node], t.total[node], state.progress[node]
        end = t.end[node]
        live = when & (progress != DONE)
        conditional, creation, deletion = (kind == k for k in (CONDITIONAL, CREATION, DELETION))
        timed = live & ~(conditional | creation | deletion)
        holds = live & conditional & _hold(Tests(*(x[node] for x in t.nodes)), state.atoms)
        stops = live & conditional & ~holds & (progress == HOLDING)
        counts = timed & (progress < total) & ((kind == REPETITIVE) == active)
        past = timed & (progress >= total)
        takes_place = counts & (progress + 1 >= total)
        new = jnp.where(holds, HOLDING, jnp.where(stops, 0, progress + counts))
        new = jnp.where(live & (creation | deletion), DONE, new)
        state = state._replace(progress=_put(state.progress, node, new, when))
        sets, clears = t.node_writes.sets[node], t.node_writes.clears[node]
        writes = Writes(jnp.where(stops, clears, sets), jnp.where(stops, sets, clears))
        writing = holds | stops | takes_place | (live & deletion)
        state = _write(state, run, writes, writing)
        if self._creates:
            state, run = self._create(state, run, node, live & creation)
        if self._deletes:
            state, run = self._delete(state, run, node, live & deletion)
        inside = holds | takes_place | past | (live & (creation | deletion))
        return state, run, jnp.where(when, jnp.where(inside, node + 1, end), upto)

    def _complete(self, state: CopyState, node: Array, when: Array) -> CopyState:
        t = self._t
        kind, progress = t.kind[node], state.progress[node]
        timed = (kind != CONDITIONAL) & (kind != CREATION) & (kind != DELETION)
        past = ((kind == CONDITIONAL) & (progress == HOLDING)) | (
            timed & (progress >= t.total[node])
        )
        children = t.children[node]
        done = jnp.all((children < 0) | (state.progress[children] == DONE))
        return state._replace(progress=_put(state.progress, node, DONE, when & past & done))

    def _create(
        self, state: CopyState, run: _Run, node: Array, when: Array
    ) -> tuple[CopyState, _Run]:
        t, kind = self._t, self._t.creates[node]
        slot = state.top[kind]
        full = slot >= t.slots[kind]
        outcome = t.outcome[node] + slot
        writes = Writes(*(x[outcome] for x in t.outcome_writes))
        state = _write(state, run, writes, when & ~full)
        state = state._replace(
            top=_put(state.top, kind, slot + 1, when & ~full),
            overflowed=state.overflowed | (when & full),
        )
        return state, self._start(run, outcome, when & ~full)

    def _delete(
        self, state: CopyState, run: _Run, node: Array, when: Array
    ) -> tuple[CopyState, _Run]:
        t, subject = self._t, self._t.subject[node]
        gone = t.mentions[subject] & when
        state = state._replace(atoms=state.atoms & ~gone)
        run = run._replace(
            gone=run.gone | gone, deleted=_put(run.deleted, subject, True, when)
        )  # fmt: skip
        return state, self._start(run, t.outcome[node], when)

    def _start(self, run: _Run, outcome: Array, when: Array) -> _Run:
        """Record the effects that a creation or deletion starts, each once."""
        if not self._any_born:
            return run
        for i in range(self._t.born.shape[1]):
            effect = self._t.born[outcome, i]
            new = when & (effect >= 0) & (run.started[effect] == 0)
            new &= ~self._concerns_deleted(run, effect)
            count = run.count + new
            run = run._replace(started=_put(run.started, effect, count, new), count=count)
        return run

    def _settle(self, state: CopyState, run: _Run, ends: bool) -> CopyState:
        """Add effects that have been started and drop effects that have ended."""
        t = self._t
        added = (run.started > 0) & (state.rank == 0)
        rank = jnp.where(added, _last(state) + run.started, state.rank)
        dropped = (rank > 0) & jnp.any(t.about & run.deleted, axis=1)
        if ends:
            dropped |= (rank > 0) & (state.progress[t.first] == DONE)
        return self._without(state, rank, dropped)

    def _without(self, state: CopyState, rank: Array, dropped: Array) -> CopyState:
        """Drop effects."""
        t = self._t
        dropped &= rank > 0
        rank = jnp.where(dropped, 0, rank)
        progress = jnp.where(dropped[t.effect_of], 0, state.progress)
        # Dropped effects leave gaps: number the others from 1 again.
        before = (rank > 0) & (rank[None, :] <= rank[:, None])
        return state._replace(
            rank=jnp.where(rank > 0, before.sum(1, dtype=jnp.int32), 0), progress=progress
        )

    def _move_up(self, state: CopyState) -> CopyState:
        """Move objects into slots that have become empty, the last empty slot first."""
        t = self._t
        if not len(t.shift_kind):
            return state

        def move(i: Array, state: CopyState) -> CopyState:
            kind = t.shift_kind[i]
            empty = (t.shift_slot[i] < state.top[kind]) & ~state.atoms[t.shift_exists[i]]

            def moved(values: Array, sources: Array) -> Array:
                return jnp.where(empty, jnp.where(sources < 0, 0, values[sources]), values).astype(
                    values.dtype
                )

            return state._replace(
                atoms=moved(state.atoms, t.atom_from[i]),
                progress=moved(state.progress, t.node_from[i]),
                rank=moved(state.rank, t.effect_from[i]),
                top=_put(state.top, kind, state.top[kind] - 1, empty),
            )

        moved_up: CopyState = jax.lax.fori_loop(0, len(t.shift_kind), move, state)
        return moved_up


def mask_table(t: Padded, first: int, last: int) -> tuple[Array, Array]:
    """Return a column of weights for each action of a seat, and the sums that valid actions reach.

    A required atom adds 1. A forbidden atom subtracts more than all required ones can add. All
    numbers are small integers, so sums are exact in the reduced precision of GPUs, too.
    """
    tests = Tests(*(np.asarray(x[first:last]) for x in t.actions))
    atoms = len(t.initial)
    needed = (tests.required < atoms).sum(1)
    weights = np.zeros((atoms + 1, last - first), np.float32)
    column = np.arange(last - first)[:, None]
    weights[tests.required, column] = 1
    weights[tests.forbidden, column] = -1 - needed.max(initial=0)
    never = np.where(tests.possible, needed, atoms + 1)
    return jnp.asarray(weights[:-1]), jnp.asarray(never, jnp.float32)


def _hold(tests: Tests, atoms: Array) -> Array:
    """Return whether all tests of a rule, or of each rule, hold."""
    required = atoms.at[tests.required].get(mode="fill", fill_value=True)
    forbidden = atoms.at[tests.forbidden].get(mode="fill", fill_value=False)
    return tests.possible & jnp.all(required, axis=-1) & ~jnp.any(forbidden, axis=-1)


def _write(state: CopyState, run: _Run, writes: Writes, when: Array) -> CopyState:
    """Make atoms false, then true, except atoms about objects that this run has deleted."""
    # JAX drops writes out of bounds: if nothing is to be written, all indices are.
    none = len(state.atoms)
    gone = run.gone.at[writes.sets].get(mode="fill", fill_value=True)
    atoms = state.atoms.at[jnp.where(when, writes.clears, none)].set(False, mode="drop")
    atoms = atoms.at[jnp.where(when & ~gone, writes.sets, none)].set(True, mode="drop")
    return state._replace(atoms=atoms)


def _put(values: Array, place: Array, value: Array | int | bool, when: Array) -> Array:
    """Return the values with one of them replaced if `when` is true."""
    return values.at[jnp.where(when, place, len(values))].set(value, mode="drop")


def _last(state: CopyState) -> Array:
    return jnp.max(state.rank, initial=0)
