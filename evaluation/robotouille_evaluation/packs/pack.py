"""A pack: everything that is evaluated on, as one value with a hash.

    pack = read_pack(Path("packs/published"))
    instance = pack.instance("synchronous/0_cheese_sandwich_42")
    task = pack.load(instance)                      # a `robotouille.Task`
    steps = pack.budget(instance, "published")      # how long a run may go on

A pack holds texts, not files: it can be sent elsewhere, and two with one digest are the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, TypeVar

from robotouille import Task, World
from robotouille.domain.files import parse_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.shipped_names import names_meant
from robotouille.domain.task import build_task
from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.planning import Plan, read_plan
from robotouille_evaluation.packs.budgets import Budget, BudgetKind, own_budget, published_budget

__all__ = [
    "ExampleEpisode",
    "ExampleStep",
    "Examples",
    "Experiment",
    "InstanceKind",
    "KnownPlan",
    "Pack",
    "PackInstance",
    "PackTask",
    "Prompt",
    "canonical_json",
    "fields_of",
]

InstanceKind = Literal["default", "free", "noisy"]
"""Where objects are: as the task has them; anywhere; or moved in groups, so that it is easier."""

N = TypeVar("N")
MAX_NAMED = 10
"""Tasks that an error names."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """The first two messages to a model. The id is `GROUP/VERSION-DESCRIPTION`."""

    id: str
    system: str
    instructions: str


@dataclass(frozen=True, slots=True)
class ExampleStep:
    """One exchange of an example: what the model would be sent, and a good answer."""

    user: str
    assistant: str


@dataclass(frozen=True, slots=True)
class ExampleEpisode:
    """An episode played well, to be shown to a model."""

    name: str
    steps: tuple[ExampleStep, ...]


@dataclass(frozen=True, slots=True)
class Examples:
    """Episodes that are shown together, e.g. `synchronous/io_examples`."""

    name: str
    episodes: tuple[ExampleEpisode, ...]


@dataclass(frozen=True, slots=True)
class KnownPlan:
    """The shortest plan known for a number of players, a line for each step. Every plan takes
    `bound` steps at least; 0 says that nothing is known of that."""

    seats: int
    plan: tuple[str, ...]
    bound: int = 0

    @property
    def proven(self) -> bool:
        """Whether no plan is shorter."""
        return self.bound == len(self.plan)

    @property
    def steps(self) -> int:
        """Its length."""
        return len(self.plan)


@dataclass(frozen=True, slots=True)
class PackTask:
    """A task: the problem as its file has it.

    `optimal` is the number of steps that a run's length is compared with, for the problem as it
    is; `optimal_from` says whose number it is. A published constant need not be optimal.
    """

    name: str
    dataset: str
    problem: str
    optimal: int | None
    optimal_from: str


@dataclass(frozen=True, slots=True)
class PackInstance:
    """One layout of a task, to be played.

    `seed` is the one asked for (None for a default), `seed_used` the one that gave the layout;
    `seats` the usual number of players. `plans` has the shortest that are known.
    """

    id: str
    task: str
    kind: InstanceKind
    seed: int | None
    seed_used: int | None
    problem: str
    seats: int = 1
    plans: tuple[KnownPlan, ...] = ()

    def best(self, seats: int | None = None) -> KnownPlan | None:
        """The shortest plan known for so many players (the usual number if None), or None."""
        wanted = self.seats if seats is None else seats
        return next((found for found in self.plans if found.seats == wanted), None)

    def optimal(self, seats: int | None = None) -> int | None:
        """The proven length for so many players (the usual number if None), or None."""
        best = self.best(seats)
        return best.steps if best is not None and best.proven else None


@dataclass(frozen=True, slots=True)
class Experiment:
    """A published set-up: an agent, the tasks with their constants, the seeds, all settings.

    `settings` has `evaluation`, `game` and `llm` as the published code hands them over.
    """

    id: str
    agent: str
    tasks: tuple[str, ...]
    optimal_steps: tuple[int, ...]
    seeds: tuple[int, ...]
    settings: Mapping[str, Any]

    @property
    def prompt_ids(self) -> tuple[str, ...]:
        """The prompts that it names."""
        prompts = self.settings["llm"]["prompts"]
        named = (prompt for prompt in prompts.values() if isinstance(prompt, Mapping))
        return tuple(
            f"{p['experiment_name']}/{p.get('prompt_version')}-{p.get('prompt_description')}"
            for p in named
            if p.get("experiment_name")
        )

    @property
    def shown(self) -> tuple[str, ...]:
        """The examples that it names."""
        folder = self.settings["llm"].get("example_dir_path")
        return (folder,) if isinstance(folder, str) and folder else ()


@dataclass(frozen=True)
class Pack:
    """Tasks of one domain, their instances, and what models are told; see the module.

    `domain` is the text of a domain file that extends none.
    """

    name: str
    version: str
    domain: str
    tasks: tuple[PackTask, ...]
    instances: tuple[PackInstance, ...]
    prompts: tuple[Prompt, ...] = ()
    examples: tuple[Examples, ...] = ()
    experiments: tuple[Experiment, ...] = ()

    @cached_property
    def digest(self) -> str:
        """The SHA-256 of all of it, 64 hex digits."""
        text = json.dumps(fields_of(self), default=fields_of, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def datasets(self) -> tuple[str, ...]:
        """The data sets of its tasks, each once."""
        return tuple(dict.fromkeys(task.dataset for task in self.tasks))

    def task(self, name: str) -> PackTask:
        """The task of a name, or the only one that begins so (`synchronous/01`, `01`, `hamburger`).

        Raises:
            UnknownNameError: There is none, with the nearest name or all of the data set, or there
                are several.
        """
        found = names_meant(name, self._tasks)
        if len(found) > 1:
            raise UnknownNameError(f"{name!r} is not one task but {len(found)}: {', '.join(found)}")
        if not found:
            raise UnknownNameError(f"there is no task {name!r}{self._tasks_meant(name)}")
        return self._tasks[found[0]]

    def _tasks_meant(self, name: str) -> str:
        """The clause that names the nearest task, or those of the data set. For a number it is
        those: tasks may be numbered otherwise here."""
        dataset, _, rest = name.rpartition("/")
        near = "" if rest.isdecimal() else did_you_mean(name, self._tasks)
        listed = [task.name for task in self.tasks if task.dataset == dataset]
        return f"; {dataset} has {', '.join(listed)}" if listed and not near else near

    def instance(self, id_: str) -> PackInstance:
        """The instance of an id; UnknownNameError names the nearest."""
        return _named("instance", id_, self._instances)

    def prompt(self, id_: str) -> Prompt:
        """The prompt of an id; UnknownNameError names the nearest."""
        return _named("prompt", id_, {prompt.id: prompt for prompt in self.prompts})

    def example_set(self, name: str) -> Examples:
        """The examples of a name; UnknownNameError names the nearest."""
        return _named("examples", name, {found.name: found for found in self.examples})

    def experiment(self, id_: str) -> Experiment:
        """The experiment of an id; UnknownNameError names the nearest."""
        return _named("experiment", id_, {found.id: found for found in self.experiments})

    def instances_of(
        self, tasks: Iterable[str] | None = None, kinds: Iterable[InstanceKind] | None = None
    ) -> tuple[PackInstance, ...]:
        """The instances of some tasks (all if None) and kinds (all if None), in their order.

        Raises:
            UnknownNameError: There is no such task.
        """
        names = None if tasks is None else {self.task(name).name for name in tasks}
        wanted = None if kinds is None else set(kinds)
        return tuple(
            instance
            for instance in self.instances
            if (names is None or instance.task in names)
            and (wanted is None or instance.kind in wanted)
        )

    def load(self, instance: PackInstance | str, *, seats: int | None = None) -> Task:
        """An instance as a task of the game, called by its id.

        Raises:
            UnknownNameError: There is no such instance.
            FileError: Its problem has faults, or is not for so many seats.
        """
        if isinstance(instance, str):
            instance = self.instance(instance)
        source = f"{self.name}: {instance.id}"
        problem = validate(parse_json(instance.problem, source), ProblemFile, source)
        return build_task(instance.id, self._domain, problem, seats=seats, source=source)

    def require_seats(self, instances: Iterable[PackInstance], seats: int) -> None:
        """Raises RobotouilleError, which names the tasks, if some cannot be played by so many."""
        refused: dict[str, str] = {}
        for instance in instances:
            task = self.load(instance)
            possible = task.problem.seats or (task.seats,)
            if seats not in possible:
                refused[instance.task] = ", ".join(map(str, possible))
        if refused:
            named = [f"{task} (possible: {counts})" for task, counts in refused.items()]
            more = f"; and {len(named) - MAX_NAMED} more" if len(named) > MAX_NAMED else ""
            raise RobotouilleError(
                f"{seats} players are not possible for {'; '.join(named[:MAX_NAMED])}{more}: "
                "leave these tasks out"
            )

    def plan(self, instance: PackInstance | str, world: World) -> Plan:
        """The shortest plan known of an instance, for as many players as its world has.

        Raises:
            UnknownNameError: There is no such instance.
            RobotouilleError: No plan of it is known.
            FileError: The plan is not one of this world.
        """
        if isinstance(instance, str):
            instance = self.instance(instance)
        for found in instance.plans:
            if found.seats == len(world.players):
                return read_plan("\n".join(found.plan), world, f"{self.name}: {instance.id}")
        raise RobotouilleError(f"{instance.id}: no plan is known for {len(world.players)} players")

    def budget(
        self, instance: PackInstance, kind: BudgetKind, *, seats: int | None = None
    ) -> Budget:
        """The steps a run of an instance may take.

        Raises:
            RobotouilleError: No number is known that such a budget could be made of.
        """
        if kind == "published":
            constant = self.task(instance.task).optimal
            if constant is not None:
                return published_budget(constant)
        else:
            best = instance.best(seats)
            if best is not None:
                return own_budget(best.steps)
        missing = "constant" if kind == "published" else "known plan"
        raise RobotouilleError(f"{instance.id}: has no {missing}, so there is no {kind} budget")

    @cached_property
    def _domain(self) -> DomainFile:
        source = f"{self.name}: domain"
        return validate(parse_json(self.domain, source), DomainFile, source)

    @cached_property
    def _tasks(self) -> dict[str, PackTask]:
        return {task.name: task for task in self.tasks}

    @cached_property
    def _instances(self) -> dict[str, PackInstance]:
        return {instance.id: instance for instance in self.instances}


def fields_of(part: Any) -> dict[str, Any]:
    """The fields of a pack or one of its parts, as `default` of `json.dumps`: a copy of all of it,
    as `asdict` makes one, takes longer than its text."""
    return {field.name: getattr(part, field.name) for field in fields(part)}


def canonical_json(value: object) -> str:
    """A JSON value as packs hold it: no spaces, and the order of the file, which can matter."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _named(what: str, name: str, found: Mapping[str, N]) -> N:
    if name not in found:
        raise UnknownNameError(f"there is no {what} {name!r}{did_you_mean(name, found)}")
    return found[name]
