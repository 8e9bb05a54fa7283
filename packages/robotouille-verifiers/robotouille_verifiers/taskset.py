"""Data sets of instances as tasks of verifiers, with the rewards of a game."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import verifiers.v1 as vf
from pydantic import Field, model_validator

from robotouille.errors import RobotouilleError
from robotouille_evaluation.text_games import Instances, Split, load_instance

SCORE = "robotouille"
"""Key of a game's score in the information of a trace."""

Dataset = Literal["synchronous", "asynchronous", "multi_agent", "shifts"]


class RobotouilleData(vf.TaskData):
    """Instance of a task, by its name for `load_instance`."""

    instance: str
    seats: int | None = None


class RobotouilleTask(vf.Task[RobotouilleData, vf.State, vf.TaskConfig]):
    """One game. Its rewards are weighted and added; `--env.taskset.task.rewards` changes them."""

    @property
    def key(self) -> str:
        """Identity of the game, which does not depend on its place in a data set."""
        return f"{self.data.instance}@{self.data.seats or 'default'}"

    @vf.reward(weight=1.0)
    async def outcome(self, trace: vf.Trace) -> dict[str, float]:
        """Return the success of a task with a goal, or the share of points of a shift."""
        score = _score(trace)
        if score["points"] is None:
            return {"success": float(score["success"])}
        return {"share": score["share"] or 0.0}

    @vf.reward(weight=0.5)
    async def optimality(self, trace: vf.Trace) -> dict[str, float]:
        """Return fewest steps / steps, and 0 for a failure; nothing without a proven optimum."""
        return _known("optimality", _score(trace))

    @vf.reward(weight=0.25)
    async def progress(self, trace: vf.Trace) -> dict[str, float]:
        """Return 1 - steps to go / steps to go at first: 1 at the goal, 0 without progress."""
        return _known("progress", _score(trace))

    @vf.reward(weight=0.1)
    async def format(self, trace: vf.Trace) -> float:
        """Return the share of the answers that name an action of the task."""
        return float(_score(trace)["format"])

    @vf.metric
    async def counts(self, trace: vf.Trace) -> dict[str, float]:
        """Return the counts of a game and the optimum, if it is proven."""
        score = _score(trace)
        names = ("steps", "optimum", "points", "answers", "invalid", "malformed")
        return {name: float(score[name]) for name in names if score[name] is not None}


def _score(trace: vf.Trace) -> Mapping[str, Any]:
    score: Mapping[str, Any] | None = trace.info.get(SCORE)
    if score is None:
        raise ValueError("no game was played; use the harness robotouille-verifiers")
    return score


def _known(name: str, score: Mapping[str, Any]) -> dict[str, float]:
    return {} if score[name] is None else {name: float(score[name])}


class RobotouilleTasksetConfig(vf.TasksetConfig):
    """Choice of instances (`--env.taskset.NAME`)."""

    dataset: Dataset = "synchronous"
    split: Split = "test"
    """`test`: the instances of the benchmark. `train`: endless other ones, so limit them (`-n`)."""
    tasks: list[str] = Field(default_factory=list)
    """Tasks of the data set by number or dish; all if empty."""
    seats: int | None = None
    """Number of players; by default, the task's."""

    @model_validator(mode="after")
    def _tasks_exist(self) -> RobotouilleTasksetConfig:
        try:
            Instances(self.dataset, self.split, self.tasks)
        except RobotouilleError as error:
            raise ValueError(str(error)) from None
        return self


class RobotouilleTaskset(vf.Taskset[RobotouilleTask, RobotouilleTasksetConfig]):
    """Instances of a data set. Those of the split `train` are endless."""

    def __init__(self, config: RobotouilleTasksetConfig) -> None:
        super().__init__(config)
        self._instances = Instances(config.dataset, config.split, config.tasks)
        self.INFINITE = self._instances.endless

    def load(self) -> Iterator[RobotouilleTask]:
        """Yield the games. A new instance takes up to a second to generate."""
        for name in self._instances:
            instance = load_instance(name, self.config.seats)
            data = RobotouilleData(
                id=name,
                name=name,
                prompt=instance.task.goal_description,
                instance=name,
                seats=self.config.seats,
            )
            yield RobotouilleTask(data, self.config.task)
