"""Many copies of a kitchen, stepped together in one process."""

from __future__ import annotations

from typing import Any, Unpack

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from robotouille.domain.task import Task
from robotouille.envs.copies import Copies, PlayedCopies
from robotouille.envs.engine import engine_plays
from robotouille.envs.rewards import StepsToGoPotential
from robotouille.envs.rules import EnvOptions, EnvRules, Observation, Reward
from robotouille.envs.taken import ActionRows, not_begun
from robotouille.envs.views import Mask, observation_space, views_of
from robotouille.errors import WrongArgumentError

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
    Where it is compiled the batch engine plays them, if they are of one instance and their reward
    is sparse.

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
        self._copies = _copies_of(rules, num_envs)
        self._same_step = mode is AutoresetMode.SAME_STEP
        self.metadata = {"autoreset_mode": mode}
        self.num_envs = num_envs
        sizes = self._copies.view.sizes
        self.single_observation_space = observation_space(Observation.VECTOR, self._copies.view)
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
        return self._copies.masks()

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin all episodes anew.

        Args:
            seed: Of the choice among instances: of the first copy, those of the others follow; or
                one for each.
            options: Those of `RobotouilleEnv.reset`, for each copy.

        Raises:
            WrongArgumentError: There is not a seed for each, or no such instance.
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
            WrongArgumentError: There is no such action, or not one for each copy and player.
            InapplicableError: An action is not valid, and `invalid` is `raise`.
            RobotouilleError: No episode has begun.
        """
        if not self._randoms:
            raise not_begun()
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
        """The numbers of actions, a row for each copy."""
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
        """What the episodes that are over ended with."""
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
    """Copies under an environment's rules, in the batch engine if they are all of one instance."""
    views = views_of(rules.tasks(), rules.slots)
    if len(views) > 1 or not engine_plays(rules):
        return PlayedCopies(rules, views, number)
    from robotouille.envs.engine.copies import BatchCopies

    return BatchCopies(rules, views[0], number)
