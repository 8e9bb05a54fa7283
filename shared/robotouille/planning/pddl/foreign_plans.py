"""Import of other planners' plans.

A plan of the step encoding is split into steps at each `tick`, and a durative plan by its times.
Planners may create the objects of one step in any order, so these objects may have each other's
names. The import renames them in the world's order, the order in which their effects began.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from robotouille.domain.schema import Creation
from robotouille.errors import Fault, FileError
from robotouille.planning.pddl.step_encoding import instant_name
from robotouille.planning.pddl.task_encoding import EncodingStyle, PddlEncoding, encode
from robotouille.planning.plan import Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import World

Joint = tuple[GroundAction, ...]

_LINE = re.compile(r"(?:(?P<time>[0-9.]+)\s*:)?\s*\((?P<action>[^()]*)\)\s*(?:\[[^\]]*\])?$")

CLOSE = 0.01
"""Maximum delay of an action after the time of its step."""

Label = tuple[str, int, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class _Line:
    number: int
    time: float | None
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Made:
    """An object that the plan creates: its effect, the effect's part, and its name in the plan."""

    label: Label
    slot: int
    name: str

    @property
    def kind(self) -> str:
        return self.name.rstrip("0123456789")


def read_pddl_plan(
    text: str, world: World, *, created: int | None = None, source: str = "plan"
) -> Plan:
    """Return the plan of a text; `created` must equal the argument of `encode`.

    Raises:
        FileError: A line is not an action of the encoding.
    """
    lines = list(_lines(text, source))
    timed = any(line.time is not None for line in lines)
    encoding = encode(
        world, EncodingStyle.DURATIVE if timed else EncodingStyle.STEPS, created=created
    )
    reader = _Reader(world, encoding)
    for line in sorted(lines, key=lambda line: line.time or 0.0):
        try:
            reader.read(line)
        except (KeyError, ValueError) as error:
            raise FileError(source, [Fault(f"line {line.number}", str(error.args[0]))]) from None
    return reader.plan()


def _lines(text: str, source: str) -> Iterator[_Line]:
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.partition(";")[0].strip()
        if not stripped:
            continue
        match = _LINE.match(stripped)
        words = match["action"].split() if match else []
        if match is None or not words:
            fault = Fault(f"line {number}", f"expected '(action argument …)', found {stripped!r}")
            raise FileError(source, [fault])
        time = float(match["time"]) if match["time"] else None
        yield _Line(number, time, tuple(words))


class _Reader:
    """Reader that executes a plan's steps to find the names of created objects."""

    def __init__(self, world: World, encoding: PddlEncoding) -> None:
        self._world = world
        self._names = encoding.names
        self._arity = {s.name: len(s.parameters) for s in encoding.lifted.schemas}
        self._instants = {
            instant_name(timer, part): (timer, part) for timer, part in encoding.lifted.instants
        }
        self._state = self._before = world.initial
        self._steps: list[Joint] = []
        self._joint: list[GroundAction] = []
        self._made: list[_Made] = []
        self._called: dict[str, str] = {}

    def plan(self) -> Plan:
        """Return the plan so far."""
        if self._joint:
            self._step()
        return Plan(tuple(self._steps))

    def read(self, line: _Line) -> None:
        """Read one action of the encoding."""
        name = self._names.original("action", line.words[0])
        arguments = [self._names.original("object", word) for word in line.words[1:]]
        if name in self._instants:
            self._carry_out(name, arguments)
            return
        self._name_created()
        if name in self._arity:
            while line.time is not None and len(self._steps) < int(line.time + CLOSE):
                self._step()
            self._act(name, arguments[: self._arity[name]])
        elif name == "~tick":
            self._step()

    def _act(self, name: str, arguments: list[str]) -> None:
        called = [self._called.get(argument, argument) for argument in arguments]
        self._world.admit(called)
        self._joint.append(self._world.action(name, *called))

    def _step(self) -> None:
        self._before = self._state
        self._steps.append(tuple(self._joint))
        self._state = self._world.step(self._state, self._joint).state
        self._joint = []

    def _carry_out(self, name: str, arguments: list[str]) -> None:
        timer, part = self._instants[name]
        if isinstance(part.definition, Creation):
            *own, new = arguments
            label = (timer.action, timer.index, tuple(self._called.get(a, a) for a in own))
            self._made.append(_Made(label, part.slot, new))

    def _name_created(self) -> None:
        """Rename the objects of one step in the world's order."""
        began = self._began() if len(self._made) > 1 else {}
        order = sorted(self._made, key=lambda m: (began.get(m.label, len(began)), m.slot))
        for kind in {made.kind for made in self._made}:
            names = (made.name for made in self._made if made.kind == kind)
            self._called |= {made.name: next(names) for made in order if made.kind == kind}
        self._made = []

    def _began(self) -> dict[Label, int]:
        """Return the effects that have just been updated, in the order in which they began."""
        last = tuple(self._joint) or (self._steps[-1] if self._steps else ())
        state = self._state if self._joint else self._before
        labels = [effect.label for effect, _ in state.timers.entries]
        labels += [effect.label for action in last for effect in action.effects]
        return {label: i for i, label in enumerate(dict.fromkeys(labels))}
