"""Names for `gymnasium.make` and `pettingzoo.make`."""

from __future__ import annotations

import pettingzoo
from gymnasium.envs.registration import register, registry

from robotouille.domain.loading import task_names

__all__ = ["env_id", "register_envs"]

VERSION = 0
"""Of what environments mean: another one if the same actions come to something else."""


def env_id(task: str) -> str:
    """The name of a shipped task's environment: `robotouille/synchronous-01-v0`."""
    folder, _, file = task.rpartition("/")
    number = file.partition("_")[0]
    return f"robotouille/{folder}-{number if number.isdigit() else file}-v{VERSION}"


def register_envs() -> None:
    """Register all shipped tasks with Gymnasium, and with PettingZoo where it has a registry (from
    1.27 on); importing `robotouille.envs` does it.

    Gymnasium's wrappers that only check are left out: `RobotouilleEnv` checks for itself.
    """
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
