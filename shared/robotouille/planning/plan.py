"""Plans: what every player does in every step, as a value and as text.

    # task: multi_agent/01_lettuce_burger@2
    # timing: benchmark
    move(robot1, table1, table2); pick-up-item(robot2, bread1, table3)
    -

One line per step: the ground actions in the order in which they apply, joined by `;`, or `-` for
a step in which nobody acts. Lines that begin with `#` are comments.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from robotouille.errors import Fault, FileError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World

__all__ = ["Plan", "read_plan", "write_plan"]

Joint = tuple[GroundAction, ...]

_ACTION = re.compile(r"\s*([^\s(),;]+)\s*\(([^()]*)\)\s*$")


@dataclass(frozen=True, slots=True)
class Plan:
    """Joint actions, step by step; each in the order in which its actions apply."""

    steps: tuple[Joint, ...]

    def __len__(self) -> int:
        return len(self.steps)

    def __iter__(self) -> Iterator[Joint]:
        return iter(self.steps)

    @property
    def actions(self) -> int:
        """The number of actions of all players together."""
        return sum(map(len, self.steps))

    def share(self, player: str) -> int:
        """The number of actions of one player."""
        return sum(action.player == player for joint in self.steps for action in joint)


def write_plan(plan: Plan, world: World, notes: Iterable[str] = ()) -> str:
    """The text of a plan, with a header that names the task; `notes` become comments."""
    task = world.task
    lines = [f"# task: {task.name}@{task.seats}", f"# timing: {task.timing.value}"]
    lines += [f"# {note}" for note in notes]
    lines += ["; ".join(map(str, joint)) or "-" for joint in plan]
    return "\n".join(lines) + "\n"


def read_plan(text: str, world: World, source: str = "plan") -> Plan:
    """The plan of a text.

    Args:
        source: What an error calls the text.

    Raises:
        FileError: With every line that is wrong: unknown names (with the nearest valid one),
            wrong numbers of arguments, text that is no action, or a header of another task.
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
