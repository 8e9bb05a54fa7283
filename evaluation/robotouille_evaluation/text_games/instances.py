"""Instances of tasks for text games: shipped ones to test on, and endless ones to train on.

find = Instances("synchronous", "train")
instance = load_instance(find.name(0))      # synchronous/01_cheese_sandwich#1000
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, get_args

from robotouille import Task, World, load_certificate, load_task, task_names
from robotouille.errors import FileError, WrongArgumentError, did_you_mean
from robotouille.generation import Kind, generator_of
from robotouille.generation.generator import kind_at
from robotouille.installation import matching_names
from robotouille.planning import Plan, read_plan
from robotouille_evaluation.packs import Budget, KnownPlan, own_budget
from robotouille_evaluation.packs.budget import shift_budget
from robotouille_evaluation.packs.own import SHIFTS

Split = Literal["train", "test"]
"""`test`: the instances of the benchmark. `train`: endless others, generated from seeds."""

SPLITS: tuple[Split, ...] = get_args(Split)
DATASETS = ("synchronous", "asynchronous", "multi_agent", SHIFTS)

FIRST_SEED = 1000
"""First seed of the split `train`. The shipped instances have the seeds 42 to 630."""
MAX_SEED = 10**9
MAX_LOADED = 64
"""Maximum number of instances that a process keeps, because generating one may take seconds."""


@dataclass(frozen=True, slots=True)
class GameInstance:
    """Instance of a task, with the shortest known plan, which shifts lack."""

    name: str
    dataset: str
    task: Task
    known: KnownPlan | None = None

    @property
    def optimum(self) -> int | None:
        """Proven number of steps of the shortest plan."""
        return self.known.steps if self.known is not None and self.known.proven else None

    @property
    def budget(self) -> Budget:
        """Step budget: 1.5 times the known plan, or the length of a shift."""
        shift = self.task.problem.shift
        return shift_budget(shift.steps) if shift is not None else own_budget(self._plan().steps)

    def plan(self, world: World) -> Plan:
        """Return the shortest known plan in a world of the task."""
        return read_plan("\n".join(self._plan().plan), world, self.name)

    def _plan(self) -> KnownPlan:
        if self.known is None:
            raise WrongArgumentError(f"{self.name} has no goal, so it has no plan")
        return self.known


class Instances:
    """Names of the instances of a data set, in an order that alternates between its tasks.

    Args:
        dataset: One of `DATASETS`.
        tasks: Tasks of the data set by name, number or dish; all if empty.

    Raises:
        WrongArgumentError: Data set, split or a task is unknown.
    """

    def __init__(self, dataset: str, split: str = "test", tasks: Sequence[str] = ()) -> None:
        require_known("dataset", dataset, DATASETS)
        require_known("split", split, SPLITS)
        self.dataset, self.split = dataset, split
        self._tasks = _chosen_tasks(dataset, tasks)
        self._shipped = tuple(self._shipped_names()) if split == "test" else ()

    @property
    def endless(self) -> bool:
        """True if there is an instance for every number."""
        return self.split == "train"

    def __len__(self) -> int:
        """Return the number of instances. Raises TypeError if they are endless."""
        if self.endless:
            raise TypeError("the split train is endless")
        return len(self._shipped)

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        numbers = itertools.count() if self.endless else range(len(self))
        return map(self.name, numbers)

    def name(self, index: int) -> str:
        """Return the name of an instance by its number, from 0.

        Raises:
            IndexError: There is no such instance.
        """
        if not self.endless:
            if not 0 <= index < len(self):
                raise IndexError(
                    f"{self.dataset}/{self.split} has the instances 0 to {len(self) - 1}, "
                    f"not {index}"
                )
            return self._shipped[index]
        turn, place = divmod(index, len(self._tasks))
        seed = FIRST_SEED + turn
        if not FIRST_SEED <= seed <= MAX_SEED:
            raise IndexError(f"{self.dataset}/{self.split} has no instance {index}")
        return f"{self._tasks[place]}#{seed}"

    def _shipped_names(self) -> Iterator[str]:
        if self.dataset == SHIFTS:
            yield from self._tasks
            return
        of_tasks = [
            [
                name
                for position, name in enumerate(load_task(task).instances(), start=1)
                if kind_at(position) is Kind.FREE
            ]
            for task in self._tasks
        ]
        for row in zip(*of_tasks, strict=True):
            yield from row


def require_known(what: str, found: str, known: Collection[str]) -> None:
    """Check that a name is known.

    Raises:
        WrongArgumentError: It is not.
    """
    if found not in known:
        listed = ", ".join(repr(name) for name in known)
        near = did_you_mean(found, known) or f"; expected one of {listed}"
        raise WrongArgumentError(f"unknown {what} {found!r}{near}")


def _chosen_tasks(dataset: str, wanted: Sequence[str]) -> tuple[str, ...]:
    names = [name for name in task_names() if name.startswith(f"{dataset}/")]
    chosen = []
    for word in wanted:
        full = word if word.startswith(f"{dataset}/") else f"{dataset}/{word}"
        found = matching_names(full, names)
        if len(found) != 1:
            near = "" if word.isdecimal() else did_you_mean(full, names)
            near = near or f"; {dataset} has {', '.join(names)}"
            raise WrongArgumentError(f"{word!r} is not one task of {dataset}{near}")
        chosen += found
    return tuple(dict.fromkeys(chosen)) or tuple(names)


NAME = re.compile(r"(?P<task>[^#@]{1,200})(?:@(?P<seats>[0-9]{1,2}))?(?:#(?P<seed>[0-9]{1,9}))?")


@lru_cache(maxsize=MAX_LOADED)
def load_instance(name: str, seats: int | None = None) -> GameInstance:
    """Return a shipped task, a shipped instance of it, or a new one.

    Args:
        name: Name for `load_task` (`synchronous/01`, `multi_agent/02@3`), and for a new instance
            `#` and its seed. Files are not read.
        seats: Number of players; by default, the task's.

    Raises:
        WrongArgumentError: The name is not of this form.
        RobotouilleError: There is no such task, or it is not for this many players.
    """
    parts = NAME.fullmatch(name)
    if parts is None:
        raise WrongArgumentError(
            f"{name[:80]!r} is not an instance; expected a task's name such as synchronous/01, "
            "or with a seed synchronous/01#1000"
        )
    if parts["seats"]:
        seats = int(parts["seats"])
    task = load_task(parts["task"], seats=seats, files=False)
    if parts["seed"] is not None:
        return _generated(task, int(parts["seed"]))
    known = None if task.problem.shift is not None else _certified(task)
    return GameInstance(task.name, _dataset(task.name), task, known)


def _dataset(name: str) -> str:
    return name.removeprefix("generated/").partition("/")[0]


def _certified(task: Task) -> KnownPlan:
    try:
        certificate = load_certificate(task)
    except FileError as error:
        raise WrongArgumentError(
            f"{task.name} has no certified plan for {task.seats} players, so it has no step "
            f"budget: {error}"
        ) from None
    if certificate.plan is None:
        raise WrongArgumentError(f"{task.name} has no plan for {task.seats} players")
    return KnownPlan(task.seats, certificate.plan, certificate.bound)


def _generated(task: Task, seed: int) -> GameInstance:
    # Proofs for other numbers of players would take seconds more.
    alone = task.problem.model_copy(update={"seats": (task.seats,)})
    made = generator_of(replace(task, problem=alone)).instance(seed)
    name = f"{task.name}#{seed}"
    new = replace(made.task, name=name, seats=task.seats)
    if task.problem.shift is not None:
        return GameInstance(name, _dataset(task.name), new)
    lines = tuple(made.plan_text(task.seats).splitlines())
    steps = tuple(line for line in lines if line and not line.startswith("#"))
    found = made.results[task.seats]
    return GameInstance(name, _dataset(task.name), new, KnownPlan(task.seats, steps, found.bound))
