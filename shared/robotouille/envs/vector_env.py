"""Many copies of a kitchen that take steps together in one process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol, Unpack

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from robotouille.domain.task import Task
from robotouille.envs.layout import Layout
from robotouille.envs.observers.vector_observer import VectorObserver
from robotouille.envs.play import Play
from robotouille.envs.potential import StepsToGoPotential
from robotouille.envs.rules import (
    ActionRows,
    BatchStepResult,
    Bools,
    EnvObservation,
    EnvOptions,
    EnvRules,
    Perspective,
    Reward,
    check_one_agent,
    engine_plays,
    not_reset_error,
    seat_of_one_agent,
)
from robotouille.envs.views import Mask, Vector, views_of
from robotouille.errors import WrongArgumentError


class Copies(Protocol):
    """Copies of an environment's episodes. `layout` names what their vectors contain."""

    layout: Layout

    @property
    def over(self) -> Bools:
        """Copies whose episode has ended or has not begun."""

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        """Begin an episode in some copies: see `Play.begin`."""

    def take(self, numbers: ActionRows) -> BatchStepResult:
        """Take a step in each running copy: see `Play.take`.

        Raises:
            SlotOverflowError: Some copy has too few slots.
        """

    def vectors(self) -> Vector:
        """Return the observations, one row per copy."""

    def masks(self) -> Mask:
        """Return the valid actions, one row per copy. The players' masks are concatenated."""


class PlayedCopies:
    """Copies that are played one by one, with any instances, rewards and observations."""

    def __init__(self, layout: Layout, copies: int) -> None:
        self.layout = layout
        self.plays = [Play(layout.rules, layout.views) for _ in range(copies)]
        self._seat = seat_of_one_agent(layout.rules, len(layout.players))
        # Each copy has its own observer, which caches what the agent sees of the copy's state.
        self._observers = [VectorObserver(layout) for _ in range(copies)]

    @property
    def over(self) -> Bools:
        return np.array([play.over for play in self.plays])

    def begin(
        self, which: Bools, randoms: Sequence[np.random.Generator], options: dict[str, Any] | None
    ) -> None:
        for copy in np.flatnonzero(which).tolist():
            self.plays[copy].begin(randoms[copy], options)

    def take(self, numbers: ActionRows) -> BatchStepResult:
        rewards = np.zeros(len(self.plays))
        terminated, truncated, valid = np.zeros((3, len(self.plays)), dtype=np.bool_)
        for copy, (play, chosen) in enumerate(zip(self.plays, numbers.tolist(), strict=True)):
            if not play.over:
                rewards[copy], terminated[copy], truncated[copy], applied = play.take(chosen)
                valid[copy] = all(applied)
        return BatchStepResult(rewards, terminated, truncated, valid)

    def vectors(self) -> Vector:
        return np.array([each.observe(play, self._seat) for each, play in self._pairs()])

    def masks(self) -> Mask:
        return np.array([np.concatenate(each.masks(play)) for each, play in self._pairs()])

    def _pairs(self) -> Iterator[tuple[VectorObserver, Play]]:
        return zip(self._observers, self.plays, strict=True)


Arrays = tuple[
    npt.NDArray[np.float32],
    npt.NDArray[np.float64],
    npt.NDArray[np.bool_],
    npt.NDArray[np.bool_],
    dict[str, Any],
]


class RobotouilleVectorEnv(VectorEnv[Any, Any, Any]):
    """`num_envs` copies of `RobotouilleEnv` with vector observations, which share one world.

    If the batch engine is compiled, it plays copies of one instance with sparse rewards. The `info`
    of `reset` and `step` contains `action_mask` and `valid`, with one row per copy. With
    `AutoresetMode.SAME_STEP` it also contains `final_obs` and `final_info`.

    Args:
        task: A task, or a name for `load_task`.
        num_envs: Number of copies.
        autoreset_mode: `NextStep` or `SameStep`: when a copy begins another episode.
        options: `EnvOptions`, with vectors only, as graphs and texts have no fixed size.
            `perspective` and `tokens` need an agent for each player: `parallel_env`.

    Raises:
        WrongArgumentError: An option is invalid.
        UnknownTaskError: The task or an instance does not exist.
        FileError: A task's files are invalid.
    """

    def __init__(
        self,
        task: Task | str,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Unpack[EnvOptions],
    ) -> None:
        if num_envs < 1:
            raise WrongArgumentError(f"num_envs: expected 1 or more, found {num_envs}")
        mode = AutoresetMode(autoreset_mode)
        if mode is AutoresetMode.DISABLED:
            raise WrongArgumentError("autoreset_mode: expected 'NextStep' or 'SameStep'")
        if options.get("reward") == Reward.SHAPED:
            options.setdefault("potential", StepsToGoPotential())
        rules = EnvRules.of(task, options)
        check_one_agent(rules)
        if rules.observation is not EnvObservation.VECTOR:
            raise WrongArgumentError(
                f"observation: copies in one process have vectors, and a {rules.observation} has "
                "no fixed size; use gymnasium.vector.AsyncVectorEnv with shared_memory=False"
            )
        self._copies = _copies_of(rules, num_envs)
        self._same_step = mode is AutoresetMode.SAME_STEP
        self.metadata = {"autoreset_mode": mode}
        self.num_envs = num_envs
        sizes = self._copies.layout.sizes
        self.single_observation_space = spaces.Box(
            -1.0, sizes.high, (len(self.columns),), np.float32
        )
        self._alone = len(sizes.actions) == 1
        self.single_action_space = (
            spaces.Discrete(sizes.actions[0])
            if self._alone
            else spaces.MultiDiscrete(list(sizes.actions))
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._randoms: list[np.random.Generator] = []

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the numbers in a vector; see `Encoding.columns`."""
        return self._copies.layout.columns

    def action_masks(self) -> Mask:
        """Return the valid actions, one row per copy."""
        return self._copies.masks()

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every copy.

        Args:
            seed: Seed for the choice among instances: one for each copy, or one for the first, from
                which the others count up.
            options: Options of `RobotouilleEnv.reset`, for each copy.

        Raises:
            WrongArgumentError: The number of seeds is wrong, or an instance does not exist.
        """
        if seed is not None or not self._randoms:
            seeds = seed if isinstance(seed, list) else [
                None if seed is None else seed + i for i in range(self.num_envs)
            ]  # fmt: skip
            if len(seeds) != self.num_envs:
                raise WrongArgumentError(f"seed: expected {self.num_envs}, found {len(seeds)}")
            self._randoms = [np.random.default_rng(each) for each in seeds]
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        self._copies.begin(everyone, self._randoms, options)
        return self._copies.vectors(), self._info(everyone)

    def step(self, actions: Any) -> Arrays:
        """Take a step in each copy.

        Raises:
            WrongArgumentError: An action does not exist, or the shape of the actions is wrong.
            InapplicableError: An action is not valid, and `invalid` is `raise`.
            RobotouilleError: No episode has begun.
        """
        if not self._randoms:
            raise not_reset_error()
        copies = self._copies
        anew = copies.over
        rewards, terminated, truncated, valid = copies.take(self._numbers(actions))
        last: dict[str, Any] = {}
        if self._same_step:
            anew = copies.over
            last = self._last(anew) if anew.any() else {}
        else:
            valid |= anew
        if anew.any():
            copies.begin(anew, self._randoms, None)
        return copies.vectors(), rewards, terminated, truncated, self._info(valid) | last

    def _numbers(self, actions: Any) -> ActionRows:
        """Return the numbers of actions, one row per copy."""
        found = np.asarray(actions)
        if found.dtype.kind not in "iu" or found.shape != self.action_space.shape:
            raise WrongArgumentError(
                f"expected integers of shape {self.action_space.shape}, "
                f"found {found.dtype} {found.shape}"
            )
        return found.reshape(self.num_envs, -1).astype(np.int64)

    def _info(self, valid: npt.NDArray[np.bool_]) -> dict[str, Any]:
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        mask = self.action_masks()
        return {
            "action_mask": mask, "_action_mask": everyone, "valid": valid, "_valid": everyone.copy()
        }  # fmt: skip

    def _last(self, which: npt.NDArray[np.bool_]) -> dict[str, Any]:
        """Return the final observations and infos of ended episodes."""
        vectors, masks = self._copies.vectors(), self.action_masks()
        observations = np.full(self.num_envs, None, dtype=object)
        for copy in np.flatnonzero(which).tolist():
            observations[copy] = vectors[copy].copy()
        ended = np.where(which[:, None], masks, 0).astype(np.bool_)
        return {
            "final_obs": observations,
            "_final_obs": which,
            "final_info": {"action_mask": ended, "_action_mask": which.copy()},
            "_final_info": which.copy(),
        }


def _copies_of(rules: EnvRules, number: int) -> Copies:
    """Return copies under an environment's rules, in the batch engine if possible."""
    views = views_of(rules.tasks(), rules.slots)
    layout = Layout(rules, views, Perspective.SHARED)
    if len(views) > 1 or not engine_plays(rules, views[0].world):
        return PlayedCopies(layout, number)
    from robotouille.envs.compiled_engine import BatchCopies

    return BatchCopies(layout, number)
