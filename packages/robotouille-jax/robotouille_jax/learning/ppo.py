"""Proximal policy optimisation of a team, from rollouts to updates, as one pure function.

IPPO and MAPPO differ in the critic's input only: the seat's own view, or one view for the team.
The difference is a traced value, so that runs of both are compiled once and run side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import optax

from robotouille.errors import WrongArgumentError
from robotouille_jax.learning.network import Layers, Networks, networks, output
from robotouille_jax.learning.starts import draw_origins
from robotouille_jax.learning.team_environment import Copies, Outcome, Seen, TeamEnvironment
from robotouille_jax.padded import Array

Number = TypeVar("Number", int, float)

PRIMES = (1013, 2027, 4051, 7919)
MAX_ROLLOUT = 2**32 // max(PRIMES)
"""Largest number of steps of a rollout. More steps could not be mixed with 32-bit numbers."""


def _option(default: Number, meaning: str) -> Number:
    option: Number = field(default=default, metadata={"help": meaning})
    return option


@dataclass(frozen=True)
class Config:
    """Hyperparameters. The defaults suit a CPU; GPUs can play far more copies.

    The command's help is the meaning of each one.
    """

    copies: int = _option(32, "copies of the task that a run plays at once")
    rollout: int = _option(16, "steps of each copy between updates of the networks")
    updates: int = _option(300, "largest number of rollouts, each followed by an update")
    epochs: int = _option(1, "passes over each rollout")
    minibatches: int = _option(4, "parts of a pass")
    hidden: int = _option(64, "width of the two hidden layers")
    rate: float = _option(1e-3, "first learning rate, which falls to 0")
    gamma: float = _option(0.97, "discount of a step")
    lam: float = _option(0.95, "decay of generalised advantage estimation")
    clip: float = _option(0.2, "range of the clipped ratio of probabilities")
    entropy: float = _option(0.05, "first weight of the entropy bonus, which falls to 0")

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
    """Means over the episodes from the task's first state that ended in a rollout.

    They are not a number if none ended.
    """

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


class Samples(NamedTuple):
    """Steps of a rollout from which the networks learn, with one row for each joint step."""

    own: Array
    masks: Array
    critic: Array
    actions: Array
    log_probability: Array
    advantage: Array
    target: Array


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
        key, first, second, third = jax.random.split(key, 4)
        nets = networks(first, env.inputs, config.hidden, env.actions)
        origin = draw_origins(env.starts, jnp.float32(1), third, config.copies)
        copies = env.start(origin)
        # Copies that all start at once would end at once, and a rollout would see few situations.
        late = jax.random.randint(second, (config.copies,), 0, env.horizon)
        copies = copies._replace(time=late, origin=jnp.full_like(late, -1))
        start = _Learner(nets, self._optimiser.init(nets), copies, key)

        def update(number: Array, both: tuple[_Learner, Curve]) -> tuple[_Learner, Curve]:
            learner, curve = both
            learner, point = self._update(learner, 1 - number / updates, central)
            return learner, jax.tree.map(lambda all_, one: all_.at[number].set(one), curve, point)

        empty = Curve(*(jnp.full(config.updates, jnp.nan) for _ in Curve._fields))
        learner, curve = jax.lax.fori_loop(0, updates, update, (start, empty))
        return learner.networks, curve

    def _update(self, learner: _Learner, left: Array, central: Array) -> tuple[_Learner, Curve]:
        key, rolling, mixing = jax.random.split(learner.key, 3)
        copies, played = self._rollout(learner, left, rolling, central)
        nets, optimiser = self._learn(learner, self._samples(played, central), mixing, left)
        return _Learner(nets, optimiser, copies, key), _curve(played.outcome)

    def _rollout(
        self, learner: _Learner, left: Array, key: Array, central: Array
    ) -> tuple[Copies, Played]:
        env, nets = self._env, learner.networks

        def play(copies: Copies, key: Array) -> tuple[Copies, Played]:
            acting, starting = jax.random.split(key)
            seen = env.seen(copies.states)
            values = logits(nets.actor, seen.own, seen.masks)
            actions = drawn(values, acting)
            chosen = _log_probability(values, actions)
            value = output(nets.critic, _critic_input(seen, central))[..., 0]
            origin = draw_origins(env.starts, left, starting, len(copies.time))
            copies, outcome, after = env.step(copies, actions, origin)
            next_value = output(nets.critic, _critic_input(after, central))[..., 0]
            return copies, Played(seen, actions, chosen, value, next_value, outcome)

        played: tuple[Copies, Played] = jax.lax.scan(
            play, learner.copies, jax.random.split(key, self._config.rollout)
        )
        return played

    def _samples(self, played: Played, central: Array) -> Samples:
        advantage = self._advantages(played)
        samples = Samples(
            played.seen.own,
            played.seen.masks,
            _critic_input(played.seen, central),
            played.actions,
            played.log_probability,
            advantage,
            advantage + played.value,
        )
        size = self._config.rollout * self._config.copies
        flat: Samples = jax.tree.map(lambda x: x.reshape(size, *x.shape[2:]), samples)
        return flat

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

    def _learn(self, learner: _Learner, samples: Samples, key: Array, left: Array) -> _Learned:
        config = self._config

        def step(both: _Learned, part: Samples) -> tuple[_Learned, None]:
            nets, optimiser = both
            gradient = jax.grad(self._loss)(nets, part, left)
            change, optimiser = self._optimiser.update(gradient, optimiser)
            change = jax.tree.map(lambda x: left * x, change)
            return (optax.apply_updates(nets, change), optimiser), None

        def epoch(both: _Learned, key: Array) -> tuple[_Learned, None]:
            order = _shuffled(len(samples.own), key).reshape(config.minibatches, -1)
            parts = jax.tree.map(lambda x: x[order], samples)
            return jax.lax.scan(step, both, parts)[0], None

        keys = jax.random.split(key, config.epochs)
        both: _Learned = jax.lax.scan(epoch, (learner.networks, learner.optimiser), keys)[0]
        return both

    def _loss(self, nets: Networks, part: Samples, left: Array) -> Array:
        values = logits(nets.actor, part.own, part.masks)
        ratio = jnp.exp(_log_probability(values, part.actions) - part.log_probability)
        advantage = (part.advantage - part.advantage.mean()) / (part.advantage.std() + 1e-8)
        clipped = jnp.clip(ratio, 1 - self._config.clip, 1 + self._config.clip)
        policy = -jnp.minimum(ratio * advantage, clipped * advantage).mean()
        value = jnp.square(output(nets.critic, part.critic)[..., 0] - part.target).mean()
        logs = jax.nn.log_softmax(values)
        entropy = -jnp.sum(jnp.exp(logs) * jnp.where(part.masks, logs, 0.0), axis=-1).mean()
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
    ended = outcome.ended & (outcome.origin == 0)
    goal = outcome.goal & ended
    return Curve(
        goal.sum() / ended.sum(),
        jnp.where(goal, outcome.steps, 0).sum() / goal.sum(),
        jnp.where(ended, outcome.score, 0).sum() / ended.sum(),
        jnp.where(ended, outcome.progress, 0).sum() / ended.sum(),
    )
