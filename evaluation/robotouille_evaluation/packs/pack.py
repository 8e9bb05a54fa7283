"""Pack: everything that a benchmark evaluates on, as one value with a hash.

    pack = read_pack(Path("packs/published"))
    instance = pack.instance("synchronous/0_cheese_sandwich_42")
    task = pack.load(instance)                      # a `robotouille.Task`
    budget = pack.budget(instance, "published")     # the step limit

A pack contains texts, not files, so it can be sent elsewhere. Packs with equal digests are equal,
apart from published results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field

from robotouille import Task, World
from robotouille.domain.json_files import parse_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile, Shift
from robotouille.domain.task import build_task
from robotouille.errors import RobotouilleError, UnknownNameError, did_you_mean
from robotouille.installation import matching_names
from robotouille.planning import Plan, read_plan
from robotouille_evaluation.packs.budget import (
    Budget,
    BudgetKind,
    own_budget,
    published_budget,
    shift_budget,
)
from robotouille_evaluation.packs.experiment import Experiment

InstanceKind = Literal["default", "free", "noisy"]
"""Layout of objects: as in the task, anywhere, or moved in groups, which is easier."""

PackName = Annotated[str, Field(max_length=1000)]
"""Name of a pack or a part of it. Results with longer names are refused."""

N = TypeVar("N")
MAX_NAMED = 10
"""Most tasks that an error names."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """First two messages to a model. The id is `GROUP/VERSION-DESCRIPTION`."""

    id: str
    system: str
    instructions: str


@dataclass(frozen=True, slots=True)
class ExampleStep:
    """Exchange of an example: a request and a good answer."""

    user: str
    assistant: str


@dataclass(frozen=True, slots=True)
class ExampleEpisode:
    """Well played episode that a model is shown."""

    name: str
    steps: tuple[ExampleStep, ...]


@dataclass(frozen=True, slots=True)
class Examples:
    """Episodes that are shown together, such as `synchronous/io_examples`."""

    name: str
    episodes: tuple[ExampleEpisode, ...]


@dataclass(frozen=True, slots=True)
class KnownPlan:
    """Shortest known plan for a number of players, with a line for each step.

    Every plan takes at least `bound` steps; 0 if no bound is known.
    """

    seats: int
    plan: tuple[str, ...]
    bound: int = 0

    @property
    def proven(self) -> bool:
        """True if it is proven that no plan is shorter."""
        return self.bound == len(self.plan)

    @property
    def steps(self) -> int:
        """Length of the plan."""
        return len(self.plan)


@dataclass(frozen=True, slots=True)
class PackTask:
    """Task with the text of its problem file.

    `optimal` is the number of steps to compare with, and `optimal_from` its origin. A published
    constant need not be optimal.
    """

    name: PackName
    dataset: PackName
    problem: str
    optimal: int | None
    optimal_from: str


@dataclass(frozen=True, slots=True)
class PackInstance:
    """Layout of a task.

    `seed` is the requested seed (None for the default layout) and `seed_used` the seed that gave
    the layout. `seats` is the usual number of players. `plans` are the shortest known plans.
    """

    id: PackName
    task: PackName
    kind: InstanceKind
    seed: int | None
    seed_used: int | None
    problem: str
    seats: int = 1
    plans: tuple[KnownPlan, ...] = ()

    def best(self, seats: int | None = None) -> KnownPlan | None:
        """Return the shortest known plan for a number of players, by default the usual one."""
        wanted = self.seats if seats is None else seats
        return next((found for found in self.plans if found.seats == wanted), None)

    def optimal(self, seats: int | None = None) -> int | None:
        """Return the proven optimum for a number of players, by default the usual one."""
        best = self.best(seats)
        return best.steps if best is not None and best.proven else None


@dataclass(frozen=True, slots=True)
class FigureData:
    """Published numbers behind a part of a figure, to show next to other results.

    Attributes:
        figure: `optimality`, `steps_to_go`, `repeated_transitions` or `failures`.
        player: Player of the results, such as `gpt-4o, ReAct`.
        group: `successes` or `failures`; of the figure `failures`, category and subcategory.
        values: A number for each episode; of the figure `failures`, their count.
    """

    figure: str
    dataset: str
    player: str
    group: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Pack:
    """Tasks of one domain with their instances, prompts and examples.

    `domain` is the text of a domain file that extends no other. `figures` are published results.
    """

    name: PackName
    version: PackName
    domain: str
    tasks: tuple[PackTask, ...]
    instances: tuple[PackInstance, ...]
    prompts: tuple[Prompt, ...] = ()
    examples: tuple[Examples, ...] = ()
    experiments: tuple[Experiment, ...] = ()
    figures: tuple[FigureData, ...] = ()

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that is evaluated on, in 64 hexadecimal digits."""
        content = fields_of(self)
        del content["figures"]  # Published results make no difference to other results.
        text = json.dumps(content, default=fields_of, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def datasets(self) -> tuple[str, ...]:
        """Data sets of the tasks, each once."""
        return tuple(dict.fromkeys(task.dataset for task in self.tasks))

    @cached_property
    def usual_kinds(self) -> tuple[InstanceKind, ...]:
        """Kinds of instances to evaluate on unless others are chosen: `free`, if there are any."""
        return ("free",) if self.instances_of(kinds=["free"]) else ("default",)

    def task(self, name: str) -> PackTask:
        """Return the task with a name or unambiguous part (`synchronous/01`, `01`, `hamburger`).

        Raises:
            UnknownNameError: The name is unknown or ambiguous.
        """
        found = matching_names(name, self._tasks)
        if len(found) > 1:
            raise UnknownNameError(f"{name!r} is ambiguous; choose {', '.join(found)}")
        if not found:
            raise UnknownNameError(f"unknown task {name!r}{self._suggestion(name)}")
        return self._tasks[found[0]]

    def _suggestion(self, name: str) -> str:
        """Return the end of an error that names the nearest task, those of the data set, or others.

        Numbers get the whole list, because packs may number the same task differently.
        """
        dataset, _, rest = name.rpartition("/")
        near = "" if rest.isdecimal() else did_you_mean(name, self._tasks)
        listed = [task.name for task in self.tasks if task.dataset == dataset]
        if dataset not in self.datasets and not near:
            return f"; the pack {self.name} has tasks of {', '.join(self.datasets)}"
        return f"; {dataset} has {', '.join(listed)}" if listed and not near else near

    def instance(self, id_: str) -> PackInstance:
        """Return the instance with an id, or raise UnknownNameError."""
        return _named("instance", id_, self._instances)

    def prompt(self, id_: str) -> Prompt:
        """Return the prompt with an id, or raise UnknownNameError."""
        return _named("prompt", id_, {prompt.id: prompt for prompt in self.prompts})

    def example_set(self, name: str) -> Examples:
        """Return the examples with a name, or raise UnknownNameError."""
        return _named("examples", name, {found.name: found for found in self.examples})

    def experiment(self, id_: str) -> Experiment:
        """Return the experiment with an id, or raise UnknownNameError."""
        return _named("experiment", id_, {found.id: found for found in self.experiments})

    def missing_tasks(self, experiment: Experiment) -> list[str]:
        """Return the tasks of an experiment that the pack lacks."""
        return [name for name in experiment.tasks if name not in self._tasks]

    def instances_of(
        self, tasks: Iterable[str] | None = None, kinds: Iterable[InstanceKind] | None = None
    ) -> tuple[PackInstance, ...]:
        """Return the instances of some tasks and kinds, by default of all.

        Raises:
            UnknownNameError: A task is unknown.
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
        """Return an instance as a task, named by its id.

        Raises:
            UnknownNameError: The instance is unknown.
            FileError: Its problem is invalid, or not for that many seats.
        """
        if isinstance(instance, str):
            instance = self.instance(instance)
        source = f"{self.name}: {instance.id}"
        # Validated each time: packs are read from files that anyone may have written.
        problem = validate(parse_json(instance.problem, source), ProblemFile, source)
        return build_task(instance.id, self._domain, problem, seats=seats, source=source)

    def shift(self, instance: PackInstance) -> Shift | None:
        """Return the shift of an instance; None if it has a goal."""
        # Loading takes milliseconds, and most packs have no shifts.
        return self.load(instance).problem.shift if '"shift"' in instance.problem else None

    def require_seats(self, instances: Iterable[PackInstance], seats: int) -> None:
        """Raise RobotouilleError if some tasks cannot be played by this many players."""
        impossible: dict[str, str] = {}
        for instance in instances:
            task = self.load(instance)
            possible = task.problem.seats or (task.seats,)
            if seats not in possible:
                impossible[instance.task] = ", ".join(map(str, possible))
        if impossible:
            named = [f"{task} (possible: {counts})" for task, counts in impossible.items()]
            more = f"; and {len(named) - MAX_NAMED} more" if len(named) > MAX_NAMED else ""
            raise RobotouilleError(
                f"{seats} players are not possible for {'; '.join(named[:MAX_NAMED])}{more}: "
                "exclude these tasks"
            )

    def plan(self, instance: PackInstance | str, world: World) -> Plan:
        """Return the shortest known plan of an instance for the number of players in its world.

        Raises:
            UnknownNameError: The instance is unknown.
            RobotouilleError: No plan is known.
            FileError: The plan does not fit the world.
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
        """Return the step budget of an instance.

        Raises:
            RobotouilleError: The instance has no constant, known plan or shift for this kind of
                budget.
        """
        if kind == "shift":
            shift = self.shift(instance)
            if shift is not None:
                return shift_budget(shift.steps)
        elif kind == "published":
            constant = self.task(instance.task).optimal
            if constant is not None:
                return published_budget(constant)
        else:
            best = instance.best(seats)
            if best is not None:
                return own_budget(best.steps)
        missing = {"published": "constant", "own": "known plan", "shift": "shift"}[kind]
        prove = "; find plans with `robotouille pack prove`" if kind == "own" else ""
        raise RobotouilleError(f"{instance.id}: no {missing}, so no {kind} budget{prove}")

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
    """Return the fields of a pack or one of its parts, for `default` of `json.dumps`.

    `asdict` would copy all of it, which takes longer than writing its JSON.
    """
    return {field.name: getattr(part, field.name) for field in fields(part)}


def canonical_json(value: object) -> str:
    """Return JSON without spaces, in the order of the value, which can matter."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _named(what: str, name: str, found: Mapping[str, N]) -> N:
    if name not in found:
        raise UnknownNameError(f"unknown {what} {name!r}{did_you_mean(name, found)}")
    return found[name]
