"""The environment: a data set, and one agent that plays it in this process."""

from __future__ import annotations

from collections.abc import Sequence

import verifiers.v1 as vf

from robotouille_evaluation.agents.team import Control
from robotouille_evaluation.text_games import CONVERSATION, Split
from robotouille_verifiers.harness import RobotouilleHarnessConfig
from robotouille_verifiers.taskset import Dataset, RobotouilleTask, RobotouilleTasksetConfig

ID = "robotouille-verifiers"
"""Name under which verifiers finds this package."""


class RobotouilleEnvConfig(vf.EnvConfig):
    """Environment with one agent, which needs no sandbox."""

    agent: vf.AgentConfig = vf.AgentConfig(
        harness=RobotouilleHarnessConfig(id=ID), runtime=vf.SubprocessConfig()
    )


class RobotouilleEnv(vf.Env[RobotouilleEnvConfig]):
    """Environment in which one model plays each game, with all seats or with partners."""

    async def run(self, task: RobotouilleTask, agents: vf.Agents) -> None:
        """Play one game."""
        await agents.agent.run(task)


def load_environment(
    dataset: Dataset = "synchronous",
    split: Split = "test",
    *,
    agent: str = CONVERSATION,
    tasks: Sequence[str] = (),
    seats: int | None = None,
    control: Control = "turns",
    partner: str = "",
) -> RobotouilleEnv:
    """Return the environment of a data set.

    Args:
        split: `test` for the instances of the benchmark, `train` for endless other ones.
        agent: Strategy that asks the model, such as `react-full`.
        tasks: Tasks by number or dish; all if empty.
        seats: Number of players; by default, the task's.
        control: Way to ask one model for several players: `turns`, `joint` or `each`.
        partner: `planner` for planner partners; empty if the model plays all seats.

    Raises:
        ValueError: An argument is unknown.
    """
    taskset = RobotouilleTasksetConfig(
        id=ID, dataset=dataset, split=split, tasks=list(tasks), seats=seats
    )
    harness = RobotouilleHarnessConfig(id=ID, agent=agent, control=control, partner=partner)
    player = vf.AgentConfig(harness=harness, runtime=vf.SubprocessConfig())
    return RobotouilleEnv(RobotouilleEnvConfig(taskset=taskset, agent=player))
