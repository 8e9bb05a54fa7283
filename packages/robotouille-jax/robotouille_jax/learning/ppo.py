"""Proximal policy optimisation of a team, from rollouts to updates, as one pure function.

IPPO and MAPPO differ in the critic's input only: the seat's own view, or one view for the team.
The difference is a traced value, so that runs of both are compiled once and run side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax

from robotouille.errors import WrongArgumentError
from robotouille_jax.learning.network import Layers, Networks, networks, output
from robotouille_jax.learning.team_environment import Copies, Outcome, Seen, TeamEnvironment
from robotouille_jax.padded import Array

PRIMES = (1013, 2027, 4051, 7919)
MAX_ROLLOUT = 2**32 // max(PRIMES)
"""Largest number of steps of a rollout. More steps could not be mixed with 32-bit numbers."""


@dataclass(frozen=True)
class Config:
    """Hyperparameters. The defaults suit a CPU; GPUs can play far more copies.

    Attributes:
        copies: Copies of the task that a run plays at once.
        rollout: Steps of each copy between updates of the networks.
        updates: Largest number of rollouts; each is followed by an update of the networks.
        epochs: Passes over each rollout.
        minibatches: Parts of a pass.
        hidden: Width of the hidden layers.
        rate: First learning rate, which falls to 0.
        gamma: Discount.
        lam: Decay of generalised advantage estimation.
        clip: Range of the clipped ratio.
        entropy: First weight of the entropy bonus, which falls to 0.
    """

    copies: int = 32
    rollout: int = 16
    updates: int = 600
    epochs: int = 3
    minibatches: int = 2
    hidden: int = 64
    rate: float = 1e-3
    gamma: float = 0.97
    lam: float = 0.95
    clip: float = 0.2
    entropy: float = 0.02

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
            WrongArgumentError: They do not fit.
        """
        sizes = (
            self.copies,
            self.rollout,
            self.updates,
            self.epochs,
            self.minibatches,
            self.hidden,
        )
        if min(sizes) < 1:
            raise WrongArgumentError("sizes and numbers of updates, epochs and parts start at 1")
        if self.copies * self.rollout % self.minibatches:
            raise WrongArgumentError(
                f"copies times rollout, {self.copies * self.rollout}, must be a multiple of "
                f"minibatches, {self.minibatches}"
            )
        if self.copies * self.rollout > MAX_ROLLOUT:
            raise WrongArgumentError(f"copies times rollout must be at most {MAX_ROLLOUT}")


class Curve(NamedTuple):
    """Means over the episodes that ended in a rollout; not a number if none ended."""

    goals: Array
    steps: Array
    score: Array
    progress: Array


class Played(NamedTuple):
    """A step of a rollout, with one row for each copy."""

    seen: Seen
    actions: Array
    log_probability: Array
    value: Array
    next_value: Array
    outcome: Outcome


class _Learner(NamedTuple):
    networks: Networks
    optimiser: optax.OptState
    copies: Copies
    key: Array


_Learned = tuple[Networks, optax.OptState]

Train = Callable[[Array, Array, Array], tuple[Networks, Curve]]
"""A run, from its key, whether the critic sees the team's view (MAPPO) and the number of rollouts.

It returns the networks, and a curve with a point for each rollout.
"""


def trainer(environment: TeamEnvironment, config: Config) -> Train:
    """Return the function of a whole run, for `jax.jit` and `jax.vmap`."""
    return _Trainer(environment, config).train


def logits(actor: Layers, own: Array, masks: Array) -> Array:
    """Return an actor's outputs, with invalid actions at minus infinity or near it."""
    return jnp.where(masks, output(actor, own), -1e9)


def drawn(values: Array, key: Array) -> Array:
    """Draw actions from logits, with one random number for each row.

    `jax.random.categorical` draws one for each action, which takes longer than the whole step.
    """
    weights = jnp.exp(values - values.max(-1, keepdims=True))
    sums = jnp.cumsum(weights, axis=-1)
    draw = jax.random.uniform(key, (*values.shape[:-1], 1)) * sums[..., -1:]
    # Rounding can make sums differ at actions without weight, so those are excluded.
    possible = (sums > draw) & (weights > 0)
    return jnp.where(possible.any(-1), jnp.argmax(possible, axis=-1), jnp.argmax(values, axis=-1))


class _Trainer:
    def __init__(self, environment: TeamEnvironment, config: Config) -> None:
        self._env, self._config = environment, config
        self._optimiser = optax.chain(
            optax.clip_by_global_norm(0.5), optax.scale_by_adam(eps=1e-5), optax.scale(-config.rate)
        )

    def train(self, key: Array, central: Array, updates: Array) -> tuple[Networks, Curve]:
        env, config = self._env, self._config
        key, first, second = jax.random.split(key, 3)
        nets = networks(first, env.inputs, config.hidden, env.actions)
        copies = env.start(config.copies)
        # Copies that all start at once would end at once, and a rollout would see few situations.
        time = jax.random.randint(second, (config.copies,), 0, env.horizon)
        start = _Learner(nets, self._optimiser.init(nets), copies._replace(time=time), key)

        def update(number: Array, both: tuple[_Learner, Curve]) -> tuple[_Learner, Curve]:
            learner, curve = both
            learner, point = self._update(learner, 1 - number / updates, central)
            return learner, jax.tree.map(lambda all_, one: all_.at[number].set(one), curve, point)

        empty = Curve(*(jnp.full(config.updates, jnp.nan) for _ in Curve._fields))
        learner, curve = jax.lax.fori_loop(0, updates, update, (start, empty))
        return learner.networks, curve

    def _update(self, learner: _Learner, left: Array, central: Array) -> tuple[_Learner, Curve]:
        key, rolling, mixing = jax.random.split(learner.key, 3)
        copies, played = self._rollout(learner.networks, learner.copies, rolling, central)
        advantages = self._advantages(played)
        targets = advantages + played.value
        rows = (
            played.seen.own,
            played.seen.masks,
            _critic_input(played.seen, central),
            played.actions,
            played.log_probability,
            advantages,
            targets,
        )
        size = self._config.rollout * self._config.copies
        rows = jax.tree.map(lambda x: x.reshape(size, *x.shape[2:]), rows)
        nets, optimiser = self._learn(learner, rows, mixing, left)
        return _Learner(nets, optimiser, copies, key), _curve(played.outcome)

    def _rollout(
        self, nets: Networks, copies: Copies, key: Array, central: Array
    ) -> tuple[Copies, Played]:
        env = self._env

        def play(copies: Copies, key: Array) -> tuple[Copies, Played]:
            seen = env.seen(copies.states)
            values = logits(nets.actor, seen.own, seen.masks)
            actions = drawn(values, key)
            chosen = _log_probability(values, actions)
            value = output(nets.critic, _critic_input(seen, central))[..., 0]
            copies, outcome, after = env.step(copies, actions)
            next_value = output(nets.critic, _critic_input(after, central))[..., 0]
            return copies, Played(seen, actions, chosen, value, next_value, outcome)

        played: tuple[Copies, Played] = jax.lax.scan(
            play, copies, jax.random.split(key, self._config.rollout)
        )
        return played

    def _advantages(self, played: Played) -> Array:
        """Return generalised advantages; episodes cut by the time limit go on by their value."""
        gamma, outcome = self._config.gamma, played.outcome
        going_on = gamma * played.next_value * ~outcome.terminated[..., None]
        surprise = outcome.reward[..., None] + going_on - played.value
        decay = gamma * self._config.lam * ~outcome.ended[..., None]

        def back(later: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
            now = row[0] + row[1] * later
            return now, now

        return jax.lax.scan(
            back, jnp.zeros_like(surprise[0]), (surprise, decay), reverse=True
        )[1]  # fmt: skip

    def _learn(
        self, learner: _Learner, rows: tuple[Array, ...], key: Array, left: Array
    ) -> _Learned:
        config = self._config

        def step(both: _Learned, part: tuple[Array, ...]) -> tuple[_Learned, None]:
            nets, optimiser = both
            gradient = jax.grad(self._loss)(nets, part, left)
            change, optimiser = self._optimiser.update(gradient, optimiser)
            change = jax.tree.map(lambda x: left * x, change)
            return (optax.apply_updates(nets, change), optimiser), None

        def epoch(both: _Learned, key: Array) -> tuple[_Learned, None]:
            order = _shuffled(len(rows[0]), key).reshape(config.minibatches, -1)
            parts = jax.tree.map(lambda x: x[order], rows)
            return jax.lax.scan(step, both, parts)[0], None

        keys = jax.random.split(key, config.epochs)
        both: _Learned = jax.lax.scan(epoch, (learner.networks, learner.optimiser), keys)[0]
        return both

    def _loss(self, nets: Networks, part: tuple[Array, ...], left: Array) -> Array:
        own, masks, critic, actions, before, advantages, targets = part
        values = logits(nets.actor, own, masks)
        now = _log_probability(values, actions)
        ratio = jnp.exp(now - before)
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        clipped = jnp.clip(ratio, 1 - self._config.clip, 1 + self._config.clip)
        policy = -jnp.minimum(ratio * advantages, clipped * advantages).mean()
        value = jnp.square(output(nets.critic, critic)[..., 0] - targets).mean()
        logs = jax.nn.log_softmax(values)
        entropy = -jnp.sum(jnp.exp(logs) * jnp.where(masks, logs, 0.0), axis=-1).mean()
        return policy + 0.5 * value - self._config.entropy * left * entropy


def _shuffled(size: int, key: Array) -> Array:
    """Return the numbers below `size`, mixed by a multiplication modulo the size.

    `jax.random.permutation` sorts, which takes longer to compile than all the rest.
    """
    primes = jnp.array([prime % size for prime in PRIMES if size % prime])
    first, second = jax.random.split(key)
    start = jax.random.randint(first, (), 0, size)
    factor = jax.random.choice(second, primes)
    return (jnp.arange(size, dtype=jnp.uint32) * factor.astype(jnp.uint32) + start) % size


def _critic_input(seen: Seen, central: Array) -> Array:
    return jnp.where(central, seen.common, seen.own)


def _log_probability(values: Array, actions: Array) -> Array:
    return jnp.take_along_axis(jax.nn.log_softmax(values), actions[..., None], axis=-1)[..., 0]


def _curve(outcome: Outcome) -> Curve:
    ended, goal = outcome.ended, outcome.goal
    return Curve(
        goal.sum() / ended.sum(),
        jnp.where(goal, outcome.steps, 0).sum() / goal.sum(),
        jnp.where(ended, outcome.score, 0).sum() / ended.sum(),
        jnp.where(ended, outcome.progress, 0).sum() / ended.sum(),
    )
