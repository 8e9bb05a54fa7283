"""The goal as a list of conditions in a fixed order, for a search without any objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

from robotouille.domain.schema import GoalTerm
from robotouille.world.grounding.atoms import EXISTS, bits_of
from robotouille.world.grounding.objects import Atom
from robotouille.world.world import World

__all__ = ["Choice", "ConditionRule", "GoalRule", "goal_rule"]


@dataclass(frozen=True, slots=True)
class Choice:
    """Objects that meet a condition, one for each of its variables, while all `atoms` hold."""

    objects: tuple[int, ...]
    atoms: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ConditionRule:
    """One condition of the goal: `variables` without repetition, and its choices."""

    variables: tuple[int, ...]
    choices: tuple[Choice, ...]


@dataclass(frozen=True, slots=True)
class GoalRule:
    """The conditions, those first of which the fewest choices hold at first and are left after
    those before; `kinds` of variables: two of one kind are different objects."""

    conditions: tuple[ConditionRule, ...]
    kinds: tuple[int, ...]


def goal_rule(world: World, atoms: Mapping[Atom, int], objects: Mapping[str, int]) -> GoalRule:
    """The goal of a world in the numbers of its encoding."""
    identifiers = list(world.goal.variables)
    kinds = [variable.kind for variable in world.goal.variables.values()]
    numbers = {identifier: i for i, identifier in enumerate(identifiers)}
    rules = []
    for term in world.goal.terms:
        distinct = list(dict.fromkeys(term.ids))
        places = [term.ids.index(identifier) for identifier in distinct]
        choices = tuple(
            Choice(tuple(objects[names[place]] for place in places), needed)
            for names, needed in _choices(world, term, atoms)
            if all(name in objects for name in names) and _suits(world, term, names)
        )
        rules.append(ConditionRule(tuple(numbers[i] for i in distinct), choices))
    initial = {i for atom, i in atoms.items() if world.initial.facts & world.table.bit.get(atom, 0)}
    order = _in_order(rules, initial)
    return GoalRule(tuple(order), tuple(kinds.index(kind) for kind in kinds))


def _choices(
    world: World, term: GoalTerm, atoms: Mapping[Atom, int]
) -> Iterator[tuple[tuple[str, ...], tuple[int, ...]]]:
    """Names that meet a condition, and the atoms that have to hold for it."""
    table = world.table
    if term.predicate not in table.static_predicates:
        for atom in (table.atoms[i] for i in bits_of(world.goal.possible_mask(term))):
            if atom in atoms:
                yield atom[1:], (atoms[atom],)
        return
    pools = [world.goal.candidates(identifier) for identifier in term.ids]
    for atom in sorted(a for a in table.static if a[0] == term.predicate):
        if all(name in pool for name, pool in zip(atom[1:], pools, strict=True)):
            exist = [(EXISTS, name) for name in dict.fromkeys(atom[1:])]
            yield atom[1:], tuple(atoms[e] for e in exist if e in table.bit)


def _suits(world: World, term: GoalTerm, names: tuple[str, ...]) -> bool:
    """Whether equal ids are equal objects, and different ids of a kind different ones."""
    variables = world.goal.variables
    for (one, name), (other, taken) in combinations(zip(term.ids, names, strict=True), 2):
        alike = variables[one].kind == variables[other].kind
        if name != taken if one == other else name == taken and alike:
            return False
    return True


def _in_order(rules: list[ConditionRule], initial: set[int]) -> Iterator[ConditionRule]:
    """Next is always the condition that leaves the fewest choices, and is the least often met."""
    left, bound = list(rules), set[int]()

    def cost(rule: ConditionRule) -> tuple[bool, int, int]:
        new = sum(variable not in bound for variable in rule.variables)
        holding = sum(set(choice.atoms) <= initial for choice in rule.choices)
        return bool(bound) and new == len(rule.variables), holding, new

    while left:
        rule = min(left, key=cost)
        left.remove(rule)
        bound.update(rule.variables)
        yield rule
