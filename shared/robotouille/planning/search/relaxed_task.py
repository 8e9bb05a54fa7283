"""Relaxed tasks as arrays of numbers, on which the heuristics compute.

A world has one relaxed task for each set of existing objects. Operators that are unreachable from
the start of a search, or irrelevant for the goal, are removed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, product
from math import prod

from robotouille.domain.schema import GoalTerm
from robotouille.planning.search.relaxed_operators import (
    MAX_CHOICES,
    MAX_COUNTED,
    AbstractObjects,
    Label,
    Prop,
    RelaxedOperator,
    RelaxedOperators,
    TooLargeError,
    abstract_objects,
    future_name,
)
from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.goal import Goal, Variable
from robotouille.world.grounding.objects import Atom
from robotouille.world.timers import Timers
from robotouille.world.world import State, World

GOAL: Prop = ("goal",)

MAX_BINDINGS = 64
"""Maximum number of choices of objects that are distinguished."""

Names = tuple[str | None, ...]


class RelaxedGoal:
    """Operators that add `GOAL`, one for each choice of objects, and parts of the goal."""

    def __init__(self, world: World, objects: AbstractObjects) -> None:
        self._table = world.table
        self._objects = objects
        self._goal: Goal = world.goal
        self._pools = {v.id: self._pool(v) for v in world.goal.variables.values()}
        self._parts: dict[tuple[object, ...], Prop] = {}
        self.operators: list[RelaxedOperator] = []
        chosen = self._connecting()
        wanted = dict.fromkeys(tuple(sorted(set(p), key=repr)) for p in self._choices(chosen))
        self.operators += [RelaxedOperator(list(props), [GOAL]) for props in wanted]

    def part(self, term: GoalTerm, names: Names | None = None) -> Prop:
        """Return the proposition that some fact meets a predicate with the chosen arguments."""
        names = names or (None,) * len(term.ids)
        variables = [self._goal.variables[i] for i in term.ids]
        pattern = (
            term.predicate,
            names,
            tuple((v.fixed, v.kind, term.ids.index(v.id)) for v in variables),
        )
        prop = self._parts.get(pattern)
        if prop is None:
            prop = self._parts[pattern] = self._new_part(term, names)
        return prop

    def _new_part(self, term: GoalTerm, names: Names) -> Prop:
        matching = list(self._matching(term, names))
        if term.predicate in self._table.static_predicates:
            prop: Prop = ("part", len(self._parts))
            if any(atom in self._table.static for atom in matching):
                self.operators.append(RelaxedOperator([], [prop]))
        elif len(matching) == 1:
            prop = ("+", matching[0])
        else:
            prop = ("part", len(self._parts))
            self.operators += [RelaxedOperator([("+", atom)], [prop]) for atom in matching]
        return prop

    def _pool(self, variable: Variable) -> list[str]:
        if variable.fixed is not None:
            return [variable.fixed] if variable.fixed in self._objects.by_name else []
        members = self._objects.members
        return [
            m.name for m in members if (m.type if variable.is_type else m.kind) == variable.kind
        ]

    def _connecting(self) -> list[int | str]:
        """Return the variables to distinguish, those in most predicates first."""
        uses = Counter(i for term in self._goal.terms for i in term.ids)
        chosen: list[int | str] = []
        size = 1
        for identifier, _ in uses.most_common():
            if size * len(self._pools[identifier]) <= MAX_BINDINGS:
                size *= len(self._pools[identifier])
                chosen.append(identifier)
        return chosen

    def _choices(self, chosen: list[int | str]) -> Iterator[list[Prop]]:
        for names in product(*(self._pools[i] for i in chosen)):
            choice = dict(zip(chosen, names, strict=True))
            if all(self._differ(*pair) for pair in combinations(choice.items(), 2)):
                yield [
                    self.part(term, tuple(choice.get(i) for i in term.ids))
                    for term in self._goal.terms
                ]

    def _matching(self, term: GoalTerm, names: Names) -> Iterator[Atom]:
        pools = [
            self._pools[i] if name is None else [name]
            for i, name in zip(term.ids, names, strict=True)
        ]
        if prod(map(len, pools)) > MAX_CHOICES:
            raise TooLargeError(f"more than {MAX_CHOICES} ways to meet {term.predicate}")
        for arguments in product(*pools):
            pairs = combinations(zip(term.ids, arguments, strict=True), 2)
            if all(self._differ(*pair) for pair in pairs):
                yield (term.predicate, *arguments)

    def _differ(self, one: tuple[int | str, str], other: tuple[int | str, str]) -> bool:
        """Return whether two arguments are allowed together.

        Equal ids are equal objects; different ids of one kind are different objects.
        """
        # A future object stands for many, so it may stand for two different ones.
        if one[0] == other[0]:
            return one[1] == other[1]
        variables = self._goal.variables
        alike = variables[one[0]].kind == variables[other[0]].kind
        return not alike or one[1] != other[1] or one[1] in self._objects.future


TRUE: Prop = ("true",)


@dataclass(frozen=True, slots=True)
class RelaxedState:
    """A state of a relaxed task: the reached propositions, and running delays.

    `left` contains the rest of each running delay by its operator.
    """

    props: list[int]
    left: dict[int, int]


class RelaxedTask:
    """Operators by number.

    `precondition_of` contains the operators that need a proposition, and `achievers` those that add
    it.
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
        """Return the propositions that hold in a state, and its running delays."""
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
    """Return for each proposition whether it is reachable."""
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
    """The relaxed tasks of a world for all states that are reachable from a start."""

    def __init__(self, world: World, start: State) -> None:
        self._world = world
        self._running: set[Label] = set()
        self._whole_task: tuple[RelaxedTask, set[Label]] | None = None
        self._parts: dict[GoalTerm, Prop] = {}
        self.begin(start)

    def begin(self, start: State) -> None:
        """Set another start with the same existing objects, reusing most of the work."""
        self._tasks: dict[int, tuple[RelaxedTask, set[Label]]] = {}
        self._born = {o.name for o in start.objects}
        self._reached: frozenset[Prop] = frozenset()
        self._known: frozenset[Prop] = frozenset()
        whole = self._whole_at(start)
        reached = reachable(whole, whole.relaxed_state(start.facts, start.timers))
        self._reached = frozenset(p for p, n in whole.number.items() if reached[n])
        self._known = frozenset(whole.number)

    def _whole_at(self, start: State) -> RelaxedTask:
        """Return the task with all operators, rebuilt only if an unknown effect runs."""
        known = self._whole_task
        if known is None or any(e.label not in known[1] for e, _ in start.timers.entries):
            known = self._whole_task = self._whole(start.facts, start.timers)
        return known[0]

    def may_come_true(self, term: GoalTerm) -> bool:
        """Return whether one predicate of the goal is reachable from the start."""
        return self._parts[term] in self._reached

    def may_reach_goal(self, facts: int) -> bool:
        """Return whether all of the goal can hold for the same objects without deletions.

        Args:
            facts: Facts of the start.
        """
        bits = self._world.table.bit
        for sign, *atom in self._reached:
            if sign != "+":
                continue
            bit = bits.get(atom[0])
            if bit is None:  # The fact is about an object that is created later.
                return True
            facts |= bit
        return self._world.goal.reached(facts)

    def task(self, facts: int, timers: Timers) -> RelaxedTask:
        """Return the relaxed task of a state."""
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
        """Return the task with all operators, and the effects in it."""
        objects = abstract_objects(self._world, facts)
        self._running |= {effect.label for effect, _ in timers.entries}
        running = [x for x in sorted(self._running) if all(a in objects.by_name for a in x[2])]
        relaxed = RelaxedOperators(self._world, objects)
        goal = RelaxedGoal(self._world, objects)
        self._parts = self._parts or {term: goal.part(term) for term in self._world.goal.terms}
        relaxed.write(running)
        # Operators without add effects give numbers to parts of the goal that nothing changes.
        asked = [RelaxedOperator([part], []) for part in dict.fromkeys(self._parts.values())]
        return RelaxedTask(self._world, relaxed.operators + goal.operators + asked), relaxed.labels

    def _attainable(self, operators: list[RelaxedOperator]) -> list[RelaxedOperator]:
        """Return the operators whose preconditions are reachable from the start."""
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
        """Return whether a proposition may be reachable from the start."""
        # Counts are left out: an object and its kind may need different numbers of performances.
        return prop in self._reached or prop not in self._known or prop[0] in ("count", "part")


def _renamed(prop: Prop, born: dict[str, str]) -> Prop:
    """Return a proposition with future objects in place of objects created after the start."""
    if prop[0] in ("+", "-"):
        return (prop[0], tuple(born.get(name, name) for name in prop[1]))
    if prop[0] in ("runs", "holds"):
        name, index, arguments = prop[1]
        return (prop[0], (name, index, tuple(born.get(a, a) for a in arguments)), prop[2])
    return prop


def _relevant(operators: list[RelaxedOperator]) -> list[RelaxedOperator]:
    """Return the operators that the goal may need, without irrelevant add effects."""
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
