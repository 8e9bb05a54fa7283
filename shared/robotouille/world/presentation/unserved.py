"""Dishes on a station for serving that no open order takes, and what is wrong with them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

from robotouille.domain.schema import GoalTerm
from robotouille.world.grounding.goal import Binding, Goal
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.shift import ShiftRules
from robotouille.world.text import describe
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State


@dataclass(frozen=True, slots=True)
class Unserved:
    """Dish that stays on a station for serving although it looks ready.

    Attributes:
        station: The station.
        things: All things on the station.
        dish: The dish's name. If the things are no dish, the ordered one that is nearest to them.
        fault: The first thing that is wrong with the dish, in words. It is empty if the dish is
            ready, but nobody has ordered it.
    """

    station: str
    things: frozenset[str]
    dish: str
    fault: str = ""


class _Misfit(NamedTuple):
    """Difference between some things and a dish: goal terms that fail, and things too many."""

    dish: str
    goal: Goal
    failing: list[GoalTerm]
    chosen: Binding
    surplus: list[str]

    @property
    def size(self) -> int:
        return len(self.failing) + len(self.surplus)


def unserved(state: State, wording: Wording) -> tuple[Unserved, ...]:
    """Return the dishes of a shift that look ready but are not served."""
    rules = state.world.shift
    if rules is None or state.shift_over:
        return ()
    piles = {station: rules.things_on(station, state.facts) for station in rules.serving}
    found = (_on(station, pile, state, wording) for station, pile in piles.items() if pile)
    return tuple(each for each in found if each is not None)


def _on(station: str, things: frozenset[str], state: State, wording: Wording) -> Unserved | None:
    rules, orders = state.world.shift, state.orders
    if rules is None or orders is None:
        return None
    if dish := rules.dish_of(things, state.facts):
        return Unserved(station, things, dish)
    wanted = dict.fromkeys(rules.dish_name(order.number) for order in orders.by_urgency)
    misfits = [_misfit(rules, dish, things, state.facts) for dish in wanted]
    nearest = min(misfits, key=lambda misfit: misfit.size, default=None)
    if nearest is None or not _looks_ready(rules, nearest, things, state):
        return None
    return Unserved(station, things, nearest.dish, _fault(nearest, station, state, wording))


def _misfit(rules: ShiftRules, dish: str, things: frozenset[str], facts: int) -> _Misfit:
    goal = rules.goal(dish)
    fit = goal.fit(rules.returns.facts_about(things, facts))
    failing = [term for term, holds in zip(goal.terms, fit.holding, strict=True) if not holds]
    # Places come first: whoever forgot an ingredient need not read that it has to be cut.
    failing.sort(key=lambda term: len(term.ids) < 2)
    return _Misfit(dish, goal, failing, fit.chosen, sorted(things - {*fit.chosen.values()}))


def _looks_ready(rules: ShiftRules, misfit: _Misfit, things: frozenset[str], state: State) -> bool:
    """Return whether players who see the things would expect them to be served."""
    if len(misfit.surplus) == len(things):
        return False
    if len(things) >= rules.parts[misfit.dish]:
        return True
    placed = [each for name, each in scene(state).items() if name in things]
    if any(each.host in things for each in placed):  # A container that has been filled.
        return True
    uppermost = max(placed, key=lambda each: each.level).thing.kind
    kinds = Counter(each.thing.kind for each in placed)
    needed = Counter(variable.kind for variable in misfit.goal.variables.values())
    return uppermost in _tops(rules, misfit.goal) and kinds[uppermost] >= needed[uppermost]


def _tops(rules: ShiftRules, goal: Goal) -> set[str]:
    """Return the kinds of the things that are the uppermost ones of a dish's stacks."""
    stacks = rules.returns.rules["next_in_stack"]
    pairs = [term.ids for term in goal.terms if term.predicate in stacks]
    covered = {below for _, below in pairs}
    return {goal.variables[above].kind for above, _ in pairs if above not in covered}


def _fault(misfit: _Misfit, station: str, state: State, wording: Wording) -> str:
    if not misfit.failing:
        return f"{wording.thing(misfit.surplus[0], state)} does not belong to it"
    term, chosen = misfit.failing[0], dict(misfit.chosen)
    for identifier in term.ids:
        if identifier not in chosen:
            candidates = misfit.goal.candidates(identifier)
            free = [name for name in candidates if name not in chosen.values()]
            here = [name for name in free if name == station]
            unmade = wording.kind(misfit.goal.variables[identifier].kind)
            chosen[identifier] = next(iter([*here, *free]), unmade)
    names = tuple(chosen[identifier] for identifier in term.ids)
    words = describe(state.world.task.domain, (term.predicate, *names))
    return wording.reason(Unmet(UnmetKind.CONDITION, words, term.predicate, names), state)
