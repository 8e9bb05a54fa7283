"""Copies of a task as an environment for a team: shaped rewards, episodes that end and start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from robotouille.world.world import State, World
from robotouille_jax.engine import CopyState
from robotouille_jax.jax_batch import JaxBatch
from robotouille_jax.learning.views import views
from robotouille_jax.padded import Array


class Copies(NamedTuple):
    """States of all copies, with the steps and the sparse return of the running episodes.

    Attributes:
        origin: Number of the state in which the episode started; -1 if its curve would mislead.
    """

    states: CopyState
    time: Array
    score: Array
    origin: Array


class Seen(NamedTuple):
    """Input of the networks, with one row for each copy and seat.

    Attributes:
        own: The seat's view of the state, then the seat as one-hot numbers.
        common: The same for all seats: the state, then zeros.
        masks: Valid actions; the last one, which is always valid, is to do nothing.
    """

    own: Array
    common: Array
    masks: Array


class Outcome(NamedTuple):
    """Result of a step of each copy.

    Attributes:
        reward: Shaped reward of the team.
        terminated: True if nothing can follow, so that the value of the next state is 0.
        ended: True if the episode ended, by its time limit too.
        goal: True if the goal was reached.
        steps: Steps of the episode so far.
        score: Sum of the episode's rewards without shaping.
        progress: Share of the goal's conditions that hold; not a number without shaping.
        origin: Number of the state in which the episode started.
    """

    reward: Array
    terminated: Array
    ended: Array
    goal: Array
    steps: Array
    score: Array
    progress: Array
    origin: Array


class TeamEnvironment:
    """Copies of a world whose players earn one reward.

    Args:
        world: The world.
        horizon: Longest episode.
        gamma: Discount of the shaped reward.
        shaping: Weight of the shaped reward; 0 leaves the sparse one.
        starts: States in which episodes can start, in the order of a plan. An episode that starts
            later in the plan has fewer steps left. By default, all start in the initial state.

    Attributes:
        inputs: Length of an input of the networks.
        actions: Number of outputs of an actor: the actions of a seat, and doing nothing.
        seats: Number of seats.
        starts: Number of states in which episodes can start.
    """

    def __init__(
        self,
        world: World,
        horizon: int,
        gamma: float,
        shaping: float,
        starts: Sequence[State] = (),
    ) -> None:
        batch = JaxBatch(world, max(1, len(starts)))
        for number, state in enumerate(starts):
            batch.set_state(number, state)
        self._starts, self.starts = batch.states, batch.copies
        self._engine = engine = batch.engine
        self.horizon, self._gamma, self._shaping = horizon, gamma, shaping
        self.views = views(batch.encoding, world.players)
        self.seats = len(world.players)
        self.inputs = batch.vector_size + self.seats
        self.counts = batch.action_counts
        self.actions = max(self.counts) + 1
        self._columns, self._scale = jnp.asarray(self.views.columns), jnp.asarray(self.views.scale)
        # Networks learn best from rewards near 1, but a dish earns dozens of points.
        menu = () if world.shift is None else world.shift.menu.values()
        self._unit = max((dish.points + dish.tip for dish in menu), default=1)
        self._identity = jnp.eye(self.seats)
        self._step = jax.vmap(engine.step)
        self._potential = jax.vmap(engine.potential)

    def start(self, origin: Array) -> Copies:
        """Return copies whose episodes start in the states with these numbers."""
        states = jax.tree.map(lambda array: array[origin], self._starts)
        time = origin * self.horizon // self.starts
        return Copies(states, time, jnp.zeros(len(origin)), origin)

    def seen(self, states: CopyState) -> Seen:
        """Return what the networks see."""
        vectors = jax.vmap(self._engine.vector)(states)
        copies = len(vectors)
        identity = jnp.broadcast_to(self._identity, (copies, self.seats, self.seats))
        own = vectors[:, self._columns] * self._scale
        common = jnp.broadcast_to((vectors * self._scale)[:, None], own.shape)
        return Seen(
            jnp.concatenate([own, identity], axis=2),
            jnp.concatenate([common, jnp.zeros_like(identity)], axis=2),
            jnp.stack([self._mask(states, seat) for seat in range(self.seats)], axis=1),
        )

    def step(self, copies: Copies, actions: Array, origin: Array) -> tuple[Copies, Outcome, Seen]:
        """Take a joint step; copies whose episode ends start a new one.

        Args:
            origin: For each copy, the number of the state in which a new episode would start.

        Returns:
            The copies, the result of the step, and what the networks see after it, before new
            episodes start.
        """
        numbers = jnp.where(actions < self.actions - 1, actions, -1)
        states, result = self._step(copies.states, numbers)
        time, score = copies.time + 1, copies.score + result.rewards
        terminated = result.terminated | result.overflowed
        ended = terminated | (time >= self.horizon)
        shaped, progress = self._shaped(copies.states, states, terminated)
        outcome = Outcome(
            result.rewards / self._unit + shaped,
            terminated,
            ended,
            result.terminated,
            time,
            score,
            progress,
            copies.origin,
        )
        chosen = jax.tree.map(
            lambda first, second: jnp.where(
                ended.reshape(-1, *[1] * (first.ndim - 1)), first, second
            ),
            self.start(origin),
            Copies(states, time, score, copies.origin),
        )
        return chosen, outcome, self.seen(states)

    def _shaped(
        self, before: CopyState, after: CopyState, terminated: Array
    ) -> tuple[Array, Array]:
        """Return the shaped part of the rewards, and the share of conditions that hold."""
        if not self._shaping:
            return jnp.zeros(len(terminated)), jnp.full(len(terminated), jnp.nan)
        reached = self._potential(after)
        # The potential of an end is 0, so that shaping does not change which policy is best.
        potential = jnp.where(terminated, 0.0, reached)
        return self._shaping * (self._gamma * potential - self._potential(before)), 1 + reached

    def _mask(self, states: CopyState, seat: int) -> Array:
        mask = jax.vmap(self._engine.mask, in_axes=(0, None))(states, seat)
        spare = np.zeros((1, self.actions - 1 - self.counts[seat]), bool)
        nothing = np.ones((1, 1), bool)
        tail = np.concatenate([spare, nothing], axis=1)
        return jnp.concatenate([mask, jnp.repeat(tail, len(mask), axis=0)], axis=1)
