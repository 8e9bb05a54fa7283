"""Special effects over variables: their facts, and their updates by symbolic execution.

The updates follow docs/episodes.md, "Special effects". A running effect `cook.0(i, s)` is a fact,
`(cook-0-active ?i ?s)`, and so is each counter of its parts, `(cook-0-count-1 ?i ?s n2)`. All its
facts are false while it does not run.

Symbolic execution calls an update once for each combination of test outcomes. The facts it reads
become conditions and the facts it writes become effects. Two atoms with different variables may be
equal; where that matters, their equality is another test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from robotouille.domain.schema import (
    Condition,
    Conditional,
    CountedEffect,
    Delayed,
    Deletion,
    EffectDef,
    InstantEffect,
    Repetitive,
)
from robotouille.planning.pddl.syntax import Literal, PddlEffect, Term, Variable


class SymbolicRun:
    """One execution path: its tests with outcomes, and the last value written to each atom."""

    def __init__(self, script: Iterable[bool], known: Iterable[Literal]) -> None:
        self._script = iter(script)
        self._known = dict(known)
        self.tests: list[Literal] = []
        self.given: list[Literal] = []
        self.writes: dict[Term, bool] = {}
        self.variables: list[Variable] = []
        self.deleted: set[str] = set()

    @property
    def guard(self) -> tuple[Literal, ...]:
        """Condition under which this path is taken."""
        return (*self.given, *self.tests)

    def assume(self, term: Term, value: bool) -> None:
        """Set a fact's value without a test."""
        self._known[term] = value

    def bind(self, term: Term, *variables: Variable) -> None:
        """Bind new variables to values for which a fact is true."""
        self.given.append((term, True))
        self.variables += variables

    def read(self, term: Term) -> bool:
        """Return whether an atom is true after all writes."""
        for other in reversed(self.writes):
            if self._same(term, other):
                return self.writes[other]
        return self._decide(term)

    def write(self, *literals: Literal) -> None:
        """Write atoms at once.

        True wins over false, and no fact of a deleted object becomes true. Earlier writes to the
        same atoms are replaced.
        """
        earlier = tuple(self.writes.items())
        for term, value in sorted(literals, key=lambda literal: literal[1]):
            if value and self.deleted.intersection(term[1:]):
                continue
            for other, old in earlier:
                if old != value and other in self.writes and self._same(term, other):
                    del self.writes[other]
            self.writes.pop(term, None)
            self.writes[term] = value

    def _same(self, one: Term, other: Term) -> bool:
        return one[0] == other[0] and all(
            x == y or (("?" in x + y) and self._decide(("=", *sorted((x, y)))))
            for x, y in zip(one[1:], other[1:], strict=True)
        )

    def _decide(self, term: Term) -> bool:
        if term not in self._known:
            outcome = next(self._script, True)
            self._known[term] = outcome
            self.tests.append((term, outcome))
        return self._known[term]


def runs(
    piece: Callable[[SymbolicRun], None], known: Iterable[Literal] = ()
) -> Iterator[SymbolicRun]:
    """Yield every execution path of a function. Their conditions exclude each other."""
    known = tuple(known)
    script: list[bool] = []
    while True:
        run = SymbolicRun(script, known)
        piece(run)
        yield run
        script = [outcome for _, outcome in run.tests]
        while script and not script[-1]:
            script.pop()
        if not script:
            return
        script[-1] = False


def effects_of(
    found: Iterable[SymbolicRun], variables: tuple[Variable, ...] = ()
) -> Iterator[PddlEffect]:
    """Yield the effects of all paths: their common writes, then the rest of each."""
    every = list(found)
    common = {
        item for item in every[0].writes.items() if all(item in r.writes.items() for r in every)
    }
    if variables or any(run.given for run in every):
        common = set()
    if common:
        yield PddlEffect(tuple(item for item in every[0].writes.items() if item in common))
    for run in every:
        rest = tuple(item for item in run.writes.items() if item not in common)
        if rest:
            yield PddlEffect(rest, run.guard, (*variables, *run.variables))


NUMBER = "~count"
FIRST, SECOND = "~n0", "~n1"
QUIET: Term = ("~quiet",)


def literals(conditions: tuple[Condition, ...]) -> tuple[Literal, ...]:
    """Return conditions or simple effects over variables."""
    return tuple(((c.predicate, *(f"?{p}" for p in c.params)), c.is_true) for c in conditions)


@dataclass(frozen=True)
class TimerPart:
    """A special effect or a nested one. A `watched` part may be done before the whole effect."""

    definition: EffectDef
    slot: int
    nested: tuple[TimerPart, ...]
    watched: bool

    @property
    def subject(self) -> str:
        return f"?{self.definition.param}"

    @property
    def counts(self) -> bool:
        return isinstance(self.definition, CountedEffect)

    @property
    def instant(self) -> bool:
        return isinstance(self.definition, InstantEffect)

    @property
    def lasts(self) -> bool:
        """True if parts remain after its conditions hold or its count is full."""
        return not all(part.instant for part in self.nested)

    @property
    def holds(self) -> bool:
        """True if the next update needs to know whether its conditions held."""
        return isinstance(self.definition, Conditional) and bool(self.definition.fx) and self.lasts

    @property
    def fills(self) -> bool:
        """True if its count may be full before it is done."""
        return self.counts and self.lasts

    def walk(self) -> Iterator[TimerPart]:
        yield self
        for part in self.nested:
            yield from part.walk()

    @property
    def ends_at_once(self) -> bool:
        """True if performing the action can complete the part."""
        definition = self.definition
        if isinstance(definition, Delayed):
            return self.lasts and all(part.ends_at_once for part in self.nested)
        return all(part.ends_at_once for part in self.nested)


@dataclass(frozen=True)
class TimerFacts:
    """One special effect of an action over its variables, and the facts of its progress."""

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
            instant = isinstance(definition, InstantEffect)
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
        """Fact that the effect completed in this step and is removed at its end."""
        return self._term("over")

    def done(self, part: TimerPart) -> Term:
        return self._term("done", part.slot)

    def holding(self, part: TimerPart) -> Term:
        return self._term("holding", part.slot)

    def full(self, part: TimerPart) -> Term:
        """Return the fact that a part's count is full but its nested parts are not done."""
        return self._term("full", part.slot)

    def due(self, part: TimerPart) -> Term:
        """Return the fact that a creation or deletion has to be carried out."""
        return self._term("due", part.slot)

    def count(self, part: TimerPart, number: str) -> Term:
        return (*self._term("count", part.slot), number)

    def last(self, part: TimerPart, subject: str, number: str) -> Term:
        """Return the fact for a part's last count before its effect; it depends on the subject."""
        return (f"~{self.name}:last:{part.slot}", subject, number)

    @property
    def flags(self) -> tuple[Term, ...]:
        """All facts of its progress except the counts."""
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
        """Facts that are true when the effect has begun."""
        counts = (self.count(part, FIRST) for part in self.parts if part.counts)
        return tuple((term, True) for term in (self.active, *counts))


def perform(run: SymbolicRun, timer: TimerFacts) -> None:
    """Begin an effect when its action is performed, or give the running effect an active update."""
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
    """Give a running effect a passive update, and remove it if it is done."""
    run.given.append((timer.active, True))
    over = timer.root.ends_at_once and run.read(timer.over)
    if over or _Update(run, timer, active=False).of(timer.root):
        run.write(*((flag, False) for flag in timer.flags))


class _Update:
    """One update of a timer. It is `fresh` if the timer has just begun."""

    def __init__(self, run: SymbolicRun, timer: TimerFacts, *, active: bool) -> None:
        self.run = run
        self.timer = timer
        self.active = active
        self.fresh = False

    def of(self, part: TimerPart) -> bool:
        """Update a part and return whether it is done."""
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
