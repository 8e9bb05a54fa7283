"""`robotouille benchmark`: run, go on, report, compare."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer
from rich.console import Console

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.program import tell
from robotouille_client.console import failing
from robotouille_evaluation.cli import run_options as options
from robotouille_evaluation.cli.results import agreement, compare, report

if TYPE_CHECKING:
    from robotouille_evaluation.cli.models import ModelChoice
    from robotouille_evaluation.packs.pack import Pack, PackInstance
    from robotouille_evaluation.runs import AgentSpec, Job, RealTime, RunFolder

__all__ = ["agent_spec", "benchmark"]

benchmark = typer.Typer(
    no_args_is_help=True, help="Evaluate agents on packs of tasks: run, resume, report, compare."
)

for command in (report, compare, agreement):
    benchmark.command()(command)

COMPUTED = ("planner", "random", "scripted")


@benchmark.command()
@failing
def run(
    out: options.Out,
    agents: options.Agents = "planner,random,scripted",
    model: options.Model = "mock",
    base_url: options.BaseUrl = "",
    pack: options.Pack = None,
    datasets: options.Datasets = "",
    tasks: options.Tasks = "",
    kinds: options.Kinds = "free",
    seats: options.Seats = None,
    seeds: options.Seeds = 1,
    budget: options.Budget = None,
    variant: options.Variant = None,
    control: options.Control = "each",
    clock: options.Clock = "turns",
    step_rate: options.StepRate = 5.0,
    charge: options.Charge = "tokens:20",
    late: options.Late = "apply",
    helper: options.Helper = "none",
    digest_tokens: options.DigestTokens = 0,
    slack: options.Slack = 1.0,
    temperature: options.Temperature = None,
    price: options.Price = "",
    timeout: options.Timeout = None,
    attempts: options.Attempts = None,
    steps_to_go: options.StepsToGo = False,
    processes: options.Processes = os.cpu_count() or 1,
    calls: options.Calls = 16,
    scheduler: options.Scheduler = "",
) -> None:
    """Play agents on tasks, and write a report."""
    from robotouille_evaluation.cli.models import ModelChoice
    from robotouille_evaluation.cli.playing import play
    from robotouille_evaluation.packs.store import write_pack
    from robotouille_evaluation.realtime import Late
    from robotouille_evaluation.runs import RealTime, RunFolder, Workers, jobs

    RunFolder(out).require_new()
    moving = RealTime(
        step_rate=step_rate, charge=charge, late=Late(late), helper=helper,
        digest_tokens=digest_tokens, slack=slack,
    )  # fmt: skip
    if clock == "turns":
        _require_usual(moving)
    folder, used = _new_pack(out, pack)
    chosen = _instances(used, _words(datasets), _words(tasks), _words(kinds))
    if variant == "delay-free":
        folder, used = (out / "pack").resolve(), _delay_free(used, chosen, seats)
        chosen = list(used.instances)
    parameters = {} if temperature is None else {"temperature": temperature}
    choice = ModelChoice(model, base_url, parameters, price, timeout, attempts)
    planned = tuple(
        jobs(
            used, _agent_specs(_words(agents), used, choice), chosen, seeds=range(seeds),
            seats=seats, budget=budget, variant=variant or "", control=control,
            real_time=moving if clock == "realtime" else None,
        )
    )  # fmt: skip
    if pack is None or variant == "delay-free":
        write_pack(used, folder)
    run_folder = _create(out, used, folder, planned, steps_to_go)
    _warn_of_unknown_optima(used, planned, folder)
    play(run_folder, used, planned, Workers(processes, calls, scheduler))


@benchmark.command()
@failing
def resume(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run.")],
    processes: options.Processes = os.cpu_count() or 1,
    calls: options.Calls = 16,
    scheduler: options.Scheduler = "",
    timeout: options.Timeout = None,
    attempts: options.Attempts = None,
    base_url: Annotated[
        str,
        typer.Option(help="The run's own, said again where a key would be sent to it."),
    ] = "",
) -> None:
    """Go on with a run that was stopped, and play what ended with an error once more; no paid call
    is made again.

    Models are asked as the run says; a time-out or a number of attempts given here comes first.
    An address that is not OpenAI's has to be named again: a key is sent nowhere because a file says
    so.
    """
    from robotouille_evaluation.cli.models import ModelChoice, require_base_url
    from robotouille_evaluation.cli.playing import play
    from robotouille_evaluation.packs.store import read_pack
    from robotouille_evaluation.runs import RunFolder, Workers

    folder = RunFolder(run_folder)
    plan = folder.plan()
    asked = {job.agent.name: job.agent for job in plan.jobs if job.agent.kind == "model"}
    require_base_url([ModelChoice.of(agent) for agent in asked.values()], base_url)
    pack = read_pack(Path(plan.pack_folder), digest=plan.pack.digest)
    planned = [_asked_otherwise(job, timeout, attempts) for job in plan.jobs]
    play(folder, pack, planned, Workers(processes, calls, scheduler))


def _asked_otherwise(job: Job, timeout: float | None, attempts: int | None) -> Job:
    """The same job, whose model is asked with more or less patience."""
    given = {"timeout": timeout, "attempts": attempts}
    changed = {name: value for name, value in given.items() if value is not None}
    return job.model_copy(update={"agent": job.agent.model_copy(update=changed)})


def _words(text: str) -> tuple[str, ...]:
    return tuple(word for word in (part.strip() for part in text.split(",")) if word)


def _require_usual(moving: RealTime) -> None:
    """Raises RobotouilleError where the world waits, and it was said how it goes on."""
    usual = type(moving)(charge="tokens:20").model_dump()
    asked = [name for name, value in moving.model_dump().items() if value != usual[name]]
    if asked:
        raise RobotouilleError(f"--{asked[0].replace('_', '-')} is for --clock realtime")


def _new_pack(out: Path, folder: Path | None) -> tuple[Path, Pack]:
    """The pack to play and where it lies; ours will lie beside the run's plan."""
    from robotouille_evaluation.packs.own import build_own_pack
    from robotouille_evaluation.packs.store import read_pack

    if folder is not None:
        return folder.resolve(), read_pack(folder)
    return (out / "pack").resolve(), build_own_pack()


def _delay_free(pack: Pack, chosen: Sequence[PackInstance], seats: int | None) -> Pack:
    """The same kitchens without delays, and how many steps they take, which is searched for."""
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
        ("data set", datasets, pack.datasets),
        ("kind of instance", kinds, get_args(InstanceKind)),
    ):
        for name in chosen:
            if name not in known:
                raise UnknownNameError(f"no {what} {name!r}{did_you_mean(name, known)}")
    found = [
        instance
        for instance in pack.instances_of(tasks or None)
        if instance.kind in kinds and (not datasets or pack.task(instance.task).dataset in datasets)
    ]
    if not found:
        raise RobotouilleError("the pack has no such instances; `robotouille pack show` lists them")
    return found


def _agent_specs(names: Iterable[str], pack: Pack, choice: ModelChoice) -> list[AgentSpec]:
    """Who plays; RobotouilleError where there is no such agent, or its model answers nobody."""
    from robotouille_evaluation.cli.models import check_model

    specs = [agent_spec(name, pack, choice) for name in names]
    if any(spec.kind == "model" for spec in specs):
        asyncio.run(check_model(choice))
    return specs


def agent_spec(name: str, pack: Pack, model: ModelChoice) -> AgentSpec:
    """Who plays, by the name; UnknownNameError where there is no such agent."""
    from robotouille_evaluation.agents.making import make_strategy
    from robotouille_evaluation.runs import AgentSpec

    if name in COMPUTED:
        return AgentSpec(name=name, kind=name)
    try:
        make_strategy(pack, name, pack.datasets[0])
    except UnknownNameError:
        if "/" not in name:
            raise
        raise _no_experiment(name, pack) from None
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


def _no_experiment(name: str, pack: Pack) -> UnknownNameError:
    """Names the nearest of the same agent and data set."""
    known = [experiment.id for experiment in pack.experiments]
    if not known:
        return UnknownNameError(
            f"no experiment {name!r}: {pack.name} has none; `--pack` names a pack that was "
            "imported (`robotouille pack import CHECKOUT`)"
        )
    group = f"{name.rpartition('/')[0]}/"
    same = [id_ for id_ in known if id_.startswith(group)]
    if not same:
        return UnknownNameError(f"no experiment {name!r}{did_you_mean(name, known)}")
    return UnknownNameError(f"no experiment {name!r}; there are {', '.join(same)}")


def _warn_of_unknown_optima(pack: Pack, planned: Iterable[Job], folder: Path) -> None:
    """Optimality is worked out when an episode is over: later it is too late."""
    wanted = {(job.instance, job.seats) for job in planned}
    unknown = [1 for name, seats in wanted if pack.instance(name).best(seats) is None]
    if unknown:
        tell(
            f"{len(unknown)} of {len(wanted)} instances have no known shortest plan: their "
            "optimality will be missing from the report; "
            f"`robotouille pack prove {folder}` comes before a run",
            err=True,
        )


def _create(
    out: Path, pack: Pack, folder: Path, planned: tuple[Job, ...], steps_to_go: bool
) -> RunFolder:
    from robotouille.release import VERSION
    from robotouille_evaluation.metrics.rows import PackId
    from robotouille_evaluation.runs import RunFolder, RunPlan

    return RunFolder.create(
        out,
        RunPlan(
            name=out.resolve().name,
            pack=PackId(name=pack.name, version=pack.version, digest=pack.digest),
            pack_folder=str(folder),
            jobs=planned,
            software=VERSION,
            steps_to_go=steps_to_go,
        ),
    )
