"""What an environment's options may be, and what they may not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypedDict, TypeVar

from robotouille.domain.loading import load_task
from robotouille.domain.task import Task
from robotouille.errors import WrongArgumentError
from robotouille.world.world import State

__all__ = ["EnvOptions", "EnvRules", "InvalidAction", "Observation", "Reward"]

MAX_STEPS = 300
"""Steps after which an episode is truncated, where nothing else is asked for."""


class Observation(StrEnum):
    """What an agent sees: `State.vector()`, `State.graph()` or `State.text_view(player)`."""

    VECTOR = "vector"
    GRAPH = "graph"
    TEXT = "text"


class Reward(StrEnum):
    """`SPARSE`: 1 on the step that reaches the goal, else 0. `SHAPED`: that, and what the step has
    gained in potential."""

    SPARSE = "sparse"
    SHAPED = "shaped"


class InvalidAction(StrEnum):
    """What an action that is not valid comes to. `REJECT`: it changes nothing, and costs a step as
    doing nothing does. `RAISE`: an `InapplicableError`, and no step is taken."""

    REJECT = "reject"
    RAISE = "raise"


Choice = TypeVar("Choice", bound=StrEnum)


class EnvOptions(TypedDict, total=False):
    """The options of all environments.

    - `observation`: `vector`, `graph` or `text`: what is seen.
    - `reward`: `sparse`, 1 on the step that reaches the goal, else 0; or `shaped`, that and
      `weight * (gamma * potential(after) - potential(before))`.
    - `gamma`: the learner's discount, for a shaped reward: above 0, at most 1; 0.99 by default.
    - `weight`: of what is gained in potential; 1 by default.
    - `potential`: how good a state is; by default `StepsToGoPotential`.
    - `invalid`: `reject`, an action that is not valid changes nothing, and costs a step; or
      `raise`, it is an `InapplicableError`, and no step is taken.
    - `max_steps`: the step budget, 300 by default: an episode is truncated after so many steps.
    - `instances`: other instances (tasks, or names) that `reset` chooses from, the task among
      them; or `generated` for those that are shipped (`Task.instances()`).
    - `slots`: for how many created objects of a kind arrays have room; see `World`.
    """

    observation: Observation | str
    reward: Reward | str
    gamma: float
    weight: float
    potential: Callable[[State], float] | None
    invalid: InvalidAction | str
    max_steps: int
    instances: Sequence[Task | str] | str
    slots: Mapping[str, int] | None


@dataclass(frozen=True)
class EnvRules:
    """A task, and `EnvOptions` that have been looked at.

    Raises:
        WrongArgumentError: An option is none of what it may be.
    """

    task: Task | str
    observation: Observation | str = Observation.VECTOR
    reward: Reward | str = Reward.SPARSE
    gamma: float = 0.99
    weight: float = 1.0
    potential: Callable[[State], float] | None = None
    invalid: InvalidAction | str = InvalidAction.REJECT
    max_steps: int = MAX_STEPS
    instances: Sequence[Task | str] | str = ()
    slots: Mapping[str, int] | None = None

    def __post_init__(self) -> None:
        for name, kind in (
            ("observation", Observation), ("reward", Reward), ("invalid", InvalidAction),
        ):  # fmt: skip
            object.__setattr__(self, name, _one_of(kind, name, getattr(self, name)))
        if isinstance(self.max_steps, bool) or not isinstance(self.max_steps, int):
            raise WrongArgumentError(f"max_steps: expected an integer, found {self.max_steps!r}")
        if self.max_steps < 1:
            raise WrongArgumentError(f"max_steps: expected 1 or more, found {self.max_steps}")
        if not (_is_number(self.gamma) and 0 < self.gamma <= 1):
            raise WrongArgumentError(f"gamma: expected above 0 and at most 1, found {self.gamma!r}")
        if not (_is_number(self.weight) and math.isfinite(self.weight)):
            raise WrongArgumentError(f"weight: expected a number, found {self.weight!r}")

    def tasks(self) -> tuple[Task, ...]:
        """The task, then the other instances that there are.

        Raises:
            WrongArgumentError: They are for another number of players.
            UnknownTaskError: There is no such task or instance.
            FileError: A task's files are wrong.
        """
        task = _loaded(self.task)
        if isinstance(self.instances, str):
            if self.instances != "generated":
                found = repr(self.instances)
                raise WrongArgumentError(
                    f"instances: expected 'generated' or a list, found {found}"
                )
            others = [load_task(name, seats=task.seats) for name in task.instances()]
        else:
            others = [_loaded(each) for each in self.instances]
        tasks = {each.digest: each for each in (task, *others)}
        if wrong := [each for each in tasks.values() if each.seats != task.seats]:
            raise WrongArgumentError(f"instances: {wrong[0].name} has {wrong[0].seats} seats")
        return tuple(tasks.values())


def _loaded(task: Task | str) -> Task:
    return task if isinstance(task, Task) else load_task(task)


def _one_of(kind: type[Choice], name: str, found: object) -> Choice:
    try:
        return kind(str(found))
    except ValueError:
        names = ", ".join(repr(str(each)) for each in kind)
        raise WrongArgumentError(f"{name}: expected one of {names}, found {found!r}") from None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not math.isnan(value)
