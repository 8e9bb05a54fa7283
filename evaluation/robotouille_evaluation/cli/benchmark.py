"""`robotouille benchmark`: run, resume, report, compare."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer
from rich.console import Console

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.terminal import options_from, tell
from robotouille_client.console import failing
from robotouille_evaluation.cli.results import agreement, compare, report
from robotouille_evaluation.cli.run_options import ResumeOptions, RunOptions, WorkerOptions

if TYPE_CHECKING:
    from robotouille_evaluation.cli.models import ModelChoice
    from robotouille_evaluation.packs.pack import Pack, PackInstance
    from robotouille_evaluation.runs import AgentSpec, EpisodeJob, RealTime, RunFolder, Workers

# Imports of packs, models and runs are in the functions: `--help` must not wait for them.

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
    folder, pack = _pack(out, options.pack)
    chosen = _instances(
        pack, _words(options.datasets), _words(options.tasks), _words(options.kinds)
    )
    if options.variant == "delay-free":
        folder, pack = (out / "pack").resolve(), _delay_free(pack, chosen, options.seats)
        chosen = list(pack.instances)
    agents = _agent_specs(_words(options.agents), pack, ModelChoice.of_options(options))
    job_options = JobOptions(
        seeds=range(options.seeds),
        seats=options.seats,
        budget=options.budget,
        variant=options.variant or "",
        real_time=real_time,
        control=options.control,
    )
    jobs = tuple(plan_jobs(pack, agents, chosen, job_options))
    # After the jobs are checked: a refused run must not leave a folder behind.
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


def _pack(out: Path, folder: Path | None) -> tuple[Path, Pack]:
    """Return the pack and its folder. A run keeps a copy of the built-in pack."""
    from robotouille_evaluation.packs.own import build_own_pack
    from robotouille_evaluation.packs.store import read_pack

    if folder is not None:
        return folder.resolve(), read_pack(folder)
    return (out / "pack").resolve(), build_own_pack()


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
                raise UnknownNameError(f"unknown {what} {name!r}{did_you_mean(name, known)}")
    found = [
        instance
        for instance in pack.instances_of(tasks or None)
        if instance.kind in kinds and (not datasets or pack.task(instance.task).dataset in datasets)
    ]
    if not found:
        raise RobotouilleError("the pack has no such instances; see `robotouille pack show`")
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
    from robotouille_evaluation.agents.making import make_strategy
    from robotouille_evaluation.runs import AgentSpec

    if name in COMPUTED:
        return AgentSpec(name=name, kind=name)
    try:
        make_strategy(pack, name, pack.datasets[0])
    except UnknownNameError:
        if "/" not in name:
            raise
        raise _unknown_experiment(name, pack) from None
    return AgentSpec(
        name=f"{name} ({model.name})",
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
    wanted = {(job.instance, job.seats) for job in jobs}
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
