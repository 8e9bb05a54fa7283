"""Relaxed tasks as arrays of numbers: what heuristics compute with.

A world has one relaxed task for each set of existing objects; each is pruned of what cannot be
reached from the start of a search, and of what does not matter for the goal.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from robotouille.domain.schema import GoalTerm
from robotouille.planning.search.relaxation.abstract_objects import abstract_objects, future_name
from robotouille.planning.search.relaxation.relaxed_goal import GOAL, RelaxedGoal
from robotouille.planning.search.relaxation.relaxed_operators import (
    MAX_COUNTED,
    Label,
    Prop,
    RelaxedOperator,
    RelaxedOperators,
)
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

__all__ = ["Relaxation", "RelaxedState", "RelaxedTask", "reachable"]

TRUE: Prop = ("true",)


@dataclass(frozen=True, slots=True)
class RelaxedState:
    """A state as a relaxed task sees it: the propositions reached, and delays begun already.

    `left` has, for operators of delays that have begun, the delay that is left.
    """

    props: list[int]
    left: dict[int, int]


class RelaxedTask:
    """Operators by number.

    `preconditions`, `add_effects`, `cost` and `delay` are those of each operator; `precondition_of`
    has the operators that need a proposition, `achievers` those that add it.
    """

    def __init__(self, world: World, operators: list[RelaxedOperator]) -> None:
        self.operators = operators
        self.number: dict[Prop, int] = {TRUE: 0, GOAL: 1}
        self.preconditions = [
            self._numbers(operator.preconditions) or (0,) for operator in operators
        ]
        self.add_effects = [self._numbers(operator.add_effects) for operator in operators]
        self.cost = bytes(operator.cost for operator in operators)
        self.delay = [operator.delay for operator in operators]
        self.timed = bytes(operator.clock is not None for operator in operators)
        self.counts = [len(needed) for needed in self.preconditions]
        self.size = len(self.number)
        self.precondition_of = _index(self.preconditions, self.size)
        self.achievers = _index(self.add_effects, self.size)
        self._clocks = {
            operator.clock: i for i, operator in enumerate(operators) if operator.clock is not None
        }
        bits = world.table.bit
        self._true = self._by_bit("+", bits)
        self._false = self._by_bit("-", bits)
        self._true_mask = sum(1 << bit for bit in self._true)
        self._false_mask = sum(1 << bit for bit in self._false)
        static = world.table.static
        self._always = [0] + [
            number
            for prop, number in self.number.items()
            if prop[0] == "-" and prop[1] not in bits and prop[1] not in static
        ]
        self._timers: dict[Timers, tuple[list[int], dict[int, int]]] = {}

    goal = 1

    def relaxed_state(self, facts: int, timers: Timers) -> RelaxedState:
        """What is reached at once in a state."""
        known = self._timers.get(timers)
        if known is None:
            known = self._timers[timers] = self._running(timers)
        props = self._always + known[0]
        props += [self._true[bit] for bit in bits_of(facts & self._true_mask)]
        props += [self._false[bit] for bit in bits_of(~facts & self._false_mask)]
        return RelaxedState(props, known[1])

    def _numbers(self, props: Iterable[Prop]) -> tuple[int, ...]:
        return tuple({self.number.setdefault(p, len(self.number)): None for p in props})

    def _by_bit(self, sign: str, bits: dict[tuple[str, ...], int]) -> dict[int, int]:
        return {
            bits[prop[1]].bit_length() - 1: number
            for prop, number in self.number.items()
            if prop[0] == sign and prop[1] in bits
        }

    def _running(self, timers: Timers) -> tuple[list[int], dict[int, int]]:
        props: list[Prop] = []
        left: dict[int, int] = {}
        for effect, progress in timers.entries:
            props.append(("runs", effect.label, 0))
            for slot, done in enumerate(progress):
                if done == 1:
                    props.append(("holds", effect.label, slot))
                counts = range(1, min(done, MAX_COUNTED) + 1)
                props += [("count", effect.label, slot, n) for n in counts]
                operator = self._clocks.get((effect.label, slot))
                if operator is not None and done > 0:
                    left[operator] = max(0, self.delay[operator] - done)
        return [self.number[prop] for prop in props if prop in self.number], left


def _index(table: list[tuple[int, ...]], size: int) -> list[list[int]]:
    found: list[list[int]] = [[] for _ in range(size)]
    for operator, props in enumerate(table):
        for prop in props:
            found[prop].append(operator)
    return found


def reachable(task: RelaxedTask, relaxed_state: RelaxedState) -> bytearray:
    """For each proposition, whether it can be reached at all."""
    reached = bytearray(task.size)
    unmet = task.counts.copy()
    frontier = list(dict.fromkeys(relaxed_state.props))
    for prop in frontier:
        reached[prop] = 1
    while frontier:
        for operator in task.precondition_of[frontier.pop()]:
            unmet[operator] -= 1
            if not unmet[operator]:
                for prop in task.add_effects[operator]:
                    if not reached[prop]:
                        reached[prop] = 1
                        frontier.append(prop)
    return reached


class Relaxation:
    """The relaxed tasks of a world for all states that can be reached from a start."""

    def __init__(self, world: World, start: State) -> None:
        self._world = world
        self._running: set[Label] = set()
        self._whole_task: tuple[RelaxedTask, set[Label]] | None = None
        self._parts: dict[GoalTerm, Prop] = {}
        self.begin(start)

    def begin(self, start: State) -> None:
        """Take another start, at which the same objects exist: most of the work is kept."""
        self._tasks: dict[int, tuple[RelaxedTask, set[Label]]] = {}
        self._born = {o.name for o in start.objects}
        self._reached: frozenset[Prop] = frozenset()
        self._known: frozenset[Prop] = frozenset()
        whole = self._whole_at(start)
        reached = reachable(whole, whole.relaxed_state(start.facts, start.timers))
        self._reached = frozenset(p for p, n in whole.number.items() if reached[n])
        self._known = frozenset(whole.number)

    def _whole_at(self, start: State) -> RelaxedTask:
        """All operators: those of before, unless something runs that no action starts."""
        known = self._whole_task
        if known is None or any(e.label not in known[1] for e, _ in start.timers.entries):
            known = self._whole_task = self._whole(start.facts, start.timers)
        return known[0]

    def may_come_true(self, term: GoalTerm) -> bool:
        """Whether one predicate of the goal can be reached from the start."""
        return self._parts[term] in self._reached

    def may_reach_goal(self, facts: int) -> bool:
        """Whether all of the goal can hold of the same objects, if nothing is undone.

        Args:
            facts: Those of the start.
        """
        bits = self._world.table.bit
        for sign, *atom in self._reached:
            if sign != "+":
                continue
            bit = bits.get(atom[0])
            if bit is None:  # It is about what is created on the way.
                return True
            facts |= bit
        return self._world.goal.reached(facts)

    def task(self, facts: int, timers: Timers) -> RelaxedTask:
        """The relaxed task of a state."""
        key = facts & self._world.table.internal
        known = self._tasks.get(key)
        if known is not None:
            task, labels = known
            if all(effect.label in labels for effect, _ in timers.entries):
                return task
        whole, labels = self._whole(facts, timers)
        task = RelaxedTask(self._world, _relevant(self._attainable(whole.operators)))
        self._tasks[key] = task, labels
        return task

    def _whole(self, facts: int, timers: Timers) -> tuple[RelaxedTask, set[Label]]:
        """All operators, and the effects they speak of.

        Operators that add nothing give numbers to the parts of the goal, even if nothing changes
        them.
        """
        objects = abstract_objects(self._world, facts)
        self._running |= {effect.label for effect, _ in timers.entries}
        running = [x for x in sorted(self._running) if all(a in objects.by_name for a in x[2])]
        relaxed = RelaxedOperators(self._world, objects)
        goal = RelaxedGoal(self._world, objects)
        self._parts = self._parts or {term: goal.part(term) for term in self._world.goal.terms}
        relaxed.write(running)
        asked = [RelaxedOperator([part], []) for part in dict.fromkeys(self._parts.values())]
        return RelaxedTask(self._world, relaxed.operators + goal.operators + asked), relaxed.labels

    def _attainable(self, operators: list[RelaxedOperator]) -> list[RelaxedOperator]:
        """The operators whose preconditions can all be met, from the start of the search."""
        born = {
            name: future_name(thing.kind, thing.type)
            for name in self._world.thing_names - self._born
            for thing in [self._world.thing(name)]
        }
        return [
            operator
            for operator in operators
            if all(self._may_be_reached(_renamed(prop, born)) for prop in operator.preconditions)
        ]

    def _may_be_reached(self, prop: Prop) -> bool:
        """Counts are left out: how many are needed may differ between an object and its kind."""
        return prop in self._reached or prop not in self._known or prop[0] in ("count", "part")


def _renamed(prop: Prop, born: dict[str, str]) -> Prop:
    """A proposition about objects that do not exist at the start, said of future ones."""
    if prop[0] in ("+", "-"):
        return (prop[0], tuple(born.get(name, name) for name in prop[1]))
    if prop[0] in ("runs", "holds"):
        name, index, arguments = prop[1]
        return (prop[0], (name, index, tuple(born.get(a, a) for a in arguments)), prop[2])
    return prop


def _relevant(operators: list[RelaxedOperator]) -> list[RelaxedOperator]:
    """The operators that the goal may need, without what they add for nothing."""
    achievers: dict[Prop, list[RelaxedOperator]] = {}
    for operator in operators:
        for prop in operator.add_effects:
            achievers.setdefault(prop, []).append(operator)
    wanted = {GOAL}
    frontier: list[Prop] = [GOAL]
    used: set[int] = set()
    while frontier:
        for operator in achievers.get(frontier.pop(), ()):
            used.add(id(operator))
            new = [prop for prop in operator.preconditions if prop not in wanted]
            wanted.update(new)
            frontier += new
    return [
        RelaxedOperator(
            r.preconditions, [p for p in r.add_effects if p in wanted], r.cost, r.delay, r.clock
        )
        for r in operators
        if id(r) in used
    ]
