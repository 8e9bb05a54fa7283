"""Inspect tasks, the solver that plays them, and a mock model.

Inspect loads this module through the entry point `robotouille`.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from inspect_ai import Task, task

# Inspect has no public error that it shows without a traceback.
from inspect_ai._util.error import PrerequisiteError
from inspect_ai.model import (
    ChatMessage,
    GenerateConfig,
    ModelAPI,
    ModelOutput,
    ModelUsage,
    get_model,
    modelapi,
)
from inspect_ai.scorer import Metric
from inspect_ai.solver import Generate, Solver, TaskState, solver
from inspect_ai.tool import ToolChoice, ToolInfo
from inspect_ai.util import LimitExceededError
from rich.markup import escape

from robotouille.errors import FileError, RobotouilleError
from robotouille.installation import VERSION
from robotouille.replay.compression import compress
from robotouille.terminal import options_from
from robotouille_evaluation.agents.making import PAPER_REACT, make_strategy
from robotouille_evaluation.inspect_tasks.samples import (
    METRICS,
    OUT,
    SHIFT_METRICS,
    STEPS_TO_GO_METRICS,
    ShiftTaskOptions,
    TaskOptions,
    TeamTaskOptions,
    keep_row,
    load_pack,
    of_distribution,
    outcome,
    samples,
)
from robotouille_evaluation.inspect_tasks.transcript import TranscriptWriter
from robotouille_evaluation.models import (
    Completion,
    InspectModel,
    Message,
    ModelError,
    ModelErrorKind,
    ModelRequest,
    ScriptedModel,
    SeededAnswers,
)
from robotouille_evaluation.runs import (
    AgentSpec,
    EpisodeJob,
    RecordedRunner,
    RunContext,
    RunFolder,
    play_job,
)
from robotouille_evaluation.runs.job_list import model_agent_name

__all__ = ["MockModel", "asynchronous", "multi_agent", "outcome", "play", "shifts", "synchronous"]


@task
@of_distribution
@options_from(TaskOptions)
def synchronous(options: TaskOptions) -> Task:
    """Return the tasks in which nothing takes time."""
    return _task("synchronous", options)


@task
@of_distribution
@options_from(TaskOptions)
def asynchronous(options: TaskOptions) -> Task:
    """Return the tasks in which cooking goes on while a robot does something else."""
    return _task("asynchronous", options)


@task
@of_distribution
@options_from(TeamTaskOptions)
def multi_agent(options: TeamTaskOptions) -> Task:
    """Return the tasks for several robots, each with an agent of its own, in lockstep."""
    return _task("multi_agent", options)


@task
@of_distribution
@options_from(ShiftTaskOptions)
def shifts(options: ShiftTaskOptions) -> Task:
    """Return the tasks whose orders arrive over time, with points instead of a goal."""
    return _task("shifts", options, SHIFT_METRICS)


class TaskOptionError(RobotouilleError, PrerequisiteError):
    """Wrong option of a task, which Inspect prints in a line instead of a traceback."""

    def __init__(self, message: str) -> None:
        RobotouilleError.__init__(self, message)
        # Inspect prints the message with Rich, for which brackets are markup.
        self.message = escape(message)


def _task(dataset: str, options: TaskOptions, metrics: dict[str, list[Metric]] = METRICS) -> Task:
    try:
        return _checked_task(dataset, options, metrics)
    except RobotouilleError as error:
        raise TaskOptionError(str(error)) from None


def _checked_task(dataset: str, options: TaskOptions, metrics: dict[str, list[Metric]]) -> Task:
    pack = load_pack(options.pack)
    return Task(
        dataset=samples(pack, dataset, options),
        solver=play(
            options.strategy, options.pack, options.pictures, options.steps_to_go, options.out
        ),
        scorer=outcome(),
        metrics=metrics | STEPS_TO_GO_METRICS if options.steps_to_go else metrics,
        # A model error ends its own episode, and the other episodes go on.
        fail_on_error=False,
        version=pack.version,
        metadata={
            "pack": {"name": pack.name, "version": pack.version, "digest": pack.digest},
            "strategy": options.strategy,
            "software": f"robotouille {VERSION}",
        },
    )


@modelapi(name="robotouille")
class MockModel(ModelAPI):
    """Inspect model with seeded answers, most of them valid actions.

    Args:
        model_name: Any name; it makes no difference.
        seed: Seed of all answers (`-M seed=1`).
    """

    def __init__(
        self,
        model_name: str,
        base_url: str | None = None,
        api_key: str | None = None,
        config: GenerateConfig | None = None,
        seed: int = 0,
        **model_args: Any,
    ) -> None:
        super().__init__(model_name, base_url, api_key, [], config or GenerateConfig())
        self._model = ScriptedModel(SeededAnswers(seed))

    async def generate(
        self,
        input: list[ChatMessage],
        tools: list[ToolInfo],
        tool_choice: ToolChoice,
        config: GenerateConfig,
    ) -> ModelOutput:
        """Return the answer to a conversation."""
        request = ModelRequest(tuple(Message(each.role, each.text) for each in input))
        answer = await self._model.complete(request)
        output = ModelOutput.from_content(self.model_name, answer.text)
        sent, received = answer.usage.prompt_tokens, answer.usage.completion_tokens
        output.usage = ModelUsage(
            input_tokens=sent, output_tokens=received, total_tokens=sent + received
        )
        return output


@solver
@of_distribution
def play(
    strategy: str = PAPER_REACT,
    pack: str = "",
    pictures: bool = True,
    steps_to_go: bool = False,
    out: str = OUT,
) -> Solver:
    """Return a solver that plays an episode as `robotouille benchmark run` does.

    Args:
        strategy: Built-in strategy, or the id of an experiment of the pack.
        pack: Folder of the task's pack.
        pictures: Show each state in the transcript.
        steps_to_go: Search how far the goal was at the end, which is slow.
        out: Folder in which each evaluation gets a folder for rows and recordings.

    Raises:
        UnknownNameError: The strategy is unknown.
    """
    loaded = load_pack(pack)
    make_strategy(loaded, strategy, loaded.datasets[0])
    run = f"{time.strftime('%Y%m%d-%H%M%S')}-{uuid4().hex[:6]}"

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        inspected = get_model()
        model = _SampleModel(InspectModel(inspected))
        job = _job(state, strategy, model.name, _sampling(inspected.config))
        folder = _SampleFolder(Path(out) / run, state.uuid)
        writer = TranscriptWriter(pictures=pictures)
        context = RunContext(run, loaded, folder, steps_to_go=steps_to_go)
        try:
            row = await play_job(job, context, model, writer.wrap)
        except asyncio.CancelledError:  # A time limit, or the user has stopped the evaluation.
            with suppress(FileError):
                recording = folder.keep(job, writer.runners, "broken off")
                _store(state, writer, model.name, recording)
            raise
        folder.add(row)
        keep_row(state, row)
        _store(state, writer, model.name, row.recording and folder.path / row.recording)
        # Last, so that Inspect has row and recording of a failed sample as well.
        model.raise_fault()
        if row.outcome.ended_by == "error" and not model.overflowed:
            raise RobotouilleError(row.error)
        return state

    return solve


SAMPLING = frozenset({"temperature", "top_p", "top_k", "max_tokens", "seed", "reasoning_effort"})
"""Settings of Inspect that decide how a model answers."""


def _sampling(config: GenerateConfig) -> dict[str, Any]:
    """Return the settings of a model that distinguish it from itself in another evaluation."""
    return config.model_dump(mode="json", exclude_none=True, include=set(SAMPLING))


def _job(state: TaskState, strategy: str, model: str, parameters: Mapping[str, Any]) -> EpisodeJob:
    agent = AgentSpec(
        name=model_agent_name(strategy, model, parameters),
        kind="model",
        strategy=strategy,
        model=model,
        parameters=dict(parameters),
    )
    about = state.metadata
    return EpisodeJob(
        agent=agent,
        instance=about["instance"],
        seats=about["seats"],
        seed=state.epoch - 1,
        budget=about["budget"]["rule"],
        variant=about["variant"],
    )


def _store(
    state: TaskState, writer: TranscriptWriter, model: str, recording: Path | str | None
) -> None:
    """Store the conversation and the path of the recording in the sample."""
    if recording:
        state.metadata["recording"] = str(recording)
    if writer.exchanges:
        state.messages = writer.messages()
        state.output = ModelOutput.from_content(model, state.messages[-1].text)


class _SampleFolder(RunFolder):
    """Run folder whose files are named by Inspect's sample id, which is new for each play.

    A sample that is played again must not be answered from the journal of its last play.
    """

    def __init__(self, path: Path, sample: str) -> None:
        super().__init__(path)
        self._sample = sample

    def calls(self, job: EpisodeJob, player: str) -> Path:
        """Return the file for the paid calls of one player."""
        return self.path / "calls" / f"{self._sample}-{player}.jsonl"

    def recording(self, job: EpisodeJob, trial: int = 1) -> Path:
        """Return the file for the recording of a trial."""
        suffix = "" if trial == 1 else f"-trial{trial}"
        return self.path / "recordings" / f"{self._sample}{suffix}.rbt"

    def keep(self, job: EpisodeJob, runners: Sequence[RecordedRunner], why: str) -> Path | None:
        """Write the recordings of an episode without a row, and return the last path."""
        path = None
        for trial, runner in enumerate(runners, start=1):
            path = self.recording(job, trial)
            self.write(path, compress(runner.recording(why)))
        return path


class _SampleModel:
    """Model of one episode that keeps the error that ended it.

    The row describes the error in words. Inspect also needs the exception: it scores samples whose
    limit is used up, and `--retry-on-error` or `eval-retry` plays samples with errors again. A
    conversation that is too long for the model is a failure and not an error.
    """

    def __init__(self, model: InspectModel) -> None:
        self.name = model.name
        self.overflowed = False
        self._model = model
        self._fault: Exception | None = None

    async def complete(self, request: ModelRequest) -> Completion:
        """Return the model's answer. Raise RobotouilleError if a limit is used up."""
        try:
            completion = await self._model.complete(request)
        except LimitExceededError as limit:
            self._fault = limit
            raise RobotouilleError(limit.message) from None
        except ModelError as error:
            if error.kind is ModelErrorKind.CONTEXT_OVERFLOW:
                self.overflowed = True
            elif error.kind is not ModelErrorKind.EMPTY:
                self._fault = error
            raise
        self.overflowed = False  # The strategy's shorter request fitted.
        return completion

    def raise_fault(self) -> None:
        """Raise the error that ended the episode, if any, without a cause that may contain keys."""
        if self._fault is not None:
            raise self._fault from None
