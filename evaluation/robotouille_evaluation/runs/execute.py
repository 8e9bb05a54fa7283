"""One job played to its end, whatever happens: a row, and recordings."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from robotouille import State, World
from robotouille.errors import FileError, RobotouilleError
from robotouille.planning import StepsToGo
from robotouille.planning.policies import Policy, Script
from robotouille.replay.container import compress
from robotouille.replay.recording import Recording
from robotouille_evaluation.agents.asking import Complete, answer_all
from robotouille_evaluation.agents.making import make_strategy, team_strategy
from robotouille_evaluation.agents.policies import (
    planner,
    planner_policy,
    random_actions,
    script,
)
from robotouille_evaluation.agents.proposal import (
    ContextOverflow,
    Exchange,
    Strategy,
)
from robotouille_evaluation.agents.teams.joint import Joint
from robotouille_evaluation.agents.teams.team import Each, Team, Turns
from robotouille_evaluation.metrics.measuring import measure
from robotouille_evaluation.metrics.progress import repeated_transitions
from robotouille_evaluation.metrics.rows import (
    BudgetRow,
    Counts,
    EpisodeRow,
    Measures,
    Optimum,
    PackId,
    RealTimeRow,
    Result,
    Spent,
)
from robotouille_evaluation.metrics.trajectory import Trajectory
from robotouille_evaluation.models import (
    Model,
    Usage,
)
from robotouille_evaluation.packs.pack import Pack, PackInstance
from robotouille_evaluation.realtime import Charge, RealTimeSeat
from robotouille_evaluation.runs.folder import RunFolder
from robotouille_evaluation.runs.jobs import HelperKind, Job, RealTime
from robotouille_evaluation.runs.journal import CallJournal, asking_once
from robotouille_evaluation.runs.real_time_episode import play_real_time
from robotouille_evaluation.runs.stage import RecordedStage, Stage, Watch
from robotouille_evaluation.runs.team_episode import play_team
from robotouille_evaluation.runs.text_episode import TextEpisode, View
from robotouille_evaluation.runs.variants import chance

__all__ = ["play_job"]

Clock = Callable[[], float]

MAX_WORLDS = 16
"""Worlds that a process keeps for the next jobs."""


async def play_job(
    job: Job,
    run: str,
    pack: Pack,
    folder: RunFolder,
    model: Model | None,
    clock: Clock,
    *,
    steps_to_go: bool = False,
    watch: Watch | None = None,
) -> EpisodeRow:
    """Play a job. A fault of the model or of the disk ends the episode, not the run.

    Args:
        run: The run's name, for the row.
        model: Who is asked, where the agent is one that asks.
        clock: Seconds, for the row's `seconds`.
        steps_to_go: Whether it is measured how far the goal was in the end: takes searches.
        watch: Sees what happens, trial by trial.

    Raises:
        RobotouilleError: The job is none of this pack.
    """
    begun = clock()
    instance = pack.instance(job.instance)
    world = _world(pack, instance, job.seats)
    budget = pack.budget(instance, job.budget, seats=job.seats)
    slack = job.real_time.slack if job.real_time is not None else 1.0
    limit = math.ceil(budget.steps * slack)
    episode = _Episode(job, pack, folder, world, budget.steps * slack, watch)
    with ExitStack() as journals:
        error = None
        try:
            complete = episode.completes(model, journals)
            result = await episode.play(complete)
        except RobotouilleError as fault:
            result, error = episode.broken_off(), str(fault)
        except ContextOverflow:
            result, error = episode.broken_off(), "the model takes no request as long as this"
    recorded = [stage.recording(error or "the agent is done") for stage in episode.stages]
    measures, repetitions = _measured(recorded[-1:], world, pack, job, limit, steps_to_go)
    try:
        recording = _write(folder, job, recorded)
    except FileError as fault:
        recording, error = None, error or str(fault)
    return EpisodeRow(
        **_what_was_played(job, run, pack, instance),
        timing=world.task.timing.value,
        attempts=episode.trials,
        budget=BudgetRow(rule=_rule(job), steps=limit),
        outcome=result,
        counts=_counts(episode.exchanges, episode.stages),
        usage=_spent(episode.spent),
        seconds=max(0.0, clock() - begun),
        repetitions=repetitions,
        recording=recording,
        error=error,
        measures=measures,
    )


_worlds: OrderedDict[tuple[str, str, int], World] = OrderedDict()


def _world(pack: Pack, instance: PackInstance, seats: int) -> World:
    """The world of an instance: that of the last jobs, if they were of the same one. It knows its
    actions then; what it answers is the same."""
    key = (pack.digest, instance.id, seats)
    if key not in _worlds:
        _worlds[key] = World(pack.load(instance, seats=seats))
    _worlds.move_to_end(key)
    if len(_worlds) > MAX_WORLDS:
        _worlds.popitem(last=False)
    return _worlds[key]


def _what_was_played(job: Job, run: str, pack: Pack, instance: PackInstance) -> dict[str, Any]:
    """The fields of a row that are known before its episode is begun."""
    best = instance.best(job.seats)
    known = Optimum(steps=best.steps, bound=best.bound, proven=best.proven) if best else Optimum()
    return {
        "run": run,
        "job": job.id,
        "pack": PackId(name=pack.name, version=pack.version, digest=pack.digest),
        "dataset": pack.task(instance.task).dataset,
        "task": instance.task,
        "instance": instance.id,
        "kind": instance.kind,
        "variant": job.variant,
        "seed": job.seed,
        "agent": job.agent.name if job.control == "each" else f"{job.agent.name}, {job.control}",
        "control": job.control,
        "strategy": job.agent.strategy,
        "model": job.agent.model,
        **_time(job),
        "seats": job.seats,
        "optimum": known,
    }


def _clock(job: Job) -> str:
    if job.real_time is not None:
        return "realtime"
    return "turn" if job.seats == 1 else "lockstep"


def _time(job: Job) -> dict[str, Any]:
    """Whether the world waits, and if not, how it goes on."""
    if job.real_time is None:
        return {"clock": _clock(job)}
    told = job.real_time.model_dump(mode="json", exclude={"slack"})
    return {"clock": _clock(job), "real_time": RealTimeRow(**told)}


def _rule(job: Job) -> str:
    slack = job.real_time.slack if job.real_time is not None else 1.0
    return job.budget if slack == 1 else f"{job.budget} x {slack:g}"


class _Episode:
    """A job under way."""

    def __init__(
        self,
        job: Job,
        pack: Pack,
        folder: RunFolder,
        world: World,
        budget: float,
        watch: Watch | None,
    ) -> None:
        self._job = job
        self._folder = folder
        self._world = world
        self._budget = budget
        self._published = any(found.id == job.agent.strategy for found in pack.experiments)
        self._view = _view(job, published=self._published)
        self._undone = chance(job.variant, world, f"{job.instance}:{job.seed}")
        self._watch = watch
        self._strategies = (
            {p: _strategy(job, pack, world, p) for p in world.players}
            if job.control == "each"
            else {}
        )
        self._pack = pack
        self.stages: list[RecordedStage] = []
        self.exchanges: list[Exchange] = []
        self.spent: list[Usage] = []
        """Of all calls, also where nothing came of them."""

    @property
    def trials(self) -> int:
        """How often it was begun."""
        return max(1, len(self.stages))

    def completes(self, model: Model | None, journals: ExitStack) -> dict[str, Complete]:
        """Who is asked for each player, with a journal of its own."""
        return {
            player: asking_once(
                model,
                journals.enter_context(CallJournal(self._folder.calls(self._job, player))),
                self.spent.append,
            )
            for player in self._world.players
        }

    async def play(self, complete: Mapping[str, Complete]) -> Result:
        """Until it is over. Raises RobotouilleError, ContextOverflow."""
        players = self._world.players
        if self._job.real_time is not None:
            return await self._play_in_real_time(self._job.real_time, complete)
        if len(players) == 1:
            strategy = self._strategies[players[0]]
            alone = TextEpisode(
                self._world,
                strategy,
                self._budget,
                begin=self._begin,
                view=self._view,
                blind=self._published,
            )
            result = await answer_all(alone.play(), complete[players[0]])
            return Result(success=result.success, steps=result.steps, ended_by=result.ended.value)
        stage = self._begin(math.ceil(self._budget))
        team = self._team(complete)
        ended = await play_team(self._world, team, self._budget, stage, self._view)
        return Result(success=ended.success, steps=ended.steps, ended_by=ended.ended.value)

    def _team(self, complete: Mapping[str, Complete]) -> Team:
        """How its seats are asked. One model for all of them is asked as the first."""
        job, pack = self._job, self._pack
        if job.control == "each":
            return Each(self._strategies, complete)
        dataset = pack.task(pack.instance(job.instance).task).dataset
        strategy = team_strategy(pack, job.agent.strategy, dataset, job.control)
        first = complete[self._world.players[0]]
        return Joint(strategy, first) if job.control == "joint" else Turns(strategy, first)

    async def _play_in_real_time(self, time: RealTime, complete: Mapping[str, Complete]) -> Result:
        stage = self._stage(math.ceil(self._budget), time.step_rate)
        seats = {
            player: RealTimeSeat(player, strategy, time.late, time.digest_tokens)
            for player, strategy in self._strategies.items()
        }
        helpers = _helpers(self._job, time.helper, self._pack, self._world)
        ended = await play_real_time(
            self._world,
            seats,
            self._budget,
            stage,
            complete,
            Charge.parse(time.charge),
            time.step_rate,
            helpers,
            self._view,
        )
        return Result(success=ended.success, steps=ended.steps, ended_by=ended.ended.value)

    def broken_off(self) -> Result:
        """What is said of one that could not be played to its end."""
        steps = self.stages[-1].steps if self.stages else 0
        return Result(success=False, steps=steps, ended_by="error")

    def _begin(self, limit: int) -> Stage:
        stage = self._stage(limit)
        return stage if self._watch is None else self._watch(stage)

    def _stage(self, limit: int, step_rate: float | None = None) -> RecordedStage:
        names = dict.fromkeys(self._world.players, self._job.agent.name)
        stage = RecordedStage(
            self._world,
            names,
            limit,
            kind="model" if self._job.agent.kind == "model" else "bot",
            episode=self._job.id,
            answered=self._answered,
            undone=self._undone,
            step_rate=step_rate,
        )
        self.stages.append(stage)
        return stage

    def _answered(self, player: str, exchange: Exchange) -> None:
        self.exchanges.append(exchange)


def _strategy(job: Job, pack: Pack, world: World, player: str) -> Strategy:
    match job.agent.kind:
        case "planner":
            clock = _clock(job) if job.real_time is None else None
            return planner(world, player, job.seed, clock)
        case "random":
            return random_actions(world, player, job.seed)
        case "scripted":
            return script(pack.plan(job.instance, world), player, world)
        case "model":
            dataset = pack.task(pack.instance(job.instance).task).dataset
            return make_strategy(pack, job.agent.strategy, dataset)


def _helpers(job: Job, kind: HelperKind, pack: Pack, world: World) -> dict[str, Policy]:
    """Who acts in each seat while its model thinks; what only plans needs nobody."""
    if kind == "none" or job.agent.kind != "model":
        return {}
    if kind == "planner":
        return {p: planner_policy(world, p, job.seed) for p in world.players}
    plan = pack.plan(job.instance, world)
    return {p: Script(p, plan, world.initial) for p in world.players}


def _view(job: Job, *, published: bool) -> View | None:
    """What is read: by published strategies what is published, by ours what the network sends."""
    if job.agent.kind != "model":
        return None
    return State.text if published else State.text_view


def _measured(
    recorded: Sequence[bytes], world: World, pack: Pack, job: Job, budget: int, steps_to_go: bool
) -> tuple[Measures, int]:
    """The measures of the last trial, and its repeated transitions."""
    instance = pack.instance(job.instance)
    for content in recorded:
        recording = Recording(content)
        recording.world = world
        course = Trajectory.recorded(recording)
        distance = StepsToGo(world) if steps_to_go else None
        if distance is not None and job.seats > 1 and instance.best(job.seats) is not None:
            distance.learn(world.initial, pack.plan(instance, world))
        found = measure(course, budget, distance=distance, fewest=instance.optimal(job.seats))
        return found, repeated_transitions(course)
    return Measures(), 0


def _write(folder: RunFolder, job: Job, recorded: Sequence[bytes]) -> str | None:
    """The recordings of all trials; the path of the last, beside the rows."""
    name: Path | None = None
    for trial, content in enumerate(recorded, start=1):
        name = folder.recording(job, trial)
        folder.write(name, compress(content))
    return str(name.relative_to(folder.path)) if name is not None else None


def _counts(exchanges: Sequence[Exchange], stages: Sequence[RecordedStage]) -> Counts:
    answers = [exchange for exchange in exchanges if exchange.completion is not None]
    return Counts(
        invalid=sum(stage.invalid for stage in stages),
        malformed=sum(stage.malformed for stage in stages),
        calls=len(answers),
        retries=sum(e.completion.attempts - 1 for e in answers if e.completion is not None),
    )


def _spent(used: Sequence[Usage]) -> Spent:
    costs = [usage.cost for usage in used if usage.cost is not None]
    return Spent(
        prompt_tokens=sum(usage.prompt_tokens for usage in used),
        completion_tokens=sum(usage.completion_tokens for usage in used),
        cost=sum(costs) if costs else None,
    )
