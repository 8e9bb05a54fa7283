"""Many copies of a kitchen, stepped together in one process."""

from __future__ import annotations

from typing import Any, Unpack

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from robotouille.domain.task import Task
from robotouille.envs.play import Play
from robotouille.envs.rewards import StepsToGoPotential
from robotouille.envs.rules import EnvOptions, EnvRules, Observation, Reward
from robotouille.envs.views import Mask, observation_space
from robotouille.errors import RobotouilleError, WrongArgumentError

__all__ = ["RobotouilleVectorEnv"]

Arrays = tuple[
    npt.NDArray[np.float32],
    npt.NDArray[np.float64],
    npt.NDArray[np.bool_],
    npt.NDArray[np.bool_],
    dict[str, Any],
]


class RobotouilleVectorEnv(VectorEnv[Any, Any, Any]):
    """`num_envs` copies of `RobotouilleEnv` with vectors as observations. They share one world.

    The `info` of `reset` and `step` has `action_mask`, an array of a row for each copy, and
    `valid`; with `AutoresetMode.SAME_STEP` also `final_obs` and `final_info`.

    Args:
        task: A task, or a name for `load_task`.
        num_envs: How many copies.
        autoreset_mode: When a copy whose episode is over begins another one: `NextStep` or
            `SameStep`.
        options: `EnvOptions`, but for `observation`.

    Raises:
        WrongArgumentError: An option is none of what it may be.
        UnknownTaskError: There is no such task or instance.
        FileError: A task's files are wrong.
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
        rules = EnvRules(task, **options)
        if rules.observation is not Observation.VECTOR:
            raise WrongArgumentError("observation: copies in one process see vectors")
        first = Play(rules)
        self._plays = [first, *(Play(rules, first.views) for _ in range(num_envs - 1))]
        self._same_step = mode is AutoresetMode.SAME_STEP
        self.metadata = {"autoreset_mode": mode}
        self.num_envs = num_envs
        sizes = self._plays[0].view.sizes
        self.single_observation_space = observation_space(Observation.VECTOR, self._plays[0].view)
        self._alone = len(sizes.actions) == 1
        self.single_action_space = (
            spaces.Discrete(sizes.actions[0])
            if self._alone
            else spaces.MultiDiscrete(list(sizes.actions))
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._randoms: list[np.random.Generator] = []

    def action_masks(self) -> Mask:
        """Which actions of each copy are valid now, a row for each."""
        if self._alone:
            return np.array([play.seen.masks[0] for play in self._plays])
        return np.array([np.concatenate(play.seen.masks) for play in self._plays])

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin all episodes anew.

        Args:
            seed: Of the choice among instances: of the first copy, those of the others follow; or
                one for each.
            options: Those of `RobotouilleEnv.reset`, for each copy.
        """
        if seed is not None or not self._randoms:
            seeds = seed if isinstance(seed, list) else [
                None if seed is None else seed + i for i in range(self.num_envs)
            ]  # fmt: skip
            self._randoms = [np.random.default_rng(each) for each in seeds]
        for play, random in zip(self._plays, self._randoms, strict=True):
            play.begin(random, options)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        return self._observations(), self._info(everyone)

    def step(self, actions: Any) -> Arrays:
        """Take a step in each copy.

        Raises:
            WrongArgumentError: There is no such action.
            InapplicableError: An action is not valid, and `invalid` is `raise`.
            RobotouilleError: No episode has begun.
        """
        if not self._randoms:
            raise RobotouilleError("reset the environment: no episode has begun")
        rewards = np.zeros(self.num_envs)
        terminated, truncated, valid = np.zeros((3, self.num_envs), dtype=np.bool_)
        numbers = np.asarray(actions).tolist()
        finals: dict[int, tuple[Any, Mask]] = {}
        for i, play in enumerate(self._plays):
            if play.over:
                play.begin(self._randoms[i], None)
                valid[i] = True
                continue
            taken = play.take((numbers[i],) if self._alone else numbers[i])
            rewards[i], terminated[i], truncated[i], applied = taken
            valid[i] = all(applied)
            if self._same_step and play.over:
                seen = play.seen
                finals[i] = seen.vector.copy(), np.concatenate(seen.masks)
                play.begin(self._randoms[i], None)
        info = self._info(valid)
        if finals:
            info |= self._final(finals)
        return self._observations(), rewards, terminated, truncated, info

    def _observations(self) -> npt.NDArray[np.float32]:
        return np.array([play.seen.vector for play in self._plays])

    def _info(self, valid: npt.NDArray[np.bool_]) -> dict[str, Any]:
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        mask = self.action_masks()
        return {
            "action_mask": mask, "_action_mask": everyone, "valid": valid, "_valid": everyone.copy()
        }  # fmt: skip

    def _final(self, finals: dict[int, tuple[Any, Mask]]) -> dict[str, Any]:
        """What the episodes that are over ended with."""
        which = np.zeros(self.num_envs, dtype=np.bool_)
        which[list(finals)] = True
        observations = np.full(self.num_envs, None, dtype=object)
        masks = np.zeros((self.num_envs, len(next(iter(finals.values()))[1])), dtype=np.bool_)
        for i, (vector, mask) in finals.items():
            observations[i] = vector
            masks[i] = mask
        return {
            "final_obs": observations,
            "_final_obs": which,
            "final_info": {"action_mask": masks, "_action_mask": which.copy()},
            "_final_info": which.copy(),
        }
