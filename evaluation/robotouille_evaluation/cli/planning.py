"""Jobs of a new run, from the command's options and the settings of published experiments."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from rich.console import Console

from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.installation import matching_names
from robotouille.terminal import tell
from robotouille_client.bots.own_policy import own_policy_maker
from robotouille_evaluation.agents.custom import (
    asks_a_model,
    broken_agents,
    installed_agents,
    is_custom,
)
from robotouille_evaluation.agents.making import OWN_STRATEGIES, STRATEGY_WORDS, make_strategy
from robotouille_evaluation.cli.models import ModelChoice, check_model
from robotouille_evaluation.cli.run_options import RunOptions
from robotouille_evaluation.packs.built_in import find_pack, is_built_in
from robotouille_evaluation.packs.delay_free import delay_free
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.own import pack_with
from robotouille_evaluation.packs.pack import InstanceKind, Pack, PackInstance
from robotouille_evaluation.realtime import LatePolicy
from robotouille_evaluation.runs import AgentSpec, EpisodeJob, JobOptions, RealTime, plan_jobs
from robotouille_evaluation.runs.budgets import BudgetedInstances, with_budget
from robotouille_evaluation.runs.chance import PROBABILITIES
from robotouille_evaluation.runs.job_list import Variant, model_agent_name, sampling_words

COMPUTED = {
    "planner": "follows a plan, and plans again when others are in its way",
    "random": "takes random valid actions",
    "scripted": "carries out the best plan of the pack",
}
"""Agents without a model, which are the default, and what each does."""
MAX_NAMED = 20
"""Most agents that an error names."""
HUMAN = "human"
"""Agent of published experiments that a person plays."""


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """Jobs of a run with their pack and its folder.

    `own_folder` is True if the pack is part of the run and must be written.
    """

    pack: Pack
    folder: Path
    jobs: tuple[EpisodeJob, ...]
    own_folder: bool


def plan_run(out: Path, options: RunOptions) -> PlannedRun:
    """Return what a new run in the folder `out` plays.

    Raises:
        RobotouilleError: An option is invalid, or does not fit the pack or another option.
    """
    real_time = _real_time(options)
    folder, pack = _pack(out, options)
    experiments = [
        experiment
        for name in comma_separated(options.experiment)
        for experiment in _experiments(pack, name)
    ]
    if options.variant == "delay-free":
        if experiments:
            raise RobotouilleError(
                "published step budgets are for kitchens with delays: choose --experiment or "
                "--variant delay-free"
            )
        chosen = _instances(pack, options, None)
        folder, pack = (out / "pack").resolve(), _without_delays(pack, chosen, options.seats)
    jobs: dict[tuple[str, float], EpisodeJob] = {}
    settings: Sequence[Experiment | None] = experiments or [None]
    for experiment in settings:
        for job in _jobs(pack, options, experiment, real_time):
            jobs.setdefault(_episode(pack, job), job)
    own_folder = folder == (out / "pack").resolve()
    return PlannedRun(pack, folder, tuple(jobs.values()), own_folder)


def _episode(pack: Pack, job: EpisodeJob) -> tuple[str, float]:
    """Return what is equal for jobs of several experiments that play the same episode.

    Without this, `--agents planner` would play it once for each experiment, and a report would
    count all of these episodes.
    """
    return job.model_copy(update={"experiment": ""}).id, job.step_budget(pack).steps


def comma_separated(text: str) -> tuple[str, ...]:
    """Return the words of an option."""
    return tuple(word for word in (part.strip() for part in text.split(",")) if word)


def _real_time(options: RunOptions) -> RealTime | None:
    """Return the real time settings, or None if the world waits.

    Raises:
        RobotouilleError: The world waits, and an option for real time is set.
    """
    chosen = RealTime(
        step_rate=options.step_rate,
        charge=options.charge,
        late=LatePolicy(options.late),
        helper=options.helper,
        digest_tokens=options.digest_tokens,
        max_age=options.max_age,
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


def _pack(out: Path, options: RunOptions) -> tuple[Path, Pack]:
    """Return the pack and its folder. A run keeps a copy of a built-in pack."""
    copy = (out / "pack").resolve()
    if options.pack is None:
        return copy, pack_with(comma_separated(options.datasets) or comma_separated(options.tasks))
    folder = copy if is_built_in(options.pack) else options.pack.resolve()
    return folder, find_pack(options.pack)


def _without_delays(pack: Pack, chosen: Sequence[PackInstance], seats: int | None) -> Pack:
    console = Console(stderr=True)
    with console.status("") as status:
        return delay_free(
            pack,
            chosen,
            lambda done, total: status.update(f"planned {done} of {total} instances"),
            seats,
        )


def _jobs(
    pack: Pack, options: RunOptions, experiment: Experiment | None, real_time: RealTime | None
) -> Iterator[EpisodeJob]:
    """Yield the jobs of an experiment, or those of the options alone."""
    budgeted = _with_budget(pack, _instances(pack, options, experiment), options, experiment)
    choice = ModelChoice.of_options(options)
    names = comma_separated(options.agents)
    variant: Variant | None = "" if options.variant == "none" else options.variant
    if experiment is not None:
        if experiment.temperature is not None:
            sampling = {"temperature": experiment.temperature, **choice.parameters}
            choice = replace(choice, parameters=sampling)
        names = names or (experiment.id,)
        if variant is None:
            variant = "stochastic" if experiment.stochastic else ""
        tell(_settings_line(pack, experiment, budgeted, choice, variant), err=True)
    else:
        _warn_of_other_tasks(pack, names, budgeted.instances)
    job_options = JobOptions(
        seeds=range(options.seeds),
        seats=options.seats,
        budget=budgeted.rule,
        variant=variant,
        real_time=real_time,
        control=options.control,
        experiment="" if experiment is None else experiment.id,
    )
    agents = _agent_specs(names or COMPUTED, pack, choice)
    yield from plan_jobs(pack, agents, budgeted.instances, job_options)


# Experiments


def _experiments(pack: Pack, name: str) -> list[Experiment]:
    """Return the experiment with an id, or all below a folder such as `ReAct/ablations`."""
    below = [
        experiment
        for experiment in pack.experiments
        if experiment.id.startswith(f"{name}/") and experiment.agent != HUMAN
    ]
    return below or [_experiment(pack, name)]


def _experiment(pack: Pack, id_: str) -> Experiment:
    """Return an experiment that a model can play, or raise RobotouilleError."""
    found = next((each for each in pack.experiments if each.id == id_), None)
    if found is None:
        raise _unknown_experiment(id_, pack)
    if found.agent == HUMAN:
        raise RobotouilleError(
            f"{id_} is played by a person and not by a model; see `robotouille play`"
        )
    return found


def _settings_line(
    pack: Pack,
    experiment: Experiment,
    budgeted: BudgetedInstances,
    choice: ModelChoice,
    variant: Variant,
) -> str:
    """Return a line about the conditions of an experiment, after replaced settings."""
    tasks = {instance.task for instance in budgeted.instances}
    chance = PROBABILITIES.get(variant, 0)
    sampling = sampling_words(choice.parameters) or "temperature of the endpoint"
    # `synchronous/1_lettuce_sandwich` becomes `synchronous/1`, as in `--tasks`.
    missing = [name.partition("_")[0] for name in pack.missing_tasks(experiment)]
    absent = f" (not in the pack: {', '.join(missing)})" if missing else ""
    return (
        f"{experiment.id}: tasks {len(tasks)} of {len(experiment.tasks)}{absent}, "
        f"instances {len(budgeted.instances)}, {sampling}, step budget {budgeted.rule}, "
        f"chance of a reversal {chance:g}"
    )


def _warn_of_other_tasks(
    pack: Pack, names: Iterable[str], instances: Iterable[PackInstance]
) -> None:
    """Report experiments that are agents for tasks that they do not have."""
    tasks = {instance.task for instance in instances}
    for experiment in pack.experiments:
        if experiment.id in names and not tasks <= set(experiment.tasks):
            tell(
                f"{experiment.id} was not published for all of these tasks, and its own "
                f"temperature and step budget do not apply; --experiment {experiment.id} plays it "
                "as published",
                err=True,
            )


# Instances


def _instances(
    pack: Pack, options: RunOptions, experiment: Experiment | None
) -> list[PackInstance]:
    """Return the chosen instances, or raise RobotouilleError."""
    datasets, tasks, kinds = map(comma_separated, (options.datasets, options.tasks, options.kinds))
    usual = pack.usual_kinds
    if experiment is not None:
        usual = ("noisy",) if experiment.noisy else ("free",)
    _check_names("data set", datasets, pack.datasets)
    _check_names("kind of instance", kinds, get_args(InstanceKind))
    if experiment is not None:
        known, missing = [task.name for task in pack.tasks], pack.missing_tasks(experiment)
        # The line about the experiment names its tasks that the pack lacks.
        tasks = tuple(
            name
            for name in tasks or experiment.tasks
            if matching_names(name, known) or not matching_names(name, missing)
        )
        if not tasks:
            raise RobotouilleError(f"the pack has no such task of {experiment.id}")
    found = [
        instance
        for instance in pack.instances_of(tasks or None)
        if instance.kind in (kinds or usual)
        and (not datasets or pack.task(instance.task).dataset in datasets)
    ]
    wanted = comma_separated(options.instances)
    if wanted:
        found = _named_instances(found, wanted)
    elif experiment is not None:
        found = [each for each in found if each.seed is None or each.seed in experiment.seeds]
    if not found:
        raise RobotouilleError("the pack has no such instances; see `robotouille pack show`")
    return _first_of_each(found, options.limit)


def _check_names(what: str, chosen: Iterable[str], known: Sequence[str]) -> None:
    for name in chosen:
        if name not in known:
            near = did_you_mean(name, known) or f"; choose {', '.join(known)}"
            raise UnknownNameError(f"unknown {what} {name!r}{near}")


def _named_instances(found: Sequence[PackInstance], wanted: Iterable[str]) -> list[PackInstance]:
    """Return the instances with these ids or seeds, or raise UnknownNameError."""
    chosen: dict[str, PackInstance] = {}
    for word in wanted:
        named = [each for each in found if word in (each.id, str(each.seed))]
        if not named:
            seeds = sorted({each.seed for each in found if each.seed is not None})
            known = ", ".join(map(str, seeds)) or ", ".join(each.id for each in found[:5])
            raise UnknownNameError(f"no chosen task has the instance {word!r}; choose {known}")
        chosen |= {each.id: each for each in named}
    return [each for each in found if each.id in chosen]


def _first_of_each(found: Sequence[PackInstance], limit: int | None) -> list[PackInstance]:
    """Return at most `limit` instances of each task."""
    kept: dict[str, list[PackInstance]] = {}
    for instance in found:
        kept.setdefault(instance.task, []).append(instance)
    return [instance for each in kept.values() for instance in each[:limit]]


def _with_budget(
    pack: Pack, chosen: Sequence[PackInstance], options: RunOptions, experiment: Experiment | None
) -> BudgetedInstances:
    """Return the instances that have a step budget, and report the others in a line."""
    if options.seats is not None:
        pack.require_seats(chosen, options.seats)
    rule = options.budget
    if rule is None and experiment is not None:
        rule = "published"
    elif rule is None and options.variant == "delay-free":
        rule = "own"  # The plans come from a search, which may not find all of them.
    found = with_budget(pack, chosen, rule, options.seats)
    if found.left_out:
        tell(str(found), err=True)
    return found


# Agents


def _agent_specs(names: Iterable[str], pack: Pack, choice: ModelChoice) -> list[AgentSpec]:
    """Return the agents, after a check that their model can be asked."""
    specs = [agent_spec(name, pack, choice) for name in names]
    if any(spec.kind == "model" for spec in specs):
        asyncio.run(check_model(choice))
    return specs


def agent_spec(name: str, pack: Pack, model: ModelChoice) -> AgentSpec:
    """Return the agent with a name, or raise UnknownNameError."""
    if name in COMPUTED:
        return AgentSpec.model_validate({"name": name, "kind": name})
    published = any(experiment.id == name for experiment in pack.experiments)
    if not published and name not in OWN_STRATEGIES:
        # Rows have the module and class: they stay the same if another package takes the name.
        name = installed_agents().get(name, name)
    if is_custom(name) and not asks_a_model(name):
        own_policy_maker(name)  # raises an error if it is not a policy
        return AgentSpec(name=name, kind="custom")
    _check_strategy(name, pack)
    make_strategy(pack, name, pack.datasets[0])  # raises an error if the pack lacks its prompt
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


def require_agents(agents: Iterable[AgentSpec], confirmed: Collection[str]) -> None:
    """Require that the user confirms the agents MODULE:NAME that a run's file names.

    Runs can come from other people, and their file could name any module, also one in its folder.

    Raises:
        RobotouilleError: The code of an agent is neither confirmed nor from an installed agent.
    """
    names = (spec.name if spec.kind == "custom" else spec.strategy for spec in agents)
    known = {*confirmed, *installed_agents().values()}
    wanted = [name for name in dict.fromkeys(filter(is_custom, names)) if name not in known]
    if wanted:
        raise RobotouilleError(
            f"the run would run the code of {', '.join(wanted[:MAX_NAMED])}; if you trust it, add "
            f"--agents {','.join(wanted[:MAX_NAMED])}"
        )


def _check_strategy(name: str, pack: Pack) -> None:
    """Raise UnknownNameError if no strategy has this name."""
    experiments = {experiment.id: experiment for experiment in pack.experiments}
    if name in experiments:
        _experiment(pack, name)
    elif name.endswith(".npz"):
        raise RobotouilleError(
            f"{name}: a trained policy plays only the kitchen of its training; evaluate it with "
            f"`robotouille cross-play TASK {name}`"
        )
    elif "/" in name:
        raise _unknown_experiment(name, pack)
    elif name in (broken := broken_agents()) and name not in OWN_STRATEGIES:
        raise RobotouilleError(f"the agent {name!r} cannot be used: {broken[name]}")
    elif name not in OWN_STRATEGIES and not is_custom(name):
        known = [*COMPUTED, *OWN_STRATEGIES, *installed_agents(), *experiments]
        near = did_you_mean(name, known) or f"; choose {', '.join(known)}, or MODULE:NAME"
        raise UnknownNameError(f"no agent {name!r}{near}")


def _unknown_experiment(name: str, pack: Pack) -> UnknownNameError:
    """Return an error that names the experiments of the same agent and data set."""
    known = [experiment.id for experiment in pack.experiments if experiment.agent != HUMAN]
    if not known:
        return UnknownNameError(
            f"unknown experiment {name!r}: {pack.name} has no experiments; use --pack with "
            "an imported one (`robotouille pack import CHECKOUT`)"
        )
    group = f"{name.rpartition('/')[0]}/"
    same = [id_ for id_ in known if id_.startswith(group)]
    if not same:
        return UnknownNameError(f"unknown experiment {name!r}{did_you_mean(name, known)}")
    return UnknownNameError(f"unknown experiment {name!r}; choose {', '.join(same)}")


def agent_lines(experiments: Iterable[Experiment]) -> Iterator[tuple[str, str]]:
    """Yield the name of each agent, and in a line what it does."""
    yield from COMPUTED.items()
    yield from STRATEGY_WORDS.items()
    for name, target in installed_agents().items():
        if name not in (*COMPUTED, *OWN_STRATEGIES):
            yield name, f"installed: {target}"
    for name, why in broken_agents().items():
        if name not in (*COMPUTED, *OWN_STRATEGIES):
            yield name, f"cannot be used: {why}"
    for experiment in experiments:
        if experiment.agent != HUMAN:
            tasks = len(experiment.tasks)
            yield experiment.id, f"published experiment: {experiment.agent} on {tasks} tasks"
