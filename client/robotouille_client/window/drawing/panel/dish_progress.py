"""How far the dishes of a goal are in a state: which things they are made of, and what is done.

Pure: nothing here draws, and nothing knows what a goal is about.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robotouille.world.grounding.goal import Fit
from robotouille.world.people.usefulness import work_towards
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.pictures.dishes import Dish, Variable

__all__ = [
    "LayerProgress",
    "fit",
    "kept_in_place",
    "progress",
    "shares",
    "stack_levels",
]


@dataclass(frozen=True, slots=True)
class LayerProgress:
    """How far a layer is: the share of what had to be done for it, and whether it is `settled`.

    That is one that is as it is to be, with all below it: nothing of it has to be undone. A layer
    that was right from the start, such as a plate that stands on a table anyway, is settled as
    soon as something else of its dish is.
    """

    share: float
    settled: bool


def progress(
    dish: Dish, holding: Sequence[bool], at_first: Sequence[bool], shares: Sequence[float] = ()
) -> tuple[LayerProgress, ...]:
    """How far each layer of a dish is, by the terms that hold now and at the start of a game, and
    the shares of those that are being worked on.

    A layer about which the goal says nothing is settled with the whole dish.
    """
    now = [each.holding(holding) for each in dish.layers]
    first = [each.holding(at_first) for each in dish.layers]
    right = [
        bool(each.terms) and all(done) and all(holding[n] for n in each.below)
        for each, done in zip(dish.layers, now, strict=True)
    ]
    begun = any(fine and not all(before) for fine, before in zip(right, first, strict=True))
    whole = all(map(all, now))
    found = []
    for layer, fine, done, before in zip(dish.layers, right, now, first, strict=True):
        rows = zip(layer.terms, done, before, strict=True)
        to_do = [(n, held) for n, held, already in rows if not already]
        share = sum(1.0 if held else shares[n] if shares else 0.0 for n, held in to_do)
        settled = whole or (fine and (bool(to_do) or begun))
        found.append(LayerProgress(1.0 if settled else share / max(1, len(to_do)), settled))
    return tuple(found)


def fit(dishes: Sequence[Dish], state: State) -> Fit:
    """What of the goal holds, and which things stand for its own.

    What lies where it belongs counts first: the tomato on a burger is that burger's, though
    another one could have it as well. A place counts only where its base holds.
    """
    layers = [layer for dish in dishes for layer in dish.layers]
    places = [(n, layer.base) for layer in layers for n in layer.places]
    places.sort(key=lambda one: (len(one[1]) > 0, one[0]))
    facts = sorted(n for layer in layers for n in layer.terms if n not in layer.places)
    return state.world.goal.fit(state.facts, (*places, *((n, ()) for n in facts)))


def shares(state: State, holding: Sequence[bool]) -> tuple[float, ...]:
    """How far the work is that will bring each term of the goal about, as a share; 0 for a term
    that holds, that nobody works for, or that is about more than one thing. Work on one thing is
    for one term, the first of those that are alike."""
    under_way: dict[tuple[str, str], dict[str, float]] = {}
    for atom, share in work_towards(state):
        if len(atom) == 2:
            things = under_way.setdefault((atom[0], state.world.thing(atom[1]).kind), {})
            things[atom[1]] = max(share, things.get(atom[1], 0.0))
    rest = {about: sorted(things.values()) for about, things in under_way.items()}
    found = []
    for term, held in zip(state.world.goal.terms, holding, strict=True):
        waiting = [] if held or len(term.ids) > 1 else rest.get((term.predicate, term.args[0]), [])
        found.append(waiting.pop() if waiting else 0.0)
    return tuple(found)


def stack_levels(state: State, fit: Fit) -> dict[Variable, int]:
    """How many things lie below each that is where the goal wants it."""
    placed = scene(state)
    found: dict[Variable, int] = {}
    for term, held in zip(state.world.goal.terms, fit.holding, strict=True):
        if held and len(term.ids) == 2:
            for one, other in (term.ids, term.ids[::-1]):
                there = placed.get(fit.chosen[one])
                if there is not None and there.host == fit.chosen[other]:
                    found[one] = there.level
    return found


def kept_in_place(
    dishes: Sequence[Dish], chosen: Mapping[Variable, str], before: Mapping[int, str]
) -> tuple[tuple[Dish, ...], dict[int, str]]:
    """Dishes in such an order that each is where the same thing has carried it before; and what
    carries the dish at each place now.

    Which of two burgers is the first is for the goal to choose, and it may choose anew when one of
    them has become the better one.

    Args:
        chosen: What stands for the variables of the goal.
        before: What has carried the dish at a place.
    """
    placed: dict[int, Dish] = {}
    for dish in dishes:
        root = chosen.get(dish.root)
        places = (
            place
            for place, other in enumerate(dishes)
            if place not in placed and before.get(place) == root and other.shape == dish.shape
        )
        if root is not None and (place := next(places, None)) is not None:
            placed[place] = dish
    for place, other in enumerate(dishes):
        if place not in placed:
            rest = [each for each in dishes if each not in placed.values()]
            placed[place] = next(each for each in rest if each.shape == other.shape)
    order = tuple(placed[place] for place in range(len(dishes)))
    now = {n: chosen[dish.root] for n, dish in enumerate(order) if dish.root in chosen}
    return order, {**before, **now}
