"""Many copies of one world at once in JAX, on a GPU if JAX finds one (docs/train.md)."""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt

from robotouille.batch import layout as at
from robotouille.batch.rules import CompiledRules
from robotouille.batch.single_copy import row_of, state_of
from robotouille.batch.tables import Ints, tables
from robotouille.errors import UnknownNameError, WrongArgumentError
from robotouille.world.shift import Orders
from robotouille.world.world import State, World
from robotouille_jax.engine import CopyState, CopyStep, JaxEngine
from robotouille_jax.padded import Array
from robotouille_jax.shift import CopyOrders


class JaxBatch:
    """Copies of a world in JAX, with the methods of `BatchWorld` on JAX arrays.

    Args:
        world: The world to copy.
        copies: Number of copies.
        seed: Seed of `random_actions`.
        auto_reset: Reset a copy that reaches its goal or overflows in the same step.
        slots: Number of created objects of each kind that can exist at once; see `BatchWorld`.

    Attributes:
        states: The states; each array has one row for each copy.
        engine: The step of one copy as a pure function, for training loops in one `jax.jit`.

    Raises:
        WrongArgumentError: `copies` is less than 1.
    """

    def __init__(
        self,
        world: World,
        copies: int,
        *,
        seed: int = 0,
        auto_reset: bool = False,
        slots: Mapping[str, int] | None = None,
    ) -> None:
        if copies < 1:
            raise WrongArgumentError(f"expected at least 1 copy, found {copies}")
        self.world = world
        self.copies = copies
        self.players = world.players
        self._rules = CompiledRules(world, slots)
        self._tables = tables(self._rules)
        self.action_counts = tuple(len(actions) for actions in self._rules.actions)
        self.encoding = self._rules.encoding
        self.vector_size = self.encoding.size
        self.engine = JaxEngine(self._rules)
        self._key = jax.random.key(seed)
        self._initial = jax.tree.map(
            lambda array: jnp.repeat(array[None], copies, axis=0), self.engine.initial
        )
        self.states: CopyState = self._initial
        self._step = jax.jit(self._resetting if auto_reset else jax.vmap(self.engine.step))
        self._mask = jax.jit(jax.vmap(self.engine.mask, in_axes=(0, None)), static_argnums=1)
        self._vector = jax.jit(jax.vmap(self.engine.vector))
        self._draw = jax.jit(self._drawn)

    @property
    def overflowed(self) -> npt.NDArray[np.bool_]:
        """Copies that needed more slots for created objects than there are; they stand still."""
        return np.asarray(self.states.overflowed)

    def reset(self, mask: npt.ArrayLike | None = None) -> None:
        """Put all copies, or those for which `mask` is true, into the initial state.

        Raises:
            WrongArgumentError: The mask does not have one boolean for each copy.
        """
        chosen = jnp.ones(self.copies, bool) if mask is None else jnp.asarray(mask)
        if chosen.shape != (self.copies,) or chosen.dtype != bool:
            raise WrongArgumentError(
                f"expected {self.copies} booleans, found {chosen.dtype} {chosen.shape}"
            )
        self.states = _chosen(chosen, self._initial, self.states)

    def step(self, actions: npt.ArrayLike) -> CopyStep:
        """Take a joint action in each copy; see `BatchWorld.step`.

        Numbers in a JAX array are not checked, because reading them would wait for the GPU. An
        invalid number in one has an unspecified effect.

        Raises:
            WrongArgumentError: There is not one integer for each copy and player.
        """
        result: CopyStep
        self.states, result = self._step(self.states, self._actions(actions))
        return result

    def _actions(self, actions: npt.ArrayLike) -> Array:
        known = actions if isinstance(actions, jax.Array) else np.asarray(actions)
        shape = (self.copies, len(self.players))
        if known.size != shape[0] * shape[1] or not jnp.issubdtype(known.dtype, jnp.integer):
            raise WrongArgumentError(
                f"expected integers of shape {shape}, found {known.dtype} {known.shape}"
            )
        chosen = known.reshape(shape)
        if isinstance(chosen, np.ndarray) and np.any(
            (chosen < -1) | (chosen >= np.array(self.action_counts))
        ):
            raise WrongArgumentError(f"players have {self.action_counts} actions")
        return jnp.asarray(chosen)

    def masks(self, player: str) -> Array:
        """Return for each copy which of a player's actions are valid.

        Raises:
            UnknownNameError: The task has no such player.
        """
        if player not in self.players:
            raise UnknownNameError.player(player, self.players)
        return self._mask(self.states, self.players.index(player))

    def joint_masks(self) -> Array:
        """Return the masks of all players side by side."""
        return jnp.concatenate([self.masks(player) for player in self.players], axis=1)

    def valid(self, actions: npt.ArrayLike) -> Array:
        """Return which of these actions are valid now; see `BatchWorld.valid`.

        Raises:
            WrongArgumentError: There is not one integer for each copy and player.
        """
        chosen = self._actions(actions)
        starts = np.cumsum([0, *self.action_counts[:-1]])
        places = starts + jnp.maximum(chosen, 0)
        return jnp.take_along_axis(self.joint_masks(), places, axis=1) & (chosen >= 0)

    def vectors(self) -> Array:
        """Return the states as vectors."""
        return self._vector(self.states)

    def random_actions(self) -> Array:
        """Draw a valid action for each copy and player uniformly; -1 if no action is valid."""
        self._key, key = jax.random.split(self._key)
        return self._draw(self.states, key)

    def play_random(self, states: CopyState, key: Array, steps: int) -> tuple[CopyState, Array]:
        """Take random valid steps from states, as a pure function.

        Returns:
            The last states, and the sum of all rewards and numbers of the vectors on the way, so
            that the compiler cannot leave any of them out.
        """

        def one(states: CopyState, key: Array) -> tuple[CopyState, Array]:
            states, result = self._resetting(states, self._drawn(states, key))
            return states, result.rewards.sum() + jax.vmap(self.engine.vector)(states).sum()

        states, sums = jax.lax.scan(one, states, jax.random.split(key, steps))
        return states, sums.sum()

    def state(self, copy: int) -> State:
        """Return the state of a copy as a state of the world; see `BatchWorld.state`.

        Raises:
            WrongArgumentError: The copy has overflowed.
        """
        if self.states.overflowed[copy]:
            raise WrongArgumentError(f"copy {copy} has overflowed; call reset")
        state = state_of(self._row(copy), self._rules, self._tables)
        orders = self.states.orders
        if orders is None:
            return state
        one = jax.tree.map(lambda array: np.asarray(array[copy]), orders)
        opened = [list(map(int, each)) for each in zip(one.number, one.due, strict=True)]
        row = [int(one.time), [each for each in opened if each[0] >= 0], *map(int, one[3:])]
        return self.world.restore(state.facts, state.timer_rows(), state.timers.busy, row)

    def set_state(self, copy: int, state: State) -> None:
        """Put a copy into a state.

        Raises:
            SlotOverflowError: The state has more created objects than there are slots.
            WrongWorldError: The state belongs to another task.
        """
        new = self._from_row(row_of(state, self._rules, self._tables))
        if state.orders is not None and self.world.shift is not None:
            new = new._replace(orders=_orders(state.orders, self.world.shift.most_open))
        self.states = jax.tree.map(lambda all_, one: all_.at[copy].set(one), self.states, new)

    def _resetting(self, states: CopyState, actions: Array) -> tuple[CopyState, CopyStep]:
        states, result = jax.vmap(self.engine.step)(states, actions)
        return _chosen(result.terminated | result.overflowed, self._initial, states), result

    def _drawn(self, states: CopyState, key: Array) -> Array:
        actions = []
        for seat in range(len(self.players)):
            key, draw = jax.random.split(key)
            masks = jax.vmap(self.engine.mask, in_axes=(0, None))(states, seat)
            # One number for each copy: a number for each action takes far longer than a step.
            at_most = jax.lax.associative_scan(jnp.add, masks.astype(jnp.int32), axis=1)
            count = at_most[:, -1]
            rank = jnp.floor(jax.random.uniform(draw, (self.copies,)) * count)
            drawn = jnp.sum(at_most <= rank[:, None], axis=1)
            actions.append(jnp.where(count > 0, drawn, -1))
        return jnp.stack(actions, axis=1)

    def _row(self, copy: int) -> Ints:
        t, one = self._tables, jax.tree.map(lambda array: np.asarray(array[copy]), self.states)
        row = np.zeros(t[at.WIDTH], dtype=np.int64)
        atoms = np.flatnonzero(one.atoms)
        np.bitwise_or.at(row, atoms // at.WORD, np.int64(1) << (atoms % at.WORD))
        active = np.flatnonzero(one.rank)
        row[t[at.COUNT]] = len(active)
        row[t[at.ORDER] + one.rank[active] - 1] = active
        row[t[at.TOP] : t[at.BUSY]] = one.top
        row[t[at.BUSY] : t[at.GOAL]] = one.busy
        row[t[at.GOAL]] = 1  # not known: the next step tests the goal
        row[t[at.PROGRESS] :] = one.progress
        return row

    def _from_row(self, row: Ints) -> CopyState:
        t = self._tables
        atoms = np.arange(t[at.ATOMS])
        rank = np.zeros(t[at.EFFECTS], dtype=np.int32)
        count = row[t[at.COUNT]]
        rank[row[t[at.ORDER] : t[at.ORDER] + count]] = np.arange(1, count + 1)
        return CopyState(
            atoms=row[atoms // at.WORD] >> (atoms % at.WORD) & 1 == 1,
            progress=row[t[at.PROGRESS] :].astype(np.int32),
            rank=rank,
            top=row[t[at.TOP] : t[at.BUSY]].astype(np.int32),
            busy=row[t[at.BUSY] : t[at.GOAL]].astype(np.int32),
            overflowed=np.zeros((), bool),
        )


def _orders(orders: Orders, most: int) -> CopyOrders:
    """Return orders as numbers, with room for the largest number of open ones."""
    opened = [*orders.open, *[(-1, 0)] * (most - len(orders.open))]
    number, due = np.array(opened, np.int32).T
    return CopyOrders(np.int32(orders.time), number, due, *map(np.int32, orders[2:]))


def _chosen(chosen: Array, new: CopyState, old: CopyState) -> CopyState:
    """Return the new state of each chosen copy and the old state of the others."""

    def one(first: Array, second: Array) -> Array:
        return jnp.where(chosen.reshape(-1, *[1] * (first.ndim - 1)), first, second)

    states: CopyState = jax.tree.map(one, new, old)
    return states
