"""A kitchen as a Gymnasium environment."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Unpack

import gymnasium
import numpy as np
import numpy.typing as npt
import pettingzoo
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec, register, registry

from robotouille.domain.loading import task_names
from robotouille.domain.task import Task
from robotouille.envs.observers import observer_of
from robotouille.envs.play import Play
from robotouille.envs.rules import (
    RENDER_MODES,
    EnvOptions,
    EnvRules,
    Perspective,
    check_one_agent,
    check_render_mode,
    seat_of_one_agent,
)
from robotouille.envs.views import Mask, picture
from robotouille.world.world import State, World

VERSION = 0
"""Version of the environments. It changes if the same actions give other results."""


def env_id(task: str) -> str:
    """Return the name of a shipped task's environment, such as `robotouille/synchronous-01-v0`."""
    folder, _, file = task.rpartition("/")
    number = file.partition("_")[0]
    return f"robotouille/{folder}-{number if number.isdigit() else file}-v{VERSION}"


def register_envs() -> None:
    """Register all shipped tasks with Gymnasium, and with PettingZoo 1.27 or later.

    Importing `robotouille.envs` calls this function.
    """
    # Gymnasium's checking wrappers are left out, because `RobotouilleEnv` checks its arguments
    # itself.
    for task in task_names():
        name = env_id(task)
        if name in registry:
            continue
        register(
            name,
            entry_point="robotouille.envs.gymnasium_env:RobotouilleEnv",
            vector_entry_point="robotouille.envs.vector_env:RobotouilleVectorEnv",
            kwargs={"task": task},
            order_enforce=False,
            disable_env_checker=True,
        )
        if hasattr(pettingzoo, "register"):
            module = "robotouille.envs.pettingzoo_env"
            pettingzoo.register("parallel", name, f"{module}:parallel_env", kwargs={"task": task})
            pettingzoo.register("aec", name, f"{module}:aec_env", kwargs={"task": task})


class RobotouilleEnv(gymnasium.Env[Any, Any]):
    """One agent that controls all players of a task.

    An action is the number of a ground action (`World.ground_actions(player)`), or -1 to do
    nothing. For several players it contains one number per player, in the order of seats. The
    `info` of `reset` and `step` contains `action_mask`, the valid actions in the format of
    `action_space.sample` (one mask per player), and `valid`, whether the actions of the last step
    were applied.

    Args:
        task: A task, or a name for `load_task`: `synchronous/01`, `multi_agent/01@3`.
        render_mode: `ansi` renders text; `rgb_array` renders pictures and needs the extra `window`.
        options: `EnvOptions`: observations, rewards and the end of episodes.

    Raises:
        WrongArgumentError: An option is invalid.
        UnknownTaskError: The task or an instance does not exist.
        FileError: A task's files are invalid.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 4}  # noqa: RUF012

    def __init__(
        self, task: Task | str, *, render_mode: str | None = None, **options: Unpack[EnvOptions]
    ) -> None:
        check_render_mode(render_mode)
        rules = EnvRules.of(task, options)
        check_one_agent(rules)
        self._play = Play(rules)
        self._observer = observer_of(rules, self._play.views, Perspective.SHARED)
        self._seat = seat_of_one_agent(rules, len(self._play.players))
        self.render_mode = render_mode
        self._spec: EnvSpec | None = None
        self.observation_space = self._observer.space()
        counts = self._play.view.sizes.actions
        self._alone = len(counts) == 1
        self.action_space: spaces.Space[Any] = (
            spaces.Discrete(counts[0]) if self._alone else spaces.MultiDiscrete(list(counts))
        )

    @property
    def spec(self) -> EnvSpec | None:
        """The specification of an environment that was made by name, with its step budget."""
        if self._spec is None:
            return None
        rules = self._play.rules
        limit = max(rules.step_limit(view.world) for view in self._play.views)
        return replace(self._spec, max_episode_steps=limit)

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec

    @property
    def state(self) -> State:
        """The current state.

        Raises:
            RobotouilleError: No episode has begun.
        """
        return self._play.state

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the numbers in a vector; see `Encoding.columns`."""
        return self._observer.layout.columns

    @property
    def world(self) -> World:
        """World of the current instance."""
        return self._play.view.world

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """Return the valid actions in the format of sb3-contrib's `MaskablePPO`.

        The masks of several players are concatenated.
        """
        return np.concatenate(self._masks()).view(np.bool_)

    def _masks(self) -> tuple[Mask, ...]:
        """Return the valid actions of each player, as far as the agent sees."""
        play = self._play
        return play.arrays.masks if self._seat is None else self._observer.masks(play)

    def _info(self, valid: bool) -> dict[str, Any]:
        masks = self._masks()
        mask = masks[0].copy() if self._alone else tuple(each.copy() for each in masks)
        return {"action_mask": mask, "valid": valid}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seed for the choice among `instances`; nothing else is random.
            options: `instance`: the name or number of the instance to play. `level`: the number of
                the level to play from now on.

        Raises:
            WrongArgumentError: The environment has no such instance or level.
        """
        super().reset(seed=seed)
        play = self._play
        play.begin(self.np_random, options)
        return self._observer.observe(play, self._seat), self._info(True)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take a step.

        Raises:
            WrongArgumentError: An action does not exist.
            InapplicableError: An action is not valid, and `invalid` is `raise`.
            RobotouilleError: The episode has ended, or none has begun.
        """
        play = self._play
        reward, terminated, truncated, valid = play.take((action,) if self._alone else action)
        observation = self._observer.observe(play, self._seat)
        return observation, reward, terminated, truncated, self._info(all(valid))

    def render(self) -> Any:
        """Return the state as text or as a picture, depending on `render_mode`.

        Raises:
            RobotouilleError: No episode has begun.
            MissingExtraError: Pictures need pygame, which is not installed.
        """
        if self.render_mode == "ansi":
            return self.state.text_view()
        if self.render_mode == "rgb_array":
            return picture(self.state, self._play.steps)
        return None
