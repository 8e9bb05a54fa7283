"""Learn a policy from recordings by behaviour cloning, with NumPy only.

python examples/learning/imitate.py [--task TASK] [RECORDING.rbt …]

Without recordings, the planner bot first plays and records some episodes. It takes random actions
now and then, so that the recordings cover more states than one plan. The policy is a softmax over
the valid actions, linear in the state's vector. It imitates planned actions only.
"""

from __future__ import annotations

import argparse
import random

import numpy as np

from robotouille import World
from robotouille.envs import RobotouilleEnv
from robotouille.episode import ActionRequest, Episode, Rules
from robotouille.planning import AnytimePlanner
from robotouille.planning.policies import PlannerPolicy
from robotouille.replay import Recording, read_recording
from robotouille.replay.recorder import Recorder, header

PLANNED = "planned"


def record(planner: AnytimePlanner, seed: int, slips: float = 0.3) -> Recording:
    """Record an episode of the planner bot, which takes random actions with probability `slips`."""
    world, rules, dice = planner.model, Rules(max_steps=100), random.Random(seed)
    player = world.players[0]
    episode, recorder = Episode(world, rules), Recorder(world)
    stream = recorder.begin(header(world.task, rules, episode=f"lesson-{seed}"))
    episode.join(player, "planner", "bot", now=0.0)
    for step in range(rules.max_steps):
        bot = PlannerPolicy(world, player, anytime=planner)
        action, why = bot.act(episode.state), PLANNED
        if dice.random() < slips:
            action, why = dice.choice(episode.state.actions(player)), "a slip"
        episode.submit(player, ActionRequest(step + 1, action, reasoning=why), float(step))
        if episode.outcome is not None:
            break
    return Recording(stream + recorder.record(episode.events()))


def lessons(recordings: list[Recording]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return state vectors, action masks, and the indices of the chosen actions."""
    rows = [
        (move.state.vector(), move.state.mask(move.seat), move.state.action_number(move.action))
        for recording in recordings
        for move in recording.transitions()
        if move.valid and move.action is not None and move.reasoning in (PLANNED, "")
    ]
    vectors, masks, numbers = zip(*rows, strict=True)
    return np.array(vectors), np.array(masks), np.array(numbers)


def imitate(recordings: list[Recording], rounds: int = 300, rate: float = 1.0) -> np.ndarray:
    """Fit weights by logistic regression over the valid actions, with gradient descent."""
    vectors, masks, numbers = lessons(recordings)
    vectors = np.column_stack([vectors, np.ones(len(vectors))])
    chosen = np.eye(masks.shape[1])[numbers]
    weights = np.zeros((vectors.shape[1], masks.shape[1]))
    for _ in range(rounds):
        scores = np.where(masks, vectors @ weights, -np.inf)
        shares = np.exp(scores - scores.max(axis=1, keepdims=True))
        shares /= shares.sum(axis=1, keepdims=True)
        weights += rate * vectors.T @ (chosen - shares) / len(vectors)
    return weights


def play(weights: np.ndarray, task: str, max_steps: int = 60) -> tuple[bool, int]:
    """Play an episode; return whether the policy reached the goal, and the number of steps."""
    env = RobotouilleEnv(task, max_steps=max_steps)
    vector, info = env.reset()
    reached, truncated, step = False, False, 0
    while not (reached or truncated):
        scores = np.append(vector, 1.0) @ weights
        action = int(np.where(info["action_mask"], scores, -np.inf).argmax())
        vector, _, reached, truncated, info = env.step(action)
        step += 1
    return reached, step


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--task", default="synchronous/01")
    parser.add_argument("recordings", nargs="*")
    asked = parser.parse_args()
    planner = AnytimePlanner(World(asked.task))
    given = [read_recording(path) for path in asked.recordings]
    recordings = given or [record(planner, seed) for seed in range(40)]
    measures = [recording.measures() for recording in recordings]
    print(f"{len(recordings)} recordings, {sum(m.success for m in measures)} reach the goal")
    reached, steps = play(imitate(recordings), asked.task)
    print(f"the policy {'reached' if reached else 'did not reach'} the goal in {steps} steps")
