"""Playing one job to its end, with a row and recordings even if something fails."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robotouille import World
from robotouille.errors import FileError, RobotouilleError
from robotouille.planning import StepsToGo
from robotouille.replay.compression import compress
from robotouille.replay.recording import Recording
from robotouille_evaluation.agents.proposal import Complete, ContextOverflow, answer_all
from robotouille_evaluation.metrics.measuring import measure
from robotouille_evaluation.metrics.outcomes import repeated_transitions, score
from robotouille_evaluation.metrics.rows import (
    MAX_NAME,
    BudgetRow,
    Counts,
    EpisodeMeasures,
    Optimum,
    PackId,
    RealTimeRow,
    Result,
    ResultRow,
    ScoreRow,
    TotalUsage,
)
from robotouille_evaluation.metrics.trajectory import Trajectory
from robotouille_evaluation.models import Model, Usage
from robotouille_evaluation.models.model import NOTHING
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.realtime import Charge, RealTimeSeat
from robotouille_evaluation.runs.chance import reversal_of
from robotouille_evaluation.runs.episode_runner import (
    EpisodeRunner,
    RecordedRunner,
    RunnerWrapper,
    episode_rules,
)
from robotouille_evaluation.runs.folder import RunFolder
from robotouille_evaluation.runs.job_agents import JobAgents
from robotouille_evaluation.runs.job_list import EpisodeJob, RealTime
from robotouille_evaluation.runs.journal import CallJournal, asking_once
from robotouille_evaluation.runs.real_time_episode import RealTimeEpisode
from robotouille_evaluation.runs.text_episode import (
    TeamResult,
    TextEpisode,
    TextEpisodeResult,
    play_team,
)

MAX_ERROR = 10_000
"""Characters of an error that a row keeps. Files with too long rows cannot be read."""
MAX_WORLDS = 16
"""Maximum number of worlds that a process keeps for later episodes."""


@dataclass(frozen=True, slots=True)
class RunContext:
    """Context that all jobs of a run share.

    Args:
        run: Name of the run, for the rows.
        clock: Clock in seconds, for the rows' `seconds`.
        steps_to_go: True to search how far the goal was at the end, which is slow.
    """

    run: str
    pack: Pack
    folder: RunFolder
    clock: Callable[[], float] = time.perf_counter
    steps_to_go: bool = False


async def play_job(
    job: EpisodeJob,
    context: RunContext,
    model: Model | None = None,
    wrap: RunnerWrapper | None = None,
) -> ResultRow:
    """Play a job and write its recordings.

    A failure of the model or the disk ends the episode, and the row contains the error.

    Args:
        model: Model of the agent, if it needs one.
        wrap: Wraps the runner of each trial.

    Raises:
        RobotouilleError: The job does not belong to the pack.
    """
    begun = context.clock()
    episode = _JobEpisode(job, context, wrap)
    result, error = await episode.attempt(model)
    episode.finish_shift()
    recordings = [runner.recording(error or "the agent is done") for runner in episode.runners]
    measured = _measure(recordings, episode, context)
    try:
        recording = _write(context.folder, job, recordings)
    except FileError as fault:
        recording, error = None, error or str(fault)
    return ResultRow(
        **_job_fields(job, context.pack),
        run=context.run,
        timing=episode.world.task.timing.value,
        attempts=max(1, len(episode.runners)),
        budget=_budget_row(job, episode.limit),
        outcome=result,
        score=measured.score,
        counts=_counts(episode),
        usage=_total_usage(episode.usages),
        seconds=max(0.0, context.clock() - begun),
        repetitions=measured.repetitions,
        recording=recording,
        error=error[:MAX_ERROR] if error else error,
        measures=measured.measures,
    )


_worlds: OrderedDict[tuple[str, str, int], World] = OrderedDict()


def world_of(pack: Pack, instance: str, seats: int) -> World:
    """Return the world of an instance. The latest worlds are kept, because grounding takes time."""
    key = (pack.digest, instance, seats)
    if key not in _worlds:
        _worlds[key] = World(pack.load(instance, seats=seats))
    # Reuse is safe: a world caches only what is the same for every episode.
    _worlds.move_to_end(key)
    if len(_worlds) > MAX_WORLDS:
        _worlds.popitem(last=False)
    return _worlds[key]


class _JobEpisode:
    """Episode of a job, with its runners, exchanges and usage so far."""

    def __init__(self, job: EpisodeJob, context: RunContext, wrap: RunnerWrapper | None) -> None:
        self.job = job
        self.world = world_of(context.pack, job.instance, job.seats)
        self._budget = job.step_budget(context.pack).steps * job.slack
        self.limit = math.ceil(self._budget)
        self._folder = context.folder
        self._wrap = wrap
        self._agents = JobAgents(job, context.pack, self.world)
        self._reversal = reversal_of(job, context.pack, self.world)
        self.runners: list[RecordedRunner] = []
        self.usages: list[Usage] = []
        """Usage of all calls, including failed ones."""
        self.retries = 0

    async def attempt(self, model: Model | None) -> tuple[Result, str | None]:
        """Play to the end, or until something fails. Return the result and the error if any."""
        with ExitStack() as journals:
            try:
                return await self._play(self._completes(model, journals)), None
            except RobotouilleError as fault:
                error = str(fault)
            except ContextOverflow:
                # This is not a model error: the strategy could not shorten its request any further.
                error = "the conversation is too long for the model"
        steps = self.runners[-1].steps if self.runners else 0
        return Result(success=False, steps=steps, ended_by="error"), error

    def _completes(self, model: Model | None, journals: ExitStack) -> dict[str, Complete]:
        """Return the functions that ask the model for each player, each with its journal."""
        return {
            player: asking_once(
                model,
                journals.enter_context(CallJournal(self._folder.calls(self.job, player))),
                self._spend,
            )
            for player in self.world.players
        }

    def _spend(self, usage: Usage, attempts: int) -> None:
        self.usages.append(usage)
        self.retries += attempts - 1

    async def _play(self, complete: Mapping[str, Complete]) -> Result:
        players, agents = self.world.players, self._agents
        ended: TeamResult | TextEpisodeResult
        if self.job.real_time is not None:
            ended = await self._play_in_real_time(self.job.real_time, complete)
        elif len(players) == 1:
            alone = TextEpisode(
                self.world,
                agents.strategies[players[0]],
                self._budget,
                begin=self._begin,
                view=agents.view,
                blind=agents.published,
            )
            ended = await answer_all(alone.play(), complete[players[0]])
        else:
            runner = self._begin(self.limit)
            ended = await play_team(agents.team(complete), runner, self._budget, agents.view)
        return Result(success=ended.success, steps=ended.steps, ended_by=ended.ended.value)

    def finish_shift(self) -> None:
        """Let the rest of a shift pass without actions, so that orders expire.

        Otherwise, an agent that gives up could earn more than one that serves late.
        """
        if self.world.shift is None or not self.runners:
            return
        runner = self.runners[-1]
        while not runner.state.shift_over and runner.steps < self.limit:
            runner.step({})

    async def _play_in_real_time(
        self, timing: RealTime, complete: Mapping[str, Complete]
    ) -> TeamResult:
        runner = self._new_runner(self.limit, timing.step_rate)
        seats = {
            player: RealTimeSeat(
                player, strategy, timing.late, timing.digest_tokens, timing.max_age
            )
            for player, strategy in self._agents.strategies.items()
        }
        episode = RealTimeEpisode(
            seats,
            runner,
            complete,
            Charge.parse(timing.charge),
            timing.step_rate,
            self._agents.helpers(),
            self._agents.view,
        )
        return await episode.play(self._budget)

    def _begin(self, limit: int) -> EpisodeRunner:
        runner = self._new_runner(limit)
        return runner if self._wrap is None else self._wrap(runner)

    def _new_runner(self, limit: int, step_rate: float | None = None) -> RecordedRunner:
        job, players = self.job, self.world.players
        runner = RecordedRunner(
            self.world,
            dict.fromkeys(players, job.agent.name),
            episode_rules(len(players), limit, step_rate),
            kind="model" if job.agent.kind == "model" else "bot",
            episode=job.id,
            reversal=self._reversal,
        )
        self.runners.append(runner)
        return runner


def _write(folder: RunFolder, job: EpisodeJob, recordings: Sequence[bytes]) -> str | None:
    """Write the recordings of all trials, and return the relative path of the last one."""
    name: Path | None = None
    for trial, content in enumerate(recordings, start=1):
        name = folder.recording(job, trial)
        folder.write(name, compress(content))
    return str(name.relative_to(folder.path)) if name is not None else None


def _job_fields(job: EpisodeJob, pack: Pack) -> dict[str, Any]:
    """Return the fields of a row that are known before the episode is played."""
    instance = pack.instance(job.instance)
    agent = job.agent.name if job.control == "each" else f"{job.agent.name}, {job.control}"
    fields: dict[str, Any] = {
        "job": job.id,
        "pack": PackId(name=pack.name, version=pack.version, digest=pack.digest),
        "dataset": pack.task(instance.task).dataset,
        "task": instance.task,
        "instance": instance.id,
        "kind": instance.kind,
        "variant": job.variant,
        "experiment": job.experiment,
        "seed": job.seed,
        # An episode that has been played and paid is never lost because of a long name.
        "agent": agent[:MAX_NAME],
        "control": job.control,
        "strategy": job.agent.strategy[:MAX_NAME],
        "model": job.agent.model[:MAX_NAME],
        "sampling": job.agent.sampling[:MAX_NAME],
        "clock": job.clock,
        "seats": job.seats,
        "optimum": known_optimum(instance, job.seats),
    }
    if job.real_time is not None:
        timing = job.real_time.model_dump(mode="json", exclude={"slack"})
        fields["real_time"] = RealTimeRow(**timing)
    return fields


def known_optimum(instance: PackInstance, seats: int) -> Optimum:
    """Return what is known about the fewest steps of an instance for a number of players."""
    best = instance.best(seats)
    return Optimum(steps=best.steps, bound=best.bound, proven=best.proven) if best else Optimum()


def _budget_row(job: EpisodeJob, limit: int) -> BudgetRow:
    """Return the budget of a job and its rule, such as `own x 2`."""
    rule = job.budget if job.slack == 1 else f"{job.budget} x {job.slack:g}"
    return BudgetRow(rule=rule, steps=limit)


def _counts(episode: _JobEpisode) -> Counts:
    """Return the counts of calls, retries and wrong answers of all trials."""
    return Counts(
        invalid=sum(runner.invalid for runner in episode.runners),
        malformed=sum(runner.malformed for runner in episode.runners),
        calls=len(episode.usages),
        retries=episode.retries,
    )


def _total_usage(usages: Sequence[Usage]) -> TotalUsage:
    """Return the tokens and cost of all calls; no cost for an agent that calls no model."""
    total = sum(usages, NOTHING) if usages else Usage()
    return TotalUsage(
        prompt_tokens=total.prompt_tokens,
        completion_tokens=total.completion_tokens,
        cost=total.cost,
    )


@dataclass(frozen=True, slots=True)
class _Measured:
    """Fields of a row that come from a recording."""

    measures: EpisodeMeasures
    repetitions: int = 0
    score: ScoreRow | None = None


def _measure(recordings: Sequence[bytes], episode: _JobEpisode, context: RunContext) -> _Measured:
    """Return the measures of the last trial, its repeated transitions, and a shift's score."""
    if not recordings:
        return _Measured(EpisodeMeasures())
    pack, job, world = context.pack, episode.job, episode.world
    recording = Recording(recordings[-1])
    recording.world = world
    trajectory = Trajectory.recorded(recording)
    instance = pack.instance(job.instance)
    measures_distance = context.steps_to_go and world.shift is None
    distance = distance_in(pack, instance, world) if measures_distance else None
    fewest = instance.optimal(job.seats)
    found = measure(trajectory, episode.limit, distance=distance, fewest=fewest)
    return _Measured(found, repeated_transitions(trajectory), score(trajectory))


def distance_in(pack: Pack, instance: PackInstance, world: World) -> StepsToGo:
    """Return the steps to go in the world of an instance."""
    distance = StepsToGo(world)
    seats = len(world.players)
    if seats > 1 and instance.best(seats) is not None:
        # Searches for teams take a hundred times as long; the known plan is a bound without search.
        distance.learn(world.initial, pack.plan(instance, world))
    return distance
