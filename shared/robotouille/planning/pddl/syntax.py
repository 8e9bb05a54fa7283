"""The part of PDDL that is written: actions over literals, and their text.

Names in these values are the world's own; `PddlNames` says them in PDDL when text is made.
Names that begin with `~` are the encoding's (`~turn`), those with `?` are variables.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from robotouille.planning.pddl.pddl_names import PddlNames

__all__ = [
    "DurativeAction",
    "Literal",
    "PddlAction",
    "PddlDomain",
    "PddlEffect",
    "PddlProblem",
    "Term",
    "Variable",
]

Term = tuple[str, ...]
"""A predicate and its arguments: names of objects, or variables."""

Literal = tuple[Term, bool]
Variable = tuple[str, str]
"""A variable and its type."""

Predicates = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class PddlEffect:
    """For all values of the variables for which the condition holds, the literals become true."""

    literals: tuple[Literal, ...]
    condition: tuple[Literal, ...] = ()
    variables: tuple[Variable, ...] = ()


@dataclass(frozen=True, slots=True)
class PddlAction:
    """An action of no duration; `cost` is what it adds to the total cost, if that is counted."""

    name: str
    parameters: tuple[Variable, ...]
    condition: tuple[Literal, ...]
    effects: tuple[PddlEffect, ...]
    cost: int = 0


@dataclass(frozen=True, slots=True)
class DurativeAction:
    """A durative action. `duration` is a number, or the term of a function of the problem."""

    name: str
    parameters: tuple[Variable, ...]
    duration: int | Term
    at_start: tuple[Literal, ...]
    over_all: tuple[Literal, ...]
    start_effects: tuple[PddlEffect, ...]
    end_effects: tuple[PddlEffect, ...]


@dataclass(frozen=True, slots=True)
class PddlDomain:
    """A domain. `types` gives each type its supertype, `notes` become comments at the top."""

    requirements: tuple[str, ...]
    types: Mapping[str, str]
    constants: tuple[Variable, ...]
    predicates: Predicates
    functions: Predicates
    actions: tuple[PddlAction | DurativeAction, ...]
    notes: tuple[str, ...] = ()

    def text(self, names: PddlNames) -> str:
        """The domain file."""
        types = (f"{names.type(t)} - {names.type(above)}" for t, above in self.types.items())
        blocks = [
            f"(:requirements {' '.join(self.requirements)})",
            _block(":types", types),
            _block(":constants", _typed(self.constants, names)),
            _block(":predicates", _signatures(self.predicates, names)),
            _block(":functions", (f"{s} - number" for s in _signatures(self.functions, names))),
            *(_Writer(names, bool(self.functions)).action(action) for action in self.actions),
        ]
        head = [f"; {note}" for note in self.notes]
        body = [line for block in blocks if block for line in block.splitlines()]
        return "\n".join([*head, f"(define (domain {names.domain})", *_indent(body), ")", ""])


@dataclass(frozen=True, slots=True)
class PddlProblem:
    """A problem: objects, initial facts and values of functions, and a goal of one fact."""

    objects: tuple[Variable, ...]
    facts: tuple[Term, ...]
    goal: Term
    metric: str
    values: Mapping[Term, int] = field(default_factory=dict)

    def text(self, names: PddlNames) -> str:
        """The problem file."""
        values = [f"(= {names.term(t)} {value})" for t, value in self.values.items()]
        blocks = [
            f"(:domain {names.domain})",
            _block(":objects", _typed(self.objects, names)),
            _block(":init", [*values, *map(names.term, self.facts)]),
            f"(:goal {names.term(self.goal)})",
            f"(:metric minimize ({self.metric}))",
        ]
        body = [line for block in blocks if block for line in block.splitlines()]
        return "\n".join([f"(define (problem {names.problem})", *_indent(body), ")", ""])


def _indent(lines: Iterable[str]) -> Iterator[str]:
    return (f"  {line}" for line in lines)


def _block(head: str, lines: Iterable[str]) -> str:
    body = list(_indent(lines))
    return "\n".join([f"({head}", *body, ")"]) if body else ""


def _typed(variables: Iterable[Variable], names: PddlNames) -> Iterator[str]:
    return (f"{names.symbol(name)} - {names.type(kind)}" for name, kind in variables)


def _signatures(predicates: Predicates, names: PddlNames) -> Iterator[str]:
    for predicate, types in predicates.items():
        arguments = (f" ?x{i} - {names.type(kind)}" for i, kind in enumerate(types))
        yield f"({names.predicate(predicate)}{''.join(arguments)})"


class _Writer:
    """Writes actions; with costs if the domain has a function for them."""

    def __init__(self, names: PddlNames, costs: bool) -> None:
        self._names = names
        self._costs = costs

    def action(self, action: PddlAction | DurativeAction) -> str:
        return self._durative(action) if isinstance(action, DurativeAction) else self._plain(action)

    def _plain(self, action: PddlAction) -> str:
        effects = [self._effect(e) for e in action.effects]
        if self._costs and action.cost:
            effects.append(f"(increase (total-cost) {action.cost})")
        return _block(
            f":action {self._names.action(action.name)}",
            [
                f":parameters ({self._parameters(action.parameters)})",
                *_conjunction(":precondition", map(self._literal, action.condition)),
                *_conjunction(":effect", effects),
            ],
        )

    def _durative(self, action: DurativeAction) -> str:
        duration = action.duration
        length = duration if isinstance(duration, int) else self._names.term(duration)
        conditions = [f"(at start {self._literal(one)})" for one in action.at_start]
        conditions += [f"(over all {self._literal(one)})" for one in action.over_all]
        effects = [self._effect(e, "at start") for e in action.start_effects]
        effects += [self._effect(e, "at end") for e in action.end_effects]
        return _block(
            f":durative-action {self._names.action(action.name)}",
            [
                f":parameters ({self._parameters(action.parameters)})",
                f":duration (= ?duration {length})",
                *_conjunction(":condition", conditions),
                *_conjunction(":effect", effects),
            ],
        )

    def _parameters(self, variables: Iterable[Variable]) -> str:
        return " ".join(_typed(variables, self._names))

    def _literal(self, literal: Literal) -> str:
        term, positive = literal
        return self._names.term(term) if positive else f"(not {self._names.term(term)})"

    def _effect(self, effect: PddlEffect, when: str = "") -> str:
        def timed(literal: Literal) -> str:
            return f"({when} {self._literal(literal)})" if when else self._literal(literal)

        text = _and(map(timed, effect.literals))
        if effect.condition:
            text = f"(when {_and(map(timed, effect.condition))} {text})"
        if effect.variables:
            text = f"(forall ({self._parameters(effect.variables)}) {text})"
        return text


def _and(parts: Iterable[str]) -> str:
    texts = list(parts)
    return texts[0] if len(texts) == 1 else f"(and {' '.join(texts)})"


def _conjunction(head: str, parts: Iterable[str]) -> list[str]:
    return [f"{head} (and", *_indent(parts), ")"]
