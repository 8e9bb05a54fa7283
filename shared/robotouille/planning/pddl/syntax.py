"""The subset of PDDL that the encodings write: actions over literals, and their text.

Names in these values are the world's names; `PddlNames` translates them. Names that begin with `~`
belong to the encoding (`~turn`), and names that begin with `?` are variables.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from robotouille.world.world import World

_TAKEN = frozenset((
    "all", "and", "assign", "at", "decrease", "define", "domain", "either", "end", "exists",
    "forall", "imply", "increase", "maximize", "metric", "minimize", "not", "number", "object",
    "or", "over", "problem", "scale-down", "scale-up", "start", "total-time", "when",
))  # fmt: skip


class PddlNames:
    """Translation of a world's names to PDDL names and back."""

    def __init__(self, world: World) -> None:
        self._given: dict[tuple[str, str], str] = {}
        self._owner: dict[tuple[str, str], str] = {}
        self.domain = _allowed(world.task.domain.name)
        self.problem = _allowed(world.task.name)
        self.type("object")
        for predicate in world.task.domain.predicate_defs:
            self.predicate(predicate.name)
        for action in world.task.domain.action_defs:
            self.action(action.name)
        for kind in world.task.domain.object_types:
            self.type(f"={kind}")
        for thing in world.all_objects():
            self.symbol(thing.name)

    def type(self, name: str) -> str:
        return name if name in ("object", "number") else self._give("type", name)

    def predicate(self, name: str) -> str:
        return self._give("predicate", name)

    def action(self, name: str) -> str:
        return self._give("action", name)

    def symbol(self, name: str) -> str:
        """Return the PDDL name of an object, or of a variable, which begins with `?`."""
        if name.startswith("?"):
            return "?" + self._give("variable", name[1:])
        return self._give("object", name)

    def term(self, term: tuple[str, ...]) -> str:
        """Return a term in PDDL, such as `(item_on lettuce1 table2)`."""
        head = "=" if term[0] == "=" else self.predicate(term[0])
        return f"({' '.join([head, *map(self.symbol, term[1:])])})"

    def original(self, category: str, name: str) -> str:
        """Return the name that was translated to `name`.

        Raises:
            KeyError: No name was.
        """
        return self._owner[(category, name.lower())]

    def _give(self, category: str, name: str) -> str:
        given = self._given.get((category, name))
        if given is None:
            base = given = _allowed(name)
            number = 1
            while given in _TAKEN or (category, given) in self._owner:
                number += 1
                given = f"{base}-{number}"
            self._given[(category, name)] = given
            self._owner[(category, given)] = name
        return given


def _allowed(name: str) -> str:
    text = re.sub(r"[^a-z0-9_-]+", "-", name.lower()).strip("-")
    return text if text[:1].isalpha() else f"x{text}"


Term = tuple[str, ...]
"""A predicate and its arguments, which are objects or variables."""

Literal = tuple[Term, bool]
Variable = tuple[str, str]
"""A variable and its type."""

Predicates = Mapping[str, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class PddlEffect:
    """An effect: the literals become true for all values of the variables with the condition."""

    literals: tuple[Literal, ...]
    condition: tuple[Literal, ...] = ()
    variables: tuple[Variable, ...] = ()


@dataclass(frozen=True, slots=True)
class PddlAction:
    """An action without duration. `cost` is its share of the total cost, if costs are counted."""

    name: str
    parameters: tuple[Variable, ...]
    condition: tuple[Literal, ...]
    effects: tuple[PddlEffect, ...]
    cost: int = 0


@dataclass(frozen=True, slots=True)
class DurativeAction:
    """A durative action. `duration` is a number or the term of one of the problem's functions."""

    name: str
    parameters: tuple[Variable, ...]
    duration: int | Term
    at_start: tuple[Literal, ...]
    over_all: tuple[Literal, ...]
    start_effects: tuple[PddlEffect, ...]
    end_effects: tuple[PddlEffect, ...]


@dataclass(frozen=True, slots=True)
class PddlDomain:
    """A domain. `types` maps each type to its supertype; `notes` become comments at the top."""

    requirements: tuple[str, ...]
    types: Mapping[str, str]
    constants: tuple[Variable, ...]
    predicates: Predicates
    functions: Predicates
    actions: tuple[PddlAction | DurativeAction, ...]
    notes: tuple[str, ...] = ()

    def text(self, names: PddlNames) -> str:
        """Return the text of the domain file."""
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
    """A problem: objects, initial facts, values of functions, and a goal of one fact."""

    objects: tuple[Variable, ...]
    facts: tuple[Term, ...]
    goal: Term
    metric: str
    values: Mapping[Term, int] = field(default_factory=dict)

    def text(self, names: PddlNames) -> str:
        """Return the text of the problem file."""
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
    """Writer of actions, with costs if the domain has a function for them."""

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
