"""Train a policy on synchronous/01 by proximal policy optimisation with action masks.

pip install '.[rl]' && pip install --group rl-example
python examples/learning/ppo.py [--task TASK] [--steps N] [--reward sparse] [--curve FILE.png]

Every few thousand steps the policy plays 20 episodes. The curve shows the share of these episodes
that reach the goal.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_util import make_vec_env

from robotouille.envs import RobotouilleEnv

PARALLEL, ROUND, EPISODES, MAX_STEPS, GAMMA = 8, 4096, 20, 60, 0.97


def evaluate(model: MaskablePPO, task: str) -> tuple[float, float]:
    """Return the share of episodes that reach the goal, and their mean length."""
    env, lengths = RobotouilleEnv(task, max_steps=MAX_STEPS), []
    for seed in range(EPISODES):
        observation, _ = env.reset(seed=seed)
        for step in range(1, MAX_STEPS + 1):
            action, _ = model.predict(observation, action_masks=env.action_masks())
            observation, _, reached, truncated, _ = env.step(action)
            if reached:
                lengths.append(step)
            if reached or truncated:
                break
    return len(lengths) / EPISODES, float(np.mean(lengths)) if lengths else float("nan")


def learn(task: str, steps: int, reward: str, seed: int = 0) -> list[tuple[int, float, float]]:
    """Train; return rows of steps taken, share of episodes at the goal, and their mean length."""
    options = {"task": task, "max_steps": MAX_STEPS, "reward": reward, "gamma": GAMMA}
    envs = make_vec_env(RobotouilleEnv, PARALLEL, seed=seed, env_kwargs=options)
    hyper = {"n_steps": 256, "batch_size": 512, "n_epochs": 6, "learning_rate": 1e-3}
    model = MaskablePPO("MlpPolicy", envs, gamma=GAMMA, ent_coef=0.01, seed=seed, **hyper)
    rows, began = [(0, *evaluate(model, task))], time.perf_counter()
    while rows[-1][0] < steps:
        model.learn(ROUND, reset_num_timesteps=False)
        rows.append((model.num_timesteps, *evaluate(model, task)))
        taken, reached, length = rows[-1]
        seconds = time.perf_counter() - began
        print(f"{taken:7} steps, {seconds:4.0f} s: goal {reached:4.0%}, {length:4.1f} steps each")
    return rows


def draw(rows: list[tuple[int, float, float]], path: str, title: str) -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 3.2), layout="constrained")
    axes.plot([row[0] for row in rows], [100 * row[1] for row in rows], marker=".")
    axes.set(xlabel="environment steps", ylabel="episodes at the goal, %", title=title)
    axes.set_ylim(-3, 103)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--task", default="synchronous/01")
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--reward", default="sparse")
    parser.add_argument("--curve")
    asked = parser.parse_args()
    rows = learn(asked.task, asked.steps, asked.reward)
    if asked.curve:
        draw(rows, asked.curve, f"MaskablePPO on {asked.task}, {asked.reward} reward")
