"""Small, independent reader and interpreter of PDDL texts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import product
from typing import Any

Fact = tuple[str, ...]
Binding = dict[str, str]


def parse(text: str) -> list[Any]:
    tokens = re.findall(r"[()]|[^\s()]+", re.sub(r";.*", "", text))
    stack: list[list[Any]] = [[]]
    for token in tokens:
        if token == "(":
            stack.append([])
        elif token == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token)
    assert len(stack) == 1, "parentheses do not match"
    return stack[0]


def typed(words: list[str]) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    names: list[str] = []
    rest = iter(words)
    for word in rest:
        if word == "-":
            kind = next(rest)
            found += [(name, kind) for name in names]
            names = []
        else:
            names.append(word)
    return found


class Interpreter:
    """The state of a task and its actions."""

    def __init__(self, domain: str, problem: str) -> None:
        blocks = parse(domain)[0][2:] + parse(problem)[0][2:]
        one = {block[0]: block[1:] for block in blocks}
        above = dict(typed(one[":types"]))
        self.by_type: dict[str, list[str]] = {}
        for name, kind in typed(one.get(":constants", [])) + typed(one[":objects"]):
            step: str | None = kind
            while step is not None:
                self.by_type.setdefault(step, []).append(name)
                step = above.get(step)
        self.arity = {p[0]: len(typed(p[1:])) for p in one[":predicates"]}
        self.facts = {tuple(fact) for fact in one[":init"] if fact[0] != "="}
        self.actions = {
            block[1]: dict(zip(block[2::2], block[3::2], strict=True))
            for block in blocks
            if block[0] == ":action"
        }
        self.cost = 0
        self.reached = tuple(one[":goal"][0])
        for fact in self.facts:
            assert self.arity[fact[0]] == len(fact) - 1, fact

    def applicable(self, name: str, *arguments: str) -> bool:
        action = self.actions[name]
        parameters = typed(action[":parameters"])
        well_typed = all(
            argument in self.by_type.get(kind, ())
            for argument, (_, kind) in zip(arguments, parameters, strict=True)
        )
        binding = {v: a for (v, _), a in zip(parameters, arguments, strict=True)}
        return well_typed and self.holds(action[":precondition"], binding)

    def apply(self, name: str, *arguments: str) -> None:
        assert self.applicable(name, *arguments), (name, arguments)
        action = self.actions[name]
        binding = {v: a for (v, _), a in zip(typed(action[":parameters"]), arguments, strict=True)}
        changes = list(self.changes(action[":effect"], binding))
        self.facts -= {fact for fact, value in changes if not value}
        self.facts |= {fact for fact, value in changes if value}

    def holds(self, formula: list[Any], binding: Binding) -> bool:
        if formula[0] == "and":
            return all(self.holds(part, binding) for part in formula[1:])
        if formula[0] == "not":
            return not self.holds(formula[1], binding)
        fact = self.ground(formula, binding)
        return fact[1] == fact[2] if fact[0] == "=" else fact in self.facts

    def changes(self, effect: list[Any], binding: Binding) -> Iterator[tuple[Fact, bool]]:
        head = effect[0]
        if head == "and":
            for part in effect[1:]:
                yield from self.changes(part, binding)
        elif head == "forall":
            for chosen in self.choices(typed(effect[1]), effect[2], binding):
                yield from self.changes(effect[2], chosen)
        elif head == "when":
            if self.holds(effect[1], binding):
                yield from self.changes(effect[2], binding)
        elif head == "increase":
            self.cost += int(effect[2])
        elif head == "not":
            yield self.ground(effect[1], binding), False
        else:
            yield self.ground(effect, binding), True

    def choices(
        self, names: list[tuple[str, str]], effect: list[Any], binding: Binding
    ) -> Iterator[Binding]:
        """Yield values of variables that make a condition's leading atom true."""
        if effect[0] == "when" and effect[1][0] == "and":
            atom = effect[1][1]
            matches = [self.match(atom, fact, binding) for fact in self.facts if fact[0] == atom[0]]
        else:
            matches = [binding]
        for match in matches:
            if match is not None:
                left = [(name, kind) for name, kind in names if name not in match]
                for values in product(*(self.by_type.get(kind, []) for _, kind in left)):
                    yield {**match, **{n: v for (n, _), v in zip(left, values, strict=True)}}

    def match(self, atom: list[str], fact: Fact, binding: Binding) -> Binding | None:
        found = dict(binding)
        for term, value in zip(atom[1:], fact[1:], strict=True):
            if found.setdefault(term, value if term.startswith("?") else term) != value:
                return None
        return found

    def ground(self, atom: list[str], binding: Binding) -> Fact:
        return (atom[0], *(binding[a] if a.startswith("?") else a for a in atom[1:]))
