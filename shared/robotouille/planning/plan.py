"""Plans, as values and as text, and the replay of plans.

    # task: multi_agent/01_lettuce_burger@2
    # timing: benchmark
    move(robot1, table1, table2); pick-up-item(robot2, bread1, table3)
    -

Each line is one step. It contains the ground actions in the order in which they apply, joined by
`;`, or `-` for a step without actions. Lines that begin with `#` are comments.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from robotouille.errors import MAX_FAULTS, Fault, FileError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

Joint = tuple[GroundAction, ...]

_ACTION = re.compile(r"\s*([^\s(),;]+)\s*\(([^()]*)\)\s*$")


@dataclass(frozen=True, slots=True)
class Plan:
    """A joint action for each step, with its actions in the order in which they apply."""

    steps: tuple[Joint, ...]

    def __len__(self) -> int:
        return len(self.steps)

    def __iter__(self) -> Iterator[Joint]:
        return iter(self.steps)

    @property
    def actions(self) -> int:
        """Number of actions of all players."""
        return sum(map(len, self.steps))

    def share(self, player: str) -> int:
        """Return the number of actions of one player."""
        return sum(action.player == player for joint in self.steps for action in joint)


def write_plan(plan: Plan, world: World, notes: Iterable[str] = ()) -> str:
    """Return the text of a plan with a header that names the task. `notes` become comments."""
    task = world.task
    lines = [f"# task: {task.name}@{task.seats}", f"# timing: {task.timing.value}"]
    lines += [f"# {note}" for note in notes]
    lines += ["; ".join(map(str, joint)) or "-" for joint in plan]
    return "\n".join(lines) + "\n"


def read_plan(text: str, world: World, source: str = "plan") -> Plan:
    """Return the plan of a text.

    Args:
        source: Name of the text in errors.

    Raises:
        FileError: Some lines are invalid: unknown names (with the nearest valid one), wrong numbers
            of arguments, text other than actions, or a header of another task.
    """
    steps: list[Joint] = []
    faults: list[Fault] = []
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped:
            continue
        try:
            if stripped.startswith("#"):
                _check_header(stripped, world)
            else:
                steps.append(_read_step(stripped, world))
        except ValueError as error:
            faults.append(Fault(f"line {number}", str(error)))
        # Each fault is compared with all names. A file of a million faults would take an hour.
        if len(faults) > MAX_FAULTS:
            faults[-1] = Fault("", f"more than {MAX_FAULTS:,} faults")
            break
    if faults:
        raise FileError(source, faults)
    return Plan(tuple(steps))


def _check_header(comment: str, world: World) -> None:
    task = world.task
    key, _, value = comment.removeprefix("#").strip().partition(": ")
    expected = {"task": f"{task.name}@{task.seats}", "timing": task.timing.value}
    if key in expected and value.strip() != expected[key]:
        raise ValueError(f"the plan is for {key} {value.strip()!r}, not for {expected[key]!r}")


def _read_step(line: str, world: World) -> Joint:
    if line == "-":
        return ()
    joint = tuple(_read_action(part, world) for part in line.split(";"))
    actors = [action.player for action in joint if action.player is not None]
    for player, times in Counter(actors).items():
        if times > 1:
            raise ValueError(f"{player} acts twice in one step")
    return joint


def _read_action(text: str, world: World) -> GroundAction:
    match = _ACTION.match(text)
    if match is None:
        raise ValueError(f"expected an action like 'name(argument, argument)', found {text!r}")
    arguments = [name.strip() for name in match[2].split(",")] if match[2].strip() else []
    world.admit(arguments)
    try:
        return world.action(match[1], *arguments)
    except KeyError as error:
        raise ValueError(error.args[0]) from None


class Proof(StrEnum):
    """The reason why a lower bound holds.

    `EXHAUSTED`: every state nearer than the bound was expanded or merged with an equal one.
    `HEURISTIC`: in every open state, the steps so far and the admissible heuristic add up to at
    least the bound. `EXTERNAL`: an independent planner found the same length. `NONE`: the only
    bound is 0.
    """

    EXHAUSTED = "exhausted search"
    HEURISTIC = "admissible heuristic"
    EXTERNAL = "external check"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a search: expansions, states in memory, or a function that returns whether to stop.

    The numbers have the same effect on every machine; `stop` (a timeout or an interrupt) does not.
    Searches call `stop` after every slice of work.
    """

    expansions: int | None = None
    states: int | None = None
    stop: Callable[[], bool] | None = None

    def reached(self, expansions: int, states: int) -> bool:
        """Return whether a search has reached one of the limits."""
        if self.expansions is not None and expansions >= self.expansions:
            return True
        if self.states is not None and states >= self.states:
            return True
        return self.stop is not None and self.stop()


UNLIMITED = Limits()
"""Limits that never stop a search."""


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The best plan, or None, and a lower bound on the length of every plan.

    `unsolvable` means that a proof shows that no plan exists. `planner` is the planner's name and
    version.
    """

    plan: Plan | None
    bound: int
    proof: Proof
    planner: str
    expansions: int
    unsolvable: bool = False

    @property
    def length(self) -> int | None:
        """Length of the plan in steps; None without a plan."""
        return None if self.plan is None else len(self.plan)

    @property
    def optimal(self) -> bool:
        """True if no plan is shorter."""
        return self.plan is not None and self.bound >= len(self.plan)

    @property
    def gap(self) -> int | None:
        """Steps between the bound and the plan; None without a plan."""
        return None if self.plan is None else max(0, len(self.plan) - self.bound)


Watch = Callable[[int, int, int | None], None]
"""Callback of a running search: expansions so far, bound, and length of the best plan."""


@dataclass(frozen=True, slots=True)
class Rejection:
    """A rejected action of a plan, its step (from 1) and the reasons."""

    step: int
    action: GroundAction
    reasons: tuple[str, ...]

    def __str__(self) -> str:
        return f"step {self.step}: {self.action}: {'; '.join(self.reasons)}"


@dataclass(frozen=True, slots=True)
class PlanReport:
    """Result of a plan's replay.

    `reached_at` is the first step (from 1) after which the goal holds: 0 if it held at the start,
    None if it never did. `rejection` is the first rejected action.
    """

    steps: int
    reached_at: int | None
    rejection: Rejection | None
    final: State

    @property
    def ok(self) -> bool:
        """True if every action applied and the goal was reached in the last step, not earlier."""
        return self.rejection is None and self.reached_at == self.steps

    def __str__(self) -> str:
        if self.rejection is not None:
            return str(self.rejection)
        if self.reached_at is None:
            return f"the goal is not reached in {self.steps} steps"
        return f"the goal is reached in step {self.reached_at} of {self.steps}"


def replay(plan: Plan, world: World, start: State | None = None) -> PlanReport:
    """Take every step of a plan from `start`, by default the initial state.

    The replay continues after rejected actions and reports the first one.

    Raises:
        WrongWorldError: The plan or the start is of another task.
    """
    state = world.initial if start is None else start
    reached_at = 0 if state.goal_reached else None
    rejection = None
    for number, joint in enumerate(plan, start=1):
        step = world.step(state, joint)
        state = step.state
        if step.goal_reached and reached_at is None:
            reached_at = number
        for attempt in step.attempts:
            if not attempt.applied and rejection is None:
                rejection = Rejection(number, attempt.action, attempt.reasons)
    return PlanReport(len(plan), reached_at, rejection, state)


def eliminate_actions(plan: Plan, start: State) -> Plan:
    """Return the plan without actions that are not needed to reach the goal in time.

    Walks with nothing between them become one walk.
    """
    steps = list(plan.steps)
    states = _run(steps, start)
    # The loop starts at the end, so that an action is removed after the later ones that needed it.
    for number in reversed(range(len(steps))):
        for action in reversed(steps[number]):
            shorter = tuple(a for a in steps[number] if a is not action)
            rest = [shorter, *steps[number + 1 :]]
            after = _run(rest, states[number])
            if len(after) <= len(rest) or not after[-1].goal_reached:
                continue
            steps[number] = shorter
            states[number + 1 :] = after[1:]
    _merge_walks(steps, states)
    return Plan(tuple(steps))


def _merge_walks(steps: list[Joint], states: list[State]) -> None:
    """Replace successive walks of a player by one, in place, if the goal is still reached."""
    pending: dict[str, int] = {}
    for number in range(len(steps)):
        for action in steps[number]:
            player = action.player
            if player is None:
                continue
            first = pending.pop(player, None)
            if action.destination is None:
                continue
            pending[player] = number
            if first is None:
                continue
            # The later time comes first, because the player may make way for others until then.
            merged = next(_merged(steps, states, (first, number), action), None)
            if merged is not None:
                pending[player], steps[first:], states[first:] = merged


def _merged(
    steps: list[Joint], states: list[State], walks: tuple[int, int], action: GroundAction
) -> Iterator[tuple[int, list[Joint], list[State]]]:
    """Yield the step of one walk instead of two, and the steps and states from the first one on."""
    (first, last), player = walks, action.player or ""
    for at in (last, first):
        rest = [list(joint) for joint in steps[first:]]
        for number in (first, last):
            rest[number - first] = [a for a in steps[number] if a.player != player]
        before = _run([tuple(joint) for joint in rest[: at - first]], states[first])
        walk = [a for a in before[-1].actions(player) if a.destination == action.destination]
        if len(before) <= at - first or not walk:
            continue
        rest[at - first].append(walk[0])
        joints = [tuple(joint) for joint in rest]
        after = _run(joints, states[first])
        if len(after) > len(joints) and after[-1].goal_reached:
            yield at, joints, after


def _run(steps: list[Joint], start: State) -> list[State]:
    """Return the states of some steps, up to the first step with a rejected action."""
    states = [start]
    for joint in steps:
        step = states[-1].step(joint)
        if not all(attempt.applied for attempt in step.attempts):
            break
        states.append(step.state)
    return states
