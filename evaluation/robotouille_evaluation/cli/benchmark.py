"""`robotouille benchmark`: run, resume, report, compare."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robotouille.terminal import options_from, printable, tell
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
    from robotouille_evaluation.cli.planning import PlannedRun
    from robotouille_evaluation.runs import EpisodeJob, RunFolder, Workers

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
            "(`robotouille benchmark agents`). Default: planner,random,scripted, or the agents of "
            "--experiment.",
        ),
    ] = ""
    experiment: Annotated[
        str,
        typer.Option(
            help="Experiments of the pack to play as published: agent, tasks, instances, "
            "temperature, step budget and chance. Other options replace single settings."
        ),
    ] = ""
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
    instances: Annotated[
        str,
        typer.Option(help="Seeds or ids of instances, such as 42,84. Default: all of the kinds."),
    ] = ""
    limit: Annotated[
        int | None, typer.Option(min=1, help="Most instances of each task. Default: all.")
    ] = None
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
        Literal["none", "stochastic", "stochastic-paper", "delay-free"] | None,
        typer.Option(
            help="A cut item reverts with the probability of the published code (stochastic, 0.1 "
            "per step) or of the paper (stochastic-paper, 0.33), or nothing takes time. Default: "
            "none, or that of --experiment."
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


@benchmark.command()
@failing
@options_from(RunOptions)
def run(
    out: Annotated[Path, typer.Argument(help="New folder for the run.")], options: RunOptions
) -> None:
    """Play agents on tasks and write a report."""
    from robotouille_evaluation.cli.planning import plan_run
    from robotouille_evaluation.cli.playing import play
    from robotouille_evaluation.packs.store import write_pack
    from robotouille_evaluation.runs import RunFolder

    RunFolder(out).require_new()
    planned = plan_run(out, options)
    # This comes after the check of the jobs, because a refused run must not leave a folder behind.
    if planned.own_folder:
        write_pack(planned.pack, planned.folder)
    run_folder = _create(out, planned, options.steps_to_go)
    _warn_of_unknown_optima(planned)
    play(run_folder, planned.pack, planned.jobs, _workers(options))


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


@benchmark.command()
@failing
def agents(
    pack: Annotated[
        Path | None, typer.Option(help="Folder of a pack, whose experiments are listed, too.")
    ] = None,
) -> None:
    """List the agents that a run can play."""
    from robotouille_evaluation.cli.planning import agent_lines
    from robotouille_evaluation.packs.store import read_pack

    lines = list(agent_lines(() if pack is None else read_pack(pack).experiments))
    width = max(len(name) for name, _ in lines)
    for name, words in lines:
        tell(printable(f"{name:{width}}  {words}"))


def _workers(options: WorkerOptions) -> Workers:
    from robotouille_evaluation.runs import Workers

    return Workers(options.processes, options.calls, options.scheduler)


def _with_patience(job: EpisodeJob, timeout: float | None, attempts: int | None) -> EpisodeJob:
    given = {"timeout": timeout, "attempts": attempts}
    changed = {name: value for name, value in given.items() if value is not None}
    return job.model_copy(update={"agent": job.agent.model_copy(update=changed)})


def _warn_of_unknown_optima(planned: PlannedRun) -> None:
    # Rows store the optimum, so a proof after the run comes too late.
    wanted = {(job.instance, job.seats) for job in planned.jobs if job.budget != "shift"}
    unknown = [1 for name, seats in wanted if planned.pack.instance(name).best(seats) is None]
    if unknown:
        tell(
            f"{len(unknown)} of {len(wanted)} instances have no known shortest plan, so their "
            "optimality will be missing from the report; "
            f"run `robotouille pack prove {planned.folder}` before a run to find plans",
            err=True,
        )


def _create(out: Path, planned: PlannedRun, steps_to_go: bool) -> RunFolder:
    from robotouille.installation import VERSION
    from robotouille_evaluation.metrics.rows import PackId
    from robotouille_evaluation.runs import RunFolder, RunPlan

    pack = planned.pack
    return RunFolder.create(
        out,
        RunPlan(
            name=out.resolve().name,
            pack=PackId(name=pack.name, version=pack.version, digest=pack.digest),
            pack_folder=str(planned.folder),
            jobs=planned.jobs,
            software=VERSION,
            steps_to_go=steps_to_go,
        ),
    )
