"""`robotouille benchmark`: run, resume, report, compare."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import typer
from rich.console import Console

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.terminal import options_from, tell
from robotouille_client.bots.llm_options import (
    AttemptsOption,
    DigestTokensOption,
    LateOption,
    ModelOptions,
    TimeoutOption,
)
from robotouille_client.console import failing
from robotouille_evaluation.cli.results import agreement, compare, report

if TYPE_CHECKING:
    from robotouille_evaluation.cli.models import ModelChoice
    from robotouille_evaluation.packs.pack import Pack, PackInstance
    from robotouille_evaluation.runs import AgentSpec, EpisodeJob, RealTime, RunFolder, Workers
    from robotouille_evaluation.runs.budgets import BudgetedInstances

# Imports of packs, models and runs are in the functions: `--help` must not wait for them.


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Limits on what a run does at the same time."""

    processes: Annotated[
        int, typer.Option("--processes", min=1, help="Processes for agents without a model.")
    ] = os.cpu_count() or 1
    calls: Annotated[
        int, typer.Option("--calls", min=1, help="Episodes that wait for a model at once.")
    ] = 16
    scheduler: Annotated[
        str, typer.Option("--scheduler", help="Address of a Dask scheduler to use for processes.")
    ] = ""


@dataclass(frozen=True, kw_only=True)
class ResumeOptions(WorkerOptions):
    """Options of a resumed run."""

    timeout: TimeoutOption = None
    attempts: AttemptsOption = None
    base_url: Annotated[
        str,
        typer.Option(help="Endpoint of the run, repeated to confirm that it may receive a key."),
    ] = ""


@dataclass(frozen=True, kw_only=True)
class RunOptions(WorkerOptions, ModelOptions):
    """Options of a new run."""

    agents: Annotated[
        str,
        typer.Option(
            "--agents",
            help="Agents: planner, random, scripted, or strategies of a language model "
            "(react-last-reasoning-action, io, …, or an experiment of the pack).",
        ),
    ] = "planner,random,scripted"
    pack: Annotated[
        Path | None,
        typer.Option("--pack", help="Folder of a pack (`robotouille pack build`). "
                     "Default: the built-in pack with the data sets or tasks."),
    ] = None  # fmt: skip
    datasets: Annotated[
        str,
        typer.Option(help="Datasets. Default: all of the pack. `shifts` are a pack of their own."),
    ] = ""
    tasks: Annotated[str, typer.Option(help="Tasks. Default: all.")] = ""
    kinds: Annotated[
        str,
        typer.Option(
            help="Kinds of instances: default, free, noisy. Default: free, if the pack has any."
        ),
    ] = ""
    seats: Annotated[
        int | None,
        typer.Option(
            min=1, help="Players of each team for tasks that allow several. Default: as usual."
        ),
    ] = None
    seeds: Annotated[int, typer.Option(min=1, help="Episodes of each agent per instance.")] = 1
    budget: Annotated[
        Literal["own", "published"] | None,
        typer.Option(
            help="Step budget: 1.5 x the optimum (own), or the published constants. Instances "
            "without one are left out. A shift has its own length."
        ),
    ] = None
    variant: Annotated[
        Literal["stochastic", "stochastic-paper", "delay-free"] | None,
        typer.Option(
            help="A cut item reverts with the probability of the published code (stochastic, 0.1 "
            "per step) or of the paper (stochastic-paper, 0.33), or nothing takes time."
        ),
    ] = None
    control: Annotated[
        Literal["each", "turns", "joint"],
        typer.Option(
            help="Teams: a model for each robot (each), or one model that is asked for one robot "
            "after the other (turns) or for all at once (joint)."
        ),
    ] = "each"
    clock: Annotated[
        Literal["turns", "realtime"],
        typer.Option(help="The world waits for its players (turns), or goes on while they think."),
    ] = "turns"
    step_rate: Annotated[
        float, typer.Option(min=0.01, max=60, help="Real time: steps per second.")
    ] = 5.0
    charge: Annotated[
        str,
        typer.Option(
            help="Real time: cost of a thought. `tokens:20`: 20 ms for each generated token. "
            "`declared:1500`: 1,500 ms for each call."
        ),
    ] = "tokens:20"
    late: LateOption = "apply"
    helper: Annotated[
        Literal["none", "planner", "script"],
        typer.Option(help="Real time: bot that acts while a model thinks."),
    ] = "none"
    digest_tokens: DigestTokensOption = 0
    slack: Annotated[
        float, typer.Option(min=1, max=1000, help="Real time: factor of the step budgets.")
    ] = 1.0
    steps_to_go: Annotated[
        bool,
        typer.Option("--steps-to-go", help="Search how far failed episodes were from the goal."),
    ] = False


benchmark = typer.Typer(
    no_args_is_help=True, help="Evaluate agents on packs of tasks: run, resume, report, compare."
)

for command in (report, compare, agreement):
    benchmark.command()(command)

COMPUTED = ("planner", "random", "scripted")


@benchmark.command()
@failing
@options_from(RunOptions)
def run(
    out: Annotated[Path, typer.Argument(help="New folder for the run.")], options: RunOptions
) -> None:
    """Play agents on tasks and write a report."""
    from robotouille_evaluation.cli.models import ModelChoice
    from robotouille_evaluation.cli.playing import play
    from robotouille_evaluation.packs.store import write_pack
    from robotouille_evaluation.runs import JobOptions, RunFolder, plan_jobs

    RunFolder(out).require_new()
    real_time = _real_time(options)
    datasets, tasks = _words(options.datasets), _words(options.tasks)
    folder, pack = _pack(out, options.pack, datasets or tasks)
    chosen = _instances(pack, datasets, tasks, _words(options.kinds) or pack.usual_kinds)
    if options.variant == "delay-free":
        folder, pack = (out / "pack").resolve(), _delay_free(pack, chosen, options.seats)
        chosen = list(pack.instances)
    budgeted = _with_budget(pack, chosen, options)
    agents = _agent_specs(_words(options.agents), pack, ModelChoice.of_options(options))
    job_options = JobOptions(
        seeds=range(options.seeds),
        seats=options.seats,
        budget=budgeted.rule,
        variant=options.variant or "",
        real_time=real_time,
        control=options.control,
    )
    jobs = tuple(plan_jobs(pack, agents, budgeted.instances, job_options))
    # This comes after the check of the jobs, because a refused run must not leave a folder behind.
    if options.pack is None or options.variant == "delay-free":
        write_pack(pack, folder)
    run_folder = _create(out, pack, folder, jobs, options.steps_to_go)
    _warn_of_unknown_optima(pack, jobs, folder)
    play(run_folder, pack, jobs, _workers(options))


@benchmark.command()
@failing
@options_from(ResumeOptions)
def resume(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    options: ResumeOptions,
) -> None:
    """Continue a stopped run, and repeat episodes that ended with an error.

    No paid call is made again.

    Models are asked as in the run, except for the given time-out and number of attempts. An
    endpoint other than OpenAI's must be repeated as --base-url, because a file alone must not
    decide where a key is sent.
    """
    from robotouille_evaluation.cli.models import ModelChoice, require_base_url
    from robotouille_evaluation.cli.playing import play
    from robotouille_evaluation.packs.store import read_pack
    from robotouille_evaluation.runs import RunFolder

    folder = RunFolder(run_folder)
    plan = folder.plan()
    models = {job.agent.name: job.agent for job in plan.jobs if job.agent.kind == "model"}
    require_base_url(map(ModelChoice.of_agent, models.values()), options.base_url)
    pack = read_pack(Path(plan.pack_folder), digest=plan.pack.digest)
    jobs = [_with_patience(job, options.timeout, options.attempts) for job in plan.jobs]
    play(folder, pack, jobs, _workers(options))


def _workers(options: WorkerOptions) -> Workers:
    from robotouille_evaluation.runs import Workers

    return Workers(options.processes, options.calls, options.scheduler)


def _with_patience(job: EpisodeJob, timeout: float | None, attempts: int | None) -> EpisodeJob:
    given = {"timeout": timeout, "attempts": attempts}
    changed = {name: value for name, value in given.items() if value is not None}
    return job.model_copy(update={"agent": job.agent.model_copy(update=changed)})


def _words(text: str) -> tuple[str, ...]:
    return tuple(word for word in (part.strip() for part in text.split(",")) if word)


def _real_time(options: RunOptions) -> RealTime | None:
    """Return the real time settings, or None if the world waits.

    Raises:
        RobotouilleError: The world waits, and an option for real time is set.
    """
    from robotouille_evaluation.realtime import LatePolicy
    from robotouille_evaluation.runs import RealTime

    chosen = RealTime(
        step_rate=options.step_rate,
        charge=options.charge,
        late=LatePolicy(options.late),
        helper=options.helper,
        digest_tokens=options.digest_tokens,
        slack=options.slack,
    )
    if options.clock == "realtime":
        return chosen
    defaults = RealTime(charge=RunOptions.charge).model_dump()
    changed = [name for name, value in chosen.model_dump().items() if value != defaults[name]]
    if changed:
        flag = changed[0].replace("_", "-")
        raise RobotouilleError(f"--{flag} is only for --clock realtime")
    return None


def _pack(out: Path, folder: Path | None, names: Sequence[str]) -> tuple[Path, Pack]:
    """Return the pack and its folder. A run keeps a copy of a built-in pack.

    Args:
        names: Data sets or tasks that the built-in pack must have.
    """
    from robotouille_evaluation.packs.own import pack_with
    from robotouille_evaluation.packs.store import read_pack

    if folder is not None:
        return folder.resolve(), read_pack(folder)
    return (out / "pack").resolve(), pack_with(names)


def _delay_free(pack: Pack, chosen: Sequence[PackInstance], seats: int | None) -> Pack:
    from robotouille_evaluation.packs.delay_free import delay_free

    console = Console(stderr=True)
    with console.status("") as status:
        return delay_free(
            pack,
            chosen,
            lambda done, total: status.update(f"planned {done} of {total} instances"),
            seats,
        )


def _instances(
    pack: Pack, datasets: Sequence[str], tasks: Sequence[str], kinds: Sequence[str]
) -> list[PackInstance]:
    from robotouille_evaluation.packs.pack import InstanceKind

    for what, chosen, known in (
        ("dataset", datasets, pack.datasets),
        ("kind of instance", kinds, get_args(InstanceKind)),
    ):
        for name in chosen:
            if name not in known:
                near = did_you_mean(name, known) or f"; choose {', '.join(known)}"
                raise UnknownNameError(f"unknown {what} {name!r}{near}")
    found = [
        instance
        for instance in pack.instances_of(tasks or None)
        if instance.kind in kinds and (not datasets or pack.task(instance.task).dataset in datasets)
    ]
    if not found:
        raise RobotouilleError("the pack has no such instances; see `robotouille pack show`")
    return found


def _with_budget(
    pack: Pack, chosen: Sequence[PackInstance], options: RunOptions
) -> BudgetedInstances:
    """Return the instances that have a step budget, and report the others in a line."""
    from robotouille_evaluation.runs.budgets import with_budget

    if options.seats is not None:
        pack.require_seats(chosen, options.seats)
    # The plans of a pack without delays come from a search, which may not find all of them.
    rule = "own" if options.variant == "delay-free" else None
    found = with_budget(pack, chosen, options.budget or rule, options.seats)
    if found.left_out:
        tell(str(found), err=True)
    return found


def _agent_specs(names: Iterable[str], pack: Pack, choice: ModelChoice) -> list[AgentSpec]:
    """Return the agents, after a check that their model can be asked."""
    from robotouille_evaluation.cli.models import check_model

    specs = [agent_spec(name, pack, choice) for name in names]
    if any(spec.kind == "model" for spec in specs):
        asyncio.run(check_model(choice))
    return specs


def agent_spec(name: str, pack: Pack, model: ModelChoice) -> AgentSpec:
    """Return the agent with a name, or raise UnknownNameError."""
    from robotouille_evaluation.agents.making import OWN_STRATEGIES, make_strategy
    from robotouille_evaluation.runs import AgentSpec
    from robotouille_evaluation.runs.job_list import model_agent_name

    if name in COMPUTED:
        return AgentSpec(name=name, kind=name)
    try:
        make_strategy(pack, name, pack.datasets[0])
    except UnknownNameError:
        if "/" not in name:
            known = [*COMPUTED, *OWN_STRATEGIES, *(each.id for each in pack.experiments)]
            near = did_you_mean(name, known) or f"; choose {', '.join(known)}"
            raise UnknownNameError(f"no agent {name!r}{near}") from None
        raise _unknown_experiment(name, pack) from None
    return AgentSpec(
        name=model_agent_name(name, model.name, model.parameters),
        kind="model",
        strategy=name,
        model=model.name,
        base_url=model.base_url,
        parameters=dict(model.parameters),
        prices=model.prices,
        timeout=model.timeout,
        attempts=model.attempts,
    )


def _unknown_experiment(name: str, pack: Pack) -> UnknownNameError:
    """Return an error that names the experiments of the same agent and dataset."""
    known = [experiment.id for experiment in pack.experiments]
    if not known:
        return UnknownNameError(
            f"unknown experiment {name!r}: {pack.name} has none; use --pack with an imported pack "
            "(`robotouille pack import CHECKOUT`)"
        )
    group = f"{name.rpartition('/')[0]}/"
    same = [id_ for id_ in known if id_.startswith(group)]
    if not same:
        return UnknownNameError(f"unknown experiment {name!r}{did_you_mean(name, known)}")
    return UnknownNameError(f"unknown experiment {name!r}; choose {', '.join(same)}")


def _warn_of_unknown_optima(pack: Pack, jobs: Iterable[EpisodeJob], folder: Path) -> None:
    # Rows store the optimum, so a proof after the run comes too late.
    wanted = {(job.instance, job.seats) for job in jobs if job.budget != "shift"}
    unknown = [1 for name, seats in wanted if pack.instance(name).best(seats) is None]
    if unknown:
        tell(
            f"{len(unknown)} of {len(wanted)} instances have no known shortest plan, so their "
            "optimality will be missing from the report; "
            f"run `robotouille pack prove {folder}` before a run to find plans",
            err=True,
        )


def _create(
    out: Path, pack: Pack, folder: Path, jobs: tuple[EpisodeJob, ...], steps_to_go: bool
) -> RunFolder:
    from robotouille.installation import VERSION
    from robotouille_evaluation.metrics.rows import PackId
    from robotouille_evaluation.runs import RunFolder, RunPlan

    return RunFolder.create(
        out,
        RunPlan(
            name=out.resolve().name,
            pack=PackId(name=pack.name, version=pack.version, digest=pack.digest),
            pack_folder=str(folder),
            jobs=jobs,
            software=VERSION,
            steps_to_go=steps_to_go,
        ),
    )
