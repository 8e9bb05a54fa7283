"""Options of environments and their validation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypedDict, TypeVar

import numpy as np
import numpy.typing as npt

from robotouille.domain.loading import load_task
from robotouille.domain.task import Task
from robotouille.envs.levels import Level
from robotouille.errors import RobotouilleError, WrongArgumentError, did_you_mean
from robotouille.world.sight import Sight
from robotouille.world.world import State, World

RENDER_MODES = ("ansi", "rgb_array")

ENDLESS = "endless"
"""Value of `instances` for a new first state in each episode."""

MAX_TOKENS = 1000
"""Most messages that an agent can choose from. Each is a column of the observations."""

MAX_STEPS = 300
"""Default number of steps after which an episode of a task with a goal is truncated."""


class EnvObservation(StrEnum):
    """Kind of observation: `State.vector()`, `State.graph()` or `State.text_view(player)`."""

    VECTOR = "vector"
    GRAPH = "graph"
    TEXT = "text"


class Perspective(StrEnum):
    """Difference between the agents' vectors and graphs.

    `SHARED`: none. `IDENTITY`: they mark the agent's own player. `EGOCENTRIC`: the agent's own
    player is in the place of the first one, and the others follow in the order of seats.
    """

    SHARED = "shared"
    IDENTITY = "identity"
    EGOCENTRIC = "egocentric"


class Reward(StrEnum):
    """Rewards of a step.

    `SPARSE` is 1 on the step that reaches the goal, otherwise 0. `SHAPED` adds the step's gain in
    potential.
    """

    SPARSE = "sparse"
    SHAPED = "shaped"


class InvalidAction(StrEnum):
    """Treatment of actions that are not valid.

    `REJECT`: the action changes nothing and costs a step. `RAISE`: an `InapplicableError` is raised
    and no step is taken.
    """

    REJECT = "reject"
    RAISE = "raise"


Choice = TypeVar("Choice", bound=StrEnum)


class EnvOptions(TypedDict, total=False):
    """Options of all environments.

    - `observation`: `vector`, `graph` or `text`.
    - `perspective`: `shared`, `identity` or `egocentric`. By default it is `identity` if each of
      several players is an agent, else `shared`.
    - `goal`: True if vectors contain which conditions of the goal hold, and graphs the things that
      the goal needs; False by default. Texts always contain the conditions.
    - `tokens`: number of different messages that an agent can send to the others with an action; 0
      by default. Only environments with an agent for each player have messages.
    - `sight`: a `Sight`, so that each agent observes what its player sees; None by default.
    - `reward`: `sparse` is 1 on the step that reaches the goal, else 0. `shaped` adds `weight *
      (gamma * potential(after) - potential(before))`.
    - `gamma`: the learner's discount for a shaped reward, above 0 and at most 1; 0.99 by default.
    - `weight`: the weight of the potential; 1 by default.
    - `potential`: a function of a state; `StepsToGoPotential` by default.
    - `invalid`: `reject` (an action that is not valid changes nothing and costs a step) or `raise`
      (it raises an `InapplicableError` and no step is taken).
    - `max_steps`: the step budget, after which an episode is truncated; by default the length of a
      shift, and 300 for other tasks.
    - `instances`: other instances (tasks or names) from which `reset` chooses, in addition to the
      task; or `generated` for the shipped ones (`Task.instances()`); or `endless` for a new first
      state in each episode (`shuffled`).
    - `levels`: kitchens for the task. `reset(options={"level": i})` selects one until the next such
      call; the first one is selected at the beginning.
    - `slots`: the room in arrays for created objects of each kind; see `World`.
    """

    observation: EnvObservation | str
    perspective: Perspective | str | None
    goal: bool
    tokens: int
    sight: Sight | None
    reward: Reward | str
    gamma: float
    weight: float
    potential: Callable[[State], float] | None
    invalid: InvalidAction | str
    max_steps: int | None
    instances: Sequence[Task | str] | str
    levels: Sequence[Level]
    slots: Mapping[str, int] | None


@dataclass(frozen=True)
class EnvRules:
    """A task with validated `EnvOptions`.

    Raises:
        WrongArgumentError: An option is invalid.
    """

    task: Task | str
    observation: EnvObservation | str = EnvObservation.VECTOR
    perspective: Perspective | str | None = None
    goal: bool = False
    tokens: int = 0
    sight: Sight | None = None
    reward: Reward | str = Reward.SPARSE
    gamma: float = 0.99
    weight: float = 1.0
    potential: Callable[[State], float] | None = None
    invalid: InvalidAction | str = InvalidAction.REJECT
    max_steps: int | None = None
    instances: Sequence[Task | str] | str = ()
    levels: Sequence[Level] = ()
    slots: Mapping[str, int] | None = None

    @classmethod
    def of(cls, task: Task | str, options: EnvOptions) -> EnvRules:
        """Return a task with options.

        Raises:
            WrongArgumentError: An option is unknown or invalid.
        """
        for name in options:
            if name not in EnvOptions.__annotations__:
                near = did_you_mean(name, EnvOptions.__annotations__)
                raise WrongArgumentError(f"unknown option {name!r}{near}")
        return cls(task, **options)

    def __post_init__(self) -> None:
        for name, kind in (
            ("observation", EnvObservation), ("reward", Reward), ("invalid", InvalidAction),
        ):  # fmt: skip
            object.__setattr__(self, name, _one_of(kind, name, getattr(self, name)))
        if self.perspective is not None:
            object.__setattr__(
                self, "perspective", _one_of(Perspective, "perspective", self.perspective)
            )
        if not isinstance(self.instances, Iterable):
            raise WrongArgumentError(f"instances: expected a list, found {self.instances!r}")
        levels = self.levels if isinstance(self.levels, Iterable) else [self.levels]
        if not all(isinstance(level, Level) for level in levels):
            raise WrongArgumentError(f"levels: expected a list of Level, found {self.levels!r}")
        if type(self.tokens) is not int or not 0 <= self.tokens <= MAX_TOKENS:
            raise WrongArgumentError(f"tokens: expected 0 to {MAX_TOKENS}, found {self.tokens!r}")
        if not isinstance(self.sight, Sight | None):
            raise WrongArgumentError(f"sight: expected a Sight, found {self.sight!r}")
        if not isinstance(self.goal, bool):
            raise WrongArgumentError(f"goal: expected True or False, found {self.goal!r}")
        limit = self.max_steps
        if isinstance(limit, bool) or not isinstance(limit, int | None):
            raise WrongArgumentError(f"max_steps: expected an integer, found {limit!r}")
        if limit is not None and limit < 1:
            raise WrongArgumentError(f"max_steps: expected 1 or more, found {limit}")
        if not (_is_number(self.gamma) and 0 < self.gamma <= 1):
            raise WrongArgumentError(f"gamma: expected above 0 and at most 1, found {self.gamma!r}")
        if not (_is_number(self.weight) and math.isfinite(self.weight)):
            raise WrongArgumentError(f"weight: expected a number, found {self.weight!r}")

    @property
    def endless(self) -> bool:
        """True if each episode begins in a new first state."""
        return isinstance(self.instances, str) and self.instances == ENDLESS

    def step_limit(self, world: World) -> int:
        """Return the step budget of an episode in a world."""
        if self.max_steps is not None:
            return self.max_steps
        return MAX_STEPS if world.shift is None else world.shift.steps

    def tasks(self) -> tuple[Task, ...]:
        """Return the task and then the other instances, or the task at each level.

        Raises:
            WrongArgumentError: Some instance has another number of players, or a level is
                impossible.
            UnknownTaskError: The task or an instance does not exist.
            FileError: A task's files are invalid.
        """
        task = _loaded(self.task)
        if task.problem.shift is not None and self.reward is Reward.SHAPED:
            raise WrongArgumentError("reward: 'shaped' needs a goal; a shift rewards points")
        if task.problem.shift is not None and self.goal:
            raise WrongArgumentError("goal: a shift has no goal; its orders are in vectors already")
        if self.levels:
            if self.instances not in ((), ENDLESS):
                raise WrongArgumentError("levels: they need instances='endless' or none")
            return tuple(level.task_for(task) for level in self.levels)
        if self.endless:
            return (task,)
        if isinstance(self.instances, str):
            if self.instances != "generated":
                found = repr(self.instances)
                raise WrongArgumentError(
                    f"instances: expected 'generated', 'endless' or a list, found {found}"
                )
            others = [load_task(name, seats=task.seats) for name in task.instances()]
        else:
            others = [_loaded(each) for each in self.instances]
        tasks = {each.digest: each for each in (task, *others)}
        if wrong := [each for each in tasks.values() if each.seats != task.seats]:
            raise WrongArgumentError(f"instances: {wrong[0].name} has {wrong[0].seats} seats")
        return tuple(tasks.values())


def check_render_mode(mode: str | None) -> None:
    """Check that environments can render in a mode.

    Raises:
        WrongArgumentError: They cannot.
    """
    if mode not in (None, *RENDER_MODES):
        raise WrongArgumentError(f"render_mode: expected one of {RENDER_MODES}, found {mode!r}")


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


def is_compiled() -> bool:
    """Return whether the engine is compiled. In plain Python it is slower than the world."""
    from robotouille.compiling import COMPILED

    return COMPILED


def engine_plays(rules: EnvRules, world: World) -> bool:
    """Return whether the batch engine plays a world under an environment's rules."""
    # Graphs, texts, goals, sight and potentials need a `State` in each step, which the engine would
    # have to build.
    vectors = rules.observation is EnvObservation.VECTOR and not (rules.goal or rules.sight)
    if not (vectors and rules.reward is Reward.SPARSE and is_compiled()):
        return False
    return world.shift is None


NOTHING = -1
"""Number for doing nothing. Where numbers need not be in arrays, None means the same."""

ActionRows = npt.NDArray[np.int64]
"""Numbers of the players' actions, one row per copy."""

Bools = npt.NDArray[np.bool_]


class StepResult(NamedTuple):
    """The result of a step: reward, end of the episode, and whose actions were applied."""

    reward: float
    terminated: bool
    truncated: bool
    valid: tuple[bool, ...]


class BatchStepResult(NamedTuple):
    """The results of a step by copy. `valid` is true if all actions were applied."""

    rewards: npt.NDArray[np.float64]
    terminated: Bools
    truncated: Bools
    valid: Bools


def not_reset_error() -> RobotouilleError:
    """Return the error for calls before the first reset."""
    return RobotouilleError("reset the environment: no episode has begun")


def no_such_action_error(player: str, count: int, number: int) -> WrongArgumentError:
    """Return the error for an action number that does not exist."""
    return WrongArgumentError(f"{player} has {count} actions, found number {number}")


def check_one_agent(rules: EnvRules) -> None:
    """Check that a single agent can play under an environment's rules.

    Raises:
        WrongArgumentError: An option needs one agent per player.
    """
    asked = {
        "perspective": rules.perspective not in (None, Perspective.SHARED),
        "tokens": rules.tokens > 0,
        "levels: other numbers of seats": any(level.seats is not None for level in rules.levels),
    }
    for name, needed in asked.items():
        if needed:
            raise WrongArgumentError(f"{name}: only parallel_env and aec_env have several agents")


def seat_of_one_agent(rules: EnvRules, players: int) -> int | None:
    """Return the seat from which a single agent sees the kitchen; None if it sees everything.

    Raises:
        WrongArgumentError: Sight is limited, but the agent controls several players.
    """
    if rules.sight is None:
        return None
    if players > 1:
        raise WrongArgumentError("sight: only parallel_env and aec_env have several agents")
    return 0
