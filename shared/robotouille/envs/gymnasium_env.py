"""A kitchen as a Gymnasium environment."""

from __future__ import annotations

from typing import Any, Unpack

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from robotouille.domain.task import Task
from robotouille.envs.pictures import picture
from robotouille.envs.play import Play
from robotouille.envs.rules import EnvOptions, EnvRules, Observation
from robotouille.envs.views import observation_space
from robotouille.errors import WrongArgumentError
from robotouille.world.world import State, World

__all__ = ["RobotouilleEnv"]

RENDER_MODES = ("ansi", "rgb_array")


class RobotouilleEnv(gymnasium.Env[Any, Any]):
    """One agent that moves all players of a task.

    An action is the number of a ground action (`World.ground_actions(player)`); of a task for
    several players a number for each, in the order of seats. The `info` of `reset` and `step` has
    `action_mask`, the valid actions as `action_space.sample` takes them (for several players a
    mask for each), and `valid`, whether the actions of the last step were applied.

    Args:
        task: A task, or a name for `load_task`: `synchronous/01`, `multi_agent/01@3`.
        render_mode: `ansi`: `render` gives text; `rgb_array`: pictures, with the extra `window`.
        options: `EnvOptions`: what is seen, what is rewarded, when an episode ends.

    Raises:
        WrongArgumentError: An option is none of what it may be.
        UnknownTaskError: There is no such task or instance.
        FileError: A task's files are wrong.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 4}  # noqa: RUF012

    def __init__(
        self,
        task: Task | str,
        *,
        render_mode: str | None = None,
        **options: Unpack[EnvOptions],
    ) -> None:
        if render_mode not in (None, *RENDER_MODES):
            raise WrongArgumentError(f"render_mode: one of {RENDER_MODES}, found {render_mode!r}")
        rules = EnvRules(task, **options)
        self._play = Play(rules)
        self._kind = Observation(rules.observation)
        self.render_mode = render_mode
        self.observation_space = observation_space(self._kind, self._play.view)
        counts = self._play.view.sizes.actions
        self._alone = len(counts) == 1
        self.action_space: spaces.Space[Any] = (
            spaces.Discrete(counts[0]) if self._alone else spaces.MultiDiscrete(list(counts))
        )

    @property
    def state(self) -> State:
        """The state at present.

        Raises:
            RobotouilleError: No episode has begun.
        """
        return self._play.state

    @property
    def world(self) -> World:
        """The world of the instance that is played."""
        return self._play.view.world

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Which actions are valid now, as sb3-contrib's `MaskablePPO` asks for it: booleans, those
        of several players one behind the other."""
        return np.concatenate(self._play.seen.masks).view(np.bool_)

    def _info(self, valid: bool) -> dict[str, Any]:
        masks = self._play.seen.masks
        mask = masks[0].copy() if self._alone else tuple(each.copy() for each in masks)
        return {"action_mask": mask, "valid": valid}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Of the choice among `instances`; nothing else here is random.
            options: `instance`: which one to play, by its name or number.

        Raises:
            WrongArgumentError: The instance is none of this environment's.
        """
        super().reset(seed=seed)
        play = self._play
        play.begin(self.np_random, options)
        return play.observation(self._kind, play.players), self._info(True)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take a step.

        Raises:
            WrongArgumentError: There is no such action.
            InapplicableError: An action is not valid, and `invalid` is `raise`.
            RobotouilleError: The episode is over, or none has begun.
        """
        play = self._play
        reward, terminated, truncated, valid = play.take((action,) if self._alone else action)
        observation = play.observation(self._kind, play.players)
        return observation, reward, terminated, truncated, self._info(all(valid))

    def render(self) -> Any:
        """The state as text or as a picture, by `render_mode`.

        Raises:
            RobotouilleError: No episode has begun.
            MissingExtraError: A picture is asked for, and pygame is not installed.
        """
        if self.render_mode == "ansi":
            return self.state.text_view()
        if self.render_mode == "rgb_array":
            return picture(self.state, self._play.steps)
        return None
