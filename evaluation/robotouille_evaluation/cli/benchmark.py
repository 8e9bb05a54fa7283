"""`robotouille benchmark`: run, resume, measure, report, compare."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.terminal import options_from, printable, tell
from robotouille_client.console import failing
from robotouille_evaluation.cli.examples import examples
from robotouille_evaluation.cli.measuring import measure
from robotouille_evaluation.cli.results import agreement, compare, report
from robotouille_evaluation.cli.run_options import ResumeOptions, RunOptions, WorkerOptions

if TYPE_CHECKING:
    from robotouille_evaluation.cli.planning import PlannedRun
    from robotouille_evaluation.runs import EpisodeJob, RunFolder, Workers

MAX_WIDTH, MAX_LINE = 40, 500
"""Most characters of the column of names and of a line, in a list of agents."""

# Imports of packs, models and runs are in the functions: `--help` must not wait for them.


benchmark = typer.Typer(
    no_args_is_help=True,
    help="Evaluate agents on packs of tasks: run, resume, measure, report, compare.",
)

for command in (report, measure, compare, agreement, examples):
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
    from robotouille_evaluation.runs import RunFolder

    RunFolder(out).require_new()
    planned = plan_run(out, options)
    # This comes after the check of the jobs, because a refused run must not leave a folder behind.
    run_folder = _create(out, planned, options.steps_to_go)
    _warn_of_unknown_optima(planned)
    if options.steps_to_go:
        tell(
            "--steps-to-go searches for a plan after each failed episode, which can take longer "
            "than the episode; `robotouille benchmark resume` continues a stopped run",
            err=True,
        )
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
    endpoint other than OpenAI's must be repeated as --base-url, and agents of your own as --agents,
    because a file alone must not decide where a key is sent and which code is run.
    """
    from robotouille_evaluation.cli.models import ModelChoice, require_base_url
    from robotouille_evaluation.cli.planning import comma_separated, require_agents
    from robotouille_evaluation.cli.playing import play
    from robotouille_evaluation.packs.store import read_pack
    from robotouille_evaluation.runs import RunFolder

    folder = RunFolder(run_folder)
    plan = folder.plan()
    models = (job.agent for job in plan.jobs if job.agent.kind == "model")
    require_base_url(map(ModelChoice.of_agent, models), options.base_url)
    require_agents((job.agent for job in plan.jobs), comma_separated(options.agents))
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
    # Packs may come from other people, and one long name would widen all lines.
    width = min(max(len(name) for name, _ in lines), MAX_WIDTH)
    for name, words in lines:
        tell(printable(f"{name:{width}}  {words}"[:MAX_LINE]))


def _workers(options: WorkerOptions) -> Workers:
    from robotouille_evaluation.runs import Workers

    return Workers(options.processes, options.calls, options.scheduler)


def _with_patience(job: EpisodeJob, timeout: float | None, attempts: int | None) -> EpisodeJob:
    given = {"timeout": timeout, "attempts": attempts}
    changed = {name: value for name, value in given.items() if value is not None}
    return job.model_copy(update={"agent": job.agent.model_copy(update=changed)})


def _warn_of_unknown_optima(planned: PlannedRun) -> None:
    wanted = {(job.instance, job.seats) for job in planned.jobs if job.budget != "shift"}
    unknown = [1 for name, seats in wanted if planned.pack.instance(name).best(seats) is None]
    if unknown:
        tell(
            f"{len(unknown)} of {len(wanted)} instances have no known shortest plan, so their "
            "optimality will be missing from the report; "
            f"`robotouille pack prove {planned.folder}` finds plans, and "
            "`robotouille benchmark measure` adds them to a run",
            err=True,
        )


def _create(out: Path, planned: PlannedRun, steps_to_go: bool) -> RunFolder:
    from robotouille.installation import VERSION
    from robotouille_evaluation.metrics.rows import PackId
    from robotouille_evaluation.packs.store import write_pack
    from robotouille_evaluation.runs import RunFolder, RunPlan

    pack = planned.pack
    folder = RunFolder.create(
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
    if planned.own_folder:
        # After the run is claimed: of two processes, the later one must not replace the pack.
        try:
            write_pack(pack, planned.folder)
        except BaseException:
            folder.discard()
            raise
    return folder
