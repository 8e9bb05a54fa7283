"""Environments for reinforcement learning: Gymnasium and PettingZoo (docs/train.md; extra `rl`).

import gymnasium
import robotouille.envs  # registers robotouille/synchronous-01-v0 and the others

env = gymnasium.make("robotouille/synchronous-01-v0")
"""

from __future__ import annotations

from robotouille.errors import MissingExtraError

try:
    import gymnasium as _gymnasium
    import numpy as _numpy
    import pettingzoo as _pettingzoo
except ImportError:
    raise MissingExtraError("robotouille.envs", "rl") from None

from robotouille.envs.gymnasium_env import RobotouilleEnv, env_id, register_envs
from robotouille.envs.levels import Level
from robotouille.envs.pettingzoo_env import RobotouilleParallelEnv, aec_env, parallel_env
from robotouille.envs.potential import StepsToGoPotential
from robotouille.envs.rules import (
    EnvObservation,
    EnvOptions,
    InvalidAction,
    Perspective,
    Reward,
)
from robotouille.envs.vector_env import RobotouilleVectorEnv

__all__ = [
    "EnvObservation",
    "EnvOptions",
    "InvalidAction",
    "Level",
    "Perspective",
    "Reward",
    "RobotouilleEnv",
    "RobotouilleParallelEnv",
    "RobotouilleVectorEnv",
    "StepsToGoPotential",
    "aec_env",
    "env_id",
    "parallel_env",
    "register_envs",
]

del _gymnasium, _numpy, _pettingzoo

register_envs()
