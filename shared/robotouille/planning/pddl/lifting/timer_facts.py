"""Special effects over variables: their facts, and their updates as pieces of symbolic runs.

The updates are those of docs/world.md, "Special effects". A running effect `cook.0(i, s)` is a
fact, `(cook-0-active ?i ?s)`; what its parts have counted are facts as well,
`(cook-0-count-1 ?i ?s n2)`. While it does not run, all its facts are false.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from robotouille.domain.schema import (
    Condition,
    Conditional,
    Creation,
    Delayed,
    Deletion,
    EffectDef,
    Repetitive,
)
from robotouille.planning.pddl.lifting.symbolic_runs import SymbolicRun
from robotouille.planning.pddl.syntax import Literal, Term, Variable

__all__ = ["FIRST", "NUMBER", "QUIET", "TimerFacts", "TimerPart", "literals", "perform", "tick"]

NUMBER = "~count"
FIRST, SECOND = "~n0", "~n1"
QUIET: Term = ("~quiet",)


def literals(conditions: tuple[Condition, ...]) -> tuple[Literal, ...]:
    """Conditions, or simple effects, over variables."""
    return tuple(((c.predicate, *(f"?{p}" for p in c.params)), c.is_true) for c in conditions)


@dataclass(frozen=True)
class TimerPart:
    """A special effect or one nested in it. `watched`: it may be done before the whole is."""

    definition: EffectDef
    slot: int
    nested: tuple[TimerPart, ...]
    watched: bool

    @property
    def subject(self) -> str:
        return f"?{self.definition.param}"

    @property
    def counts(self) -> bool:
        return isinstance(self.definition, Delayed | Repetitive)

    @property
    def instant(self) -> bool:
        return isinstance(self.definition, Creation | Deletion)

    @property
    def lasts(self) -> bool:
        """Whether something is left of it when its conditions hold or its count is full."""
        return not all(part.instant for part in self.nested)

    @property
    def holds(self) -> bool:
        """Whether it matters that its conditions held last time."""
        return isinstance(self.definition, Conditional) and bool(self.definition.fx) and self.lasts

    @property
    def fills(self) -> bool:
        """Whether it may have counted to its number without being done."""
        return self.counts and self.lasts

    def walk(self) -> Iterator[TimerPart]:
        yield self
        for part in self.nested:
            yield from part.walk()

    @property
    def ends_at_once(self) -> bool:
        """Whether performing the action can complete it."""
        definition = self.definition
        if isinstance(definition, Delayed):
            return self.lasts and all(part.ends_at_once for part in self.nested)
        return all(part.ends_at_once for part in self.nested)


@dataclass(frozen=True)
class TimerFacts:
    """One special effect of an action over its variables, and the facts that tell its progress."""

    action: str
    index: int
    variables: tuple[Variable, ...]
    definition: EffectDef

    @property
    def name(self) -> str:
        return f"{self.action}:{self.index}"

    @cached_property
    def root(self) -> TimerPart:
        slots = iter(range(10_000))

        def part(definition: EffectDef, watched: bool) -> TimerPart:
            slot = next(slots)
            instant = isinstance(definition, Creation | Deletion)
            children = () if instant else definition.sfx
            several = watched or len(children) > 1
            return TimerPart(definition, slot, tuple(part(c, several) for c in children), watched)

        return part(self.definition, False)

    @property
    def parts(self) -> tuple[TimerPart, ...]:
        return tuple(self.root.walk())

    def _term(self, *words: object) -> Term:
        label = ":".join(map(str, (f"~{self.name}", *words)))
        return (label, *(name for name, _ in self.variables))

    @property
    def active(self) -> Term:
        return self._term("active")

    @property
    def over(self) -> Term:
        """It completed in this very step and is removed at its end."""
        return self._term("over")

    def done(self, part: TimerPart) -> Term:
        return self._term("done", part.slot)

    def holding(self, part: TimerPart) -> Term:
        return self._term("holding", part.slot)

    def full(self, part: TimerPart) -> Term:
        """A part has counted to its number, and what is nested in it is not done."""
        return self._term("full", part.slot)

    def due(self, part: TimerPart) -> Term:
        """A creation or deletion is to be carried out."""
        return self._term("due", part.slot)

    def count(self, part: TimerPart, number: str) -> Term:
        return (*self._term("count", part.slot), number)

    def last(self, part: TimerPart, subject: str, number: str) -> Term:
        """The count before the one at which a part takes effect; it depends on the subject."""
        return (f"~{self.name}:last:{part.slot}", subject, number)

    @property
    def flags(self) -> tuple[Term, ...]:
        """All facts about its progress but the counts."""
        flags = [self.active, *([self.over] if self.root.ends_at_once else [])]
        for part in self.parts:
            flags += [self.done(part)] if part.watched else []
            flags += [self.holding(part)] if part.holds else []
            flags += [self.full(part)] if part.fills else []
        return tuple(flags)

    @property
    def predicates(self) -> Mapping[str, tuple[str, ...]]:
        types = tuple(kind for _, kind in self.variables)
        found = {flag[0]: types for flag in self.flags}
        for part in self.parts:
            if part.counts:
                found[self.count(part, "")[0]] = (*types, NUMBER)
                found[self.last(part, "", "")[0]] = (dict(self.variables)[part.subject], NUMBER)
            if part.instant:
                found[self.due(part)[0]] = types
        return found

    @property
    def start(self) -> tuple[Literal, ...]:
        """What is true of it when it has begun."""
        counts = (self.count(part, FIRST) for part in self.parts if part.counts)
        return tuple((term, True) for term in (self.active, *counts))


def perform(run: SymbolicRun, timer: TimerFacts) -> None:
    """The action is performed: begin the effect, or give the one that runs an active update."""
    if run.deleted.intersection(name for name, _ in timer.variables):
        return
    update = _Update(run, timer, active=True)
    if not run.read(timer.active):
        update.fresh = True
        for flag in timer.flags:
            run.assume(flag, False)
        run.write(*timer.start)
    elif timer.root.ends_at_once and run.read(timer.over):
        return
    if update.of(timer.root):
        run.write((timer.over, True))


def tick(run: SymbolicRun, timer: TimerFacts) -> None:
    """A step passes: a passive update of an effect that runs, and its removal if it is done."""
    run.given.append((timer.active, True))
    over = timer.root.ends_at_once and run.read(timer.over)
    if over or _Update(run, timer, active=False).of(timer.root):
        run.write(*((flag, False) for flag in timer.flags))


class _Update:
    """One update of a timer; `fresh` if it has just begun."""

    def __init__(self, run: SymbolicRun, timer: TimerFacts, *, active: bool) -> None:
        self.run = run
        self.timer = timer
        self.active = active
        self.fresh = False

    def of(self, part: TimerPart) -> bool:
        """Update a part; whether it is done."""
        done = self.timer.done(part)
        if part.watched and self.run.read(done):
            return True
        finished = self._kind(part)
        if finished and part.watched:
            self.run.write((done, True))
        return finished

    def _kind(self, part: TimerPart) -> bool:
        if isinstance(part.definition, Conditional):
            return self._conditional(part, part.definition)
        return self._due(part) if part.instant else self._counting(part)

    def _nested(self, part: TimerPart) -> bool:
        finished = [self.of(child) for child in part.nested]
        return all(finished)

    def _conditional(self, part: TimerPart, definition: Conditional) -> bool:
        fx = literals(definition.fx)
        holding = self.timer.holding(part)
        if all(self.run.read(t) == value for t, value in literals(definition.conditions)):
            self.run.write(*([(holding, True)] if part.holds else []), *fx)
            return self._nested(part)
        if part.holds and self.run.read(holding):
            self.run.write((holding, False), *((term, not value) for term, value in fx))
        return False

    def _counting(self, part: TimerPart) -> bool:
        full = self.timer.full(part)
        if part.fills and self.run.read(full):
            return self._nested(part)
        if self.active != isinstance(part.definition, Repetitive):
            return False
        number = FIRST if self.fresh else f"?~n{part.slot}"
        if not self.fresh:
            self.run.bind(self.timer.count(part, number), (number, NUMBER))
        spent = (self.timer.count(part, number), False)
        if not self.run.read(self.timer.last(part, part.subject, number)):
            self.run.write(spent, (self.timer.count(part, self._following(part, number)), True))
            return False
        self.run.write(spent)
        self.run.write(*literals(part.definition.fx))
        if part.fills:
            self.run.write((full, True))
        return self._nested(part)

    def _following(self, part: TimerPart, number: str) -> str:
        if self.fresh:
            return SECOND
        following = f"?~m{part.slot}"
        self.run.bind(("~next", number, following), (following, NUMBER))
        return following

    def _due(self, part: TimerPart) -> bool:
        self.run.write((self.timer.due(part), True), (QUIET, False))
        if isinstance(part.definition, Deletion):
            self.run.deleted.add(part.subject)
        return True
