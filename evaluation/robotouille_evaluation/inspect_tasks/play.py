"""Episodes as a solver: the runs' own code plays, and asks whatever model Inspect was given."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from inspect_ai.model import ModelOutput, get_model
from inspect_ai.solver import Generate, Solver, TaskState, solver
from inspect_ai.util import LimitExceededError

from robotouille.errors import FileError, RobotouilleError
from robotouille.replay.container import compress
from robotouille_evaluation.agents.making import make_strategy
from robotouille_evaluation.inspect_tasks.naming import of_distribution
from robotouille_evaluation.inspect_tasks.samples import load_pack
from robotouille_evaluation.inspect_tasks.scores import keep_row
from robotouille_evaluation.inspect_tasks.telling import EpisodeTelling
from robotouille_evaluation.models import (
    Completion,
    InspectModel,
    ModelError,
    ModelErrorKind,
    ModelRequest,
)
from robotouille_evaluation.runs import AgentSpec, Job, RecordedStage, RunFolder, play_job

__all__ = ["OUT", "STRATEGY", "play"]

OUT = "runs/inspect"
STRATEGY = "react-last-reasoning-action"


@solver
@of_distribution
def play(
    strategy: str = STRATEGY,
    pack: str = "",
    pictures: bool = True,
    steps_to_go: bool = False,
    out: str = OUT,
) -> Solver:
    """Play a sample's episode as `robotouille benchmark run` does, and keep row and recording.

    Args:
        strategy: One of ours, or the id of an experiment of the pack.
        pack: Its folder; that of the task.
        pictures: Whether the transcript shows each state.
        steps_to_go: Whether it is measured how far from the goal an episode ended: slow.
        out: Where a folder is made for rows and recordings of one evaluation.

    Raises:
        UnknownNameError: There is no such strategy.
    """
    loaded = load_pack(pack)
    make_strategy(loaded, strategy, loaded.datasets[0])
    run = f"{time.strftime('%Y%m%d-%H%M%S')}-{uuid4().hex[:6]}"

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        model = _SampleModel(InspectModel(get_model()))
        job = _job(state, strategy, model.name)
        folder = _SampleFolder(Path(out) / run, state.uuid)
        telling = EpisodeTelling(pictures=pictures)
        try:
            row = await play_job(
                job,
                run,
                loaded,
                folder,
                model,
                time.perf_counter,
                steps_to_go=steps_to_go,
                watch=telling.watch,
            )
        except asyncio.CancelledError:  # The time is over, or somebody has stopped it.
            with suppress(FileError):
                recording = folder.keep(job, telling.stages, "broken off")
                _tell(state, telling, model.name, recording)
            raise
        folder.add(row)
        keep_row(state, row)
        _tell(state, telling, model.name, row.recording and folder.path / row.recording)
        model.raise_fault()
        if row.outcome.ended_by == "error" and not model.overflowed:
            raise RobotouilleError(row.error)
        return state

    return solve


def _job(state: TaskState, strategy: str, model: str) -> Job:
    agent = AgentSpec(name=f"{strategy} ({model})", kind="model", strategy=strategy, model=model)
    about = state.metadata
    return Job(
        agent=agent,
        instance=about["instance"],
        seats=about["seats"],
        seed=state.epoch - 1,
        budget=about["budget"]["rule"],
    )


def _tell(
    state: TaskState, telling: EpisodeTelling, model: str, recording: Path | str | None
) -> None:
    """What was played, in what Inspect keeps of a sample."""
    if recording:
        state.metadata["recording"] = str(recording)
    if telling.exchanges:
        state.messages = telling.messages()
        state.output = ModelOutput.from_content(model, state.messages[-1].text)


class _SampleFolder(RunFolder):
    """A run's folder in which files are called as Inspect calls the sample, once for each time it
    is played: what was answered then is no answer now."""

    def __init__(self, path: Path, sample: str) -> None:
        super().__init__(path)
        self._sample = sample

    def calls(self, job: Job, player: str) -> Path:
        """The file of the paid calls of one player."""
        return self.path / "calls" / f"{self._sample}-{player}.jsonl"

    def recording(self, job: Job, trial: int = 1) -> Path:
        """The file of a trial's recording."""
        suffix = "" if trial == 1 else f"-trial{trial}"
        return self.path / "recordings" / f"{self._sample}{suffix}.rbt"

    def keep(self, job: Job, stages: Sequence[RecordedStage], why: str) -> Path | None:
        """Write the recordings of an episode that has no row; the path of the last."""
        path = None
        for trial, stage in enumerate(stages, start=1):
            path = self.recording(job, trial)
            self.write(path, compress(stage.recording(why)))
        return path


class _SampleModel:
    """The model of one episode, which remembers why it ended it.

    A row says that in words. Inspect has to be told as well: a limit that is used up is scored, a
    provider that fails is an error of the sample, which `--retry-on-error` or `eval-retry` plays
    again. A conversation that is too long for the model is neither, but a failure.
    """

    def __init__(self, model: InspectModel) -> None:
        self.name = model.name
        self.overflowed = False
        self._model = model
        self._fault: Exception | None = None

    async def complete(self, request: ModelRequest) -> Completion:
        """The model's answer. Raises ModelError, or RobotouilleError where a limit is used up."""
        try:
            completion = await self._model.complete(request)
        except LimitExceededError as limit:
            self._fault = limit
            raise RobotouilleError(limit.message) from None
        except ModelError as error:
            if error.kind is ModelErrorKind.CONTEXT_OVERFLOW:
                self.overflowed = True
            elif error.kind not in (ModelErrorKind.EMPTY, ModelErrorKind.TOO_LONG):
                self._fault = error
            raise
        self.overflowed = False  # A shorter request was not too long.
        return completion

    def raise_fault(self) -> None:
        """Raise what ended the episode, if something did; without what the provider has said, in
        which there may be keys."""
        if self._fault is not None:
            raise self._fault from None
