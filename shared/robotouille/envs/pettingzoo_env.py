"""A kitchen as a PettingZoo environment with one agent per player."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Unpack, cast

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import parallel_to_aec

from robotouille.domain.task import Task
from robotouille.envs.layout import SILENCE
from robotouille.envs.observers import observer_of
from robotouille.envs.play import Play
from robotouille.envs.rules import (
    NOTHING,
    RENDER_MODES,
    EnvOptions,
    EnvRules,
    Perspective,
    check_render_mode,
)
from robotouille.envs.views import Mask, largest_team, picture, vector_space
from robotouille.errors import WrongArgumentError
from robotouille.world.world import State, World


class RobotouilleParallelEnv(ParallelEnv[str, Any, Any]):  # type: ignore[misc]
    """One agent per player of a task. All agents act in each step, in the order of seats.

    Arguments, actions and rewards are those of `RobotouilleEnv`. Observations also show which
    player is the agent's own: see `Perspective`. All agents get the same reward. Each agent's
    `info` contains `action_mask` and `valid`. An agent without an action, or with None or
    -1, does nothing. With `tokens`, an action is a pair of its number and a message.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "robotouille_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": 4,
        "is_parallelizable": True,
    }

    def __init__(
        self, task: Task | str, *, render_mode: str | None = None, **options: Unpack[EnvOptions]
    ) -> None:
        check_render_mode(render_mode)
        rules = EnvRules.of(task, options)
        self._play = Play(rules)
        alone = len(largest_team(self._play.views)) == 1
        default = Perspective.SHARED if alone else Perspective.IDENTITY
        perspective = Perspective(rules.perspective or default)
        self._observer = observer_of(rules, self._play.views, perspective)
        self._random = np.random.default_rng()
        self._tokens = rules.tokens
        self._said: list[int] = []
        self.render_mode = render_mode
        self.possible_agents = list(largest_team(self._play.views))
        self.agents: list[str] = []
        self._seat = {player: i for i, player in enumerate(self.possible_agents)}
        view = self._play.view
        self.observation_spaces = {
            player: self._observer.space() for player in self.possible_agents
        }
        self.action_spaces = {
            player: _action_space(count, rules.tokens)
            for player, count in zip(self.possible_agents, view.sizes.actions, strict=True)
        }
        self.state_space = vector_space(view.sizes)

    def observation_space(self, agent: str) -> gymnasium.Space[Any]:
        """Return an agent's observation space, which is always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.Space[Any]:
        """Return an agent's action space, which is always the same object."""
        return self.action_spaces[agent]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the numbers in each agent's vector; see `Encoding.columns`.

        If the perspective is egocentric, the first player stands for the agent's own.
        """
        return self._observer.layout.columns

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the numbers of a graph's node; see `Encoding.features`."""
        return self._observer.layout.features

    @property
    def world(self) -> World:
        """World of the current instance."""
        return self._play.view.world

    @property
    def world_state(self) -> State:
        """The current state of the world.

        Raises:
            RobotouilleError: No episode has begun.
        """
        return self._play.state

    def state(self) -> npt.NDArray[np.float32]:
        """Return the current state as a vector, whatever the agents observe."""
        return self._play.arrays.vector.copy()

    def action_mask(self, agent: str) -> Mask:
        """Return the actions of an agent that are valid for all that it sees."""
        return self._observer.masks(self._play)[self._seat[agent]].copy()

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode: see `RobotouilleEnv.reset`."""
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._play.begin(self._random, options)
        self.agents = list(self._play.players)
        self._said = [SILENCE] * len(self.agents)
        valid = (True,) * len(self.agents)
        return self._observations(), self._infos(valid)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Take a step.

        Raises:
            WrongArgumentError: An action or agent does not exist.
            InapplicableError: An action is not valid, and `invalid` is `raise`.
        """
        players = self.agents
        if not players:
            return {}, {}, {}, {}, {}
        if not actions.keys() <= self._seat.keys():
            wrong = sorted(actions.keys() - self._seat.keys())
            raise WrongArgumentError(f"no agent {wrong[0]!r}; there are {', '.join(players)}")
        numbers = [actions.get(player) for player in players]
        if self._tokens:
            numbers, self._said = self._spoken(numbers)
        reward, terminated, truncated, valid = self._play.take(numbers)
        observations, infos = self._observations(), self._infos(valid)
        if terminated or truncated:
            self.agents = []
        return (
            observations,
            dict.fromkeys(players, reward),
            dict.fromkeys(players, terminated),
            dict.fromkeys(players, truncated),
            infos,
        )

    def _spoken(self, chosen: Sequence[Any]) -> tuple[list[Any], list[int]]:
        """Return the numbers of actions, and the messages that come with them.

        Raises:
            WrongArgumentError: A message is missing or does not exist.
        """
        pairs = [(NOTHING, SILENCE) if each is None else each for each in chosen]
        for player, pair in zip(self.agents, pairs, strict=True):
            if np.shape(pair) != (2,) or pair[1] not in range(self._tokens + 1):
                raise WrongArgumentError(
                    f"{player}: expected an action and a message from 0 to {self._tokens}, "
                    f"found {pair!r}"
                )
        return [action for action, _ in pairs], [int(message) for _, message in pairs]

    def _observations(self) -> dict[str, Any]:
        observations = self._observer.observe_all(self._play, self._said)
        return dict(zip(self.agents, observations, strict=True))

    def _infos(self, valid: Sequence[bool]) -> dict[str, dict[str, Any]]:
        masks = self._observer.masks(self._play)
        infos: dict[str, dict[str, Any]] = {
            player: {"action_mask": mask.copy(), "valid": fine}
            for player, mask, fine in zip(self.agents, masks, valid, strict=True)
        }
        if self._tokens:
            for info in infos.values():
                messages = np.ones(self._tokens + 1, dtype=np.int8)
                info["action_mask"] = info["action_mask"], messages
        return infos

    def render(self) -> Any:
        """Return the state as text or as a picture, depending on `render_mode`.

        Raises:
            RobotouilleError: No episode has begun.
            MissingExtraError: Pictures need pygame, which is not installed.
        """
        if self.render_mode == "ansi":
            return self.world_state.text_view()
        if self.render_mode == "rgb_array":
            return picture(self.world_state, self._play.steps)
        return None

    def close(self) -> None:
        """Do nothing: the environment holds no resources."""


def _action_space(actions: int, tokens: int) -> gymnasium.Space[Any]:
    space = spaces.MultiDiscrete([actions, tokens + 1]) if tokens else spaces.Discrete(actions)
    return cast("gymnasium.Space[Any]", space)


def parallel_env(
    task: Task | str, *, render_mode: str | None = None, **options: Unpack[EnvOptions]
) -> RobotouilleParallelEnv:
    """Return an environment in which all agents act at once: see `RobotouilleParallelEnv`."""
    return RobotouilleParallelEnv(task, render_mode=render_mode, **options)


def aec_env(
    task: Task | str, *, render_mode: str | None = None, **options: Unpack[EnvOptions]
) -> AECEnv[str, Any, Any]:
    """Return an environment in which agents act in turn: see `RobotouilleParallelEnv`.

    A step is taken after all agents have chosen (PettingZoo's wrapper).
    """
    return cast(
        "AECEnv[str, Any, Any]",
        parallel_to_aec(RobotouilleParallelEnv(task, render_mode=render_mode, **options)),
    )
