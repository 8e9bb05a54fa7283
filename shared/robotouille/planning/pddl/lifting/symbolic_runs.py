"""Symbolic runs: what a piece of the world does, for every way in which its tests can turn out.

The piece is a function that reads and writes facts over variables. It is called once for each
way; what it read becomes a condition, what it wrote an effect. Two atoms with different variables
may be the same one: where that matters, their equality is one more test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from robotouille.planning.pddl.syntax import Literal, PddlEffect, Term, Variable

__all__ = ["SymbolicRun", "effects_of", "runs"]


class SymbolicRun:
    """One way through: its tests with their outcomes, and what it wrote last about each atom."""

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
        """The condition under which this is what happens."""
        return (*self.given, *self.tests)

    def assume(self, term: Term, value: bool) -> None:
        """Know a fact from elsewhere, untested."""
        self._known[term] = value

    def bind(self, term: Term, *variables: Variable) -> None:
        """Choose values of new variables for which a fact is true."""
        self.given.append((term, True))
        self.variables += variables

    def read(self, term: Term) -> bool:
        """Whether an atom is true, after all that was written."""
        for other in reversed(self.writes):
            if self._same(term, other):
                return self.writes[other]
        return self._decide(term)

    def write(self, *literals: Literal) -> None:
        """Make atoms true and false at once, true winning; of a deleted object none becomes true.

        What was written earlier about the same atom no longer counts.
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
    """Every way through a piece; their conditions exclude each other."""
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
    """The effects of runs: what all have in common, then the rest of each."""
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
