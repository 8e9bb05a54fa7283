"""Many copies of a kitchen in one process as a vector environment of Stable-Baselines3.

pip install '.[rl,fast]' && pip install --group rl-example
python examples/learning/vec_env.py [--task TASK] [--steps N] [--copies N]

`KitchenVecEnv` steps all copies at once in the batch engine, where `DummyVecEnv` steps one after
another. It works with the algorithms of Stable-Baselines3 and with sb3-contrib's `MaskablePPO`.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from robotouille.envs import RobotouilleVectorEnv


class KitchenVecEnv(VecEnv):
    """Copies of a task that start their next episode in the step that ends one.

    Args:
        task: A task, or a name for `load_task`.
        copies: Number of copies.
        seed: Seed of the first copy; the others count up.
        options: Options of `RobotouilleVectorEnv`.
    """

    def __init__(self, task: Any, copies: int, *, seed: int | None = None, **options: Any) -> None:
        self.envs = RobotouilleVectorEnv(task, copies, autoreset_mode="SameStep", **options)
        self.render_mode = None
        self._seed = seed
        self._actions: Any = None
        super().__init__(copies, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        """Begin an episode in each copy."""
        seen, _ = self.envs.reset(seed=self._seed)
        self._seed = None
        return seen

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Set the seed of the next reset."""
        self._seed = seed
        return [None if seed is None else seed + i for i in range(self.num_envs)]

    def step_async(self, actions: Any) -> None:
        """Store the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Take a step, and return the last observation of each ended episode in its info."""
        seen, rewards, terminated, truncated, found = self.envs.step(self._actions)
        dones = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for copy in np.flatnonzero(dones).tolist():
            infos[copy] = {
                "terminal_observation": found["final_obs"][copy],
                "TimeLimit.truncated": bool(truncated[copy]),
            }
        return seen.copy(), rewards.astype(np.float32), dones, infos

    def action_masks(self) -> Any:
        """Return the valid actions of each copy."""
        return self.envs.action_masks().astype(np.bool_)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of this object for each copy."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse to change copies, which share all attributes."""
        raise AttributeError(f"copies share their attributes: {attr_name}")

    def env_method(self, name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Return a row of the result of a method for each copy, as `MaskablePPO` expects."""
        rows = getattr(self, name)(*args, **kwargs)
        return [rows[i] for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each copy."""
        return [False for _ in self._get_indices(indices)]

    def close(self) -> None:
        """Do nothing: the copies hold no resources."""


def learn(task: str, steps: int, copies: int, seed: int = 0) -> Any:
    """Return a policy after some steps of training."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.vec_env import VecMonitor

    envs = VecMonitor(KitchenVecEnv(task, copies, max_steps=60))
    model = MaskablePPO(
        "MlpPolicy", envs, n_steps=32, batch_size=512, gamma=0.97, ent_coef=0.01, seed=seed
    )
    return model.learn(steps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--task", default="synchronous/01")
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--copies", type=int, default=64)
    options = parser.parse_args()
    began = time.perf_counter()
    model = learn(options.task, options.steps, options.copies)
    seconds = time.perf_counter() - began
    last = [episode["r"] for episode in model.ep_info_buffer]
    print(f"{model.num_timesteps} steps in {seconds:.0f} s: goal {np.mean(last):.0%}")


if __name__ == "__main__":
    main()
