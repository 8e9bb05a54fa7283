"""The goal as pictures of dishes, from its terms and the rendering. Nothing here draws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from robotouille.world.grounding.objects import Object
from robotouille.world.scene import Placed
from robotouille.world.world import World
from robotouille_client.window.pictures.appearance import Appearance, AppearanceResolver

# Variable of a goal, as in the `ids` of its terms.
Variable = int | str
BOTTOM, MIDDLE, TOP = range(3)
# Level of an object that is not in its place yet: above all others.
UNPLACED = 1_000_000


@dataclass(frozen=True, slots=True)
class Layer:
    """One object of a wanted dish.

    Attributes:
        terms: Numbers of the goal's terms about the object.
        conditions: The same terms in words.
        below: Numbers of the terms about the objects below it.
        places: Terms that count only if `base` holds. A bun lies in its place, for instance, once
            it is on the table that the dish's lowest object is on.
    """

    appearance: Appearance
    words: str
    terms: tuple[int, ...]
    conditions: tuple[str, ...] = ()
    below: tuple[int, ...] = ()
    places: tuple[int, ...] = ()
    base: tuple[int, ...] = ()

    def holding(self, holding: Sequence[bool]) -> tuple[bool, ...]:
        """Return which of the layer's terms hold, given those of the whole goal."""
        based = all(holding[n] for n in self.base)
        return tuple(holding[n] and (based or n not in self.places) for n in self.terms)


@dataclass(frozen=True, slots=True)
class Dish:
    """Objects that the goal relates, from the top down to the one that carries all, the `root`."""

    layers: tuple[Layer, ...]
    root: Variable = 0

    @property
    def shape(self) -> tuple[str, ...]:
        """Objects of the dish as words. Dishes of the same shape can replace each other."""
        return tuple(sorted(layer.words for layer in self.layers))


def dishes(
    world: World,
    resolver: AppearanceResolver,
    levels: Mapping[Variable, int] = MappingProxyType({}),
) -> tuple[Dish, ...] | None:
    """Return the goal's dishes in order, or None if the goal cannot be drawn.

    Goals about particular players, about any object of a type, or with relations of three objects
    cannot be drawn.

    Args:
        levels: Levels of the objects already in place. Among objects that may be stacked in any
            order, these come first, as they lie.
    """
    goal = _Goal(world, resolver, levels)
    return goal.dishes() if goal.drawable else None


class _Goal:
    def __init__(
        self, world: World, resolver: AppearanceResolver, levels: Mapping[Variable, int]
    ) -> None:
        self._resolver = resolver
        self._levels = levels
        self._terms = world.goal.terms
        domain = world.task.domain
        self._stations = set(domain.station_types)
        self._when = {rule.predicate: rule.when for rule in domain.layout or () if rule.when}
        types = {p.name: p.param_types for p in domain.predicate_defs}
        self._says = {p.name: p.language_descriptors.get("0", "") for p in domain.predicate_defs}
        self._kinds: dict[Variable, str] = {}
        self._types: dict[Variable, str] = {}
        for term in self._terms:
            for i, kind, type_ in zip(term.ids, term.args, types[term.predicate], strict=True):
                self._kinds[i], self._types[i] = kind, type_
        self.drawable = (
            bool(self._terms)
            and all(1 <= len(term.ids) <= 2 for term in self._terms)
            and not any(variable.is_type for variable in world.goal.variables.values())
            and not set(self._types.values()) & set(domain.player_types)
        )

    def dishes(self) -> tuple[Dish, ...]:
        self._carriers = self._find_carriers()
        self._placed = {_name(i): self._as_placed(i) for i in self._kinds}
        self._related = {_name(i): list(self._facts_of(i)) for i in self._kinds}
        roots = [i for i in self._kinds if i not in self._carriers]
        seen: set[Variable] = set()
        found = [Dish(tuple(self._layers(root, seen))[::-1], root) for root in roots]
        rest = [Dish(tuple(self._layers(i, seen))[::-1], i) for i in self._kinds if i not in seen]
        return tuple(dish for dish in (*found, *rest) if dish.layers)

    def _find_carriers(self) -> dict[Variable, Variable]:
        """Return what each object lies on or in, by the goal's most specific term about it."""
        found: dict[Variable, tuple[int, Variable]] = {}
        for term in self._terms:
            if len(term.ids) == 2:
                first, second = term.ids
                when = self._when.get(term.predicate)
                if when != "next_in_stack" and self._types[first] in self._stations:
                    first, second = second, first
                on_station = self._types[second] in self._stations
                # A stack relation says more about a place than a container does, and a station
                # the least.
                rank = 2 if when == "next_in_stack" else 1 if not on_station else 0
                if first != second and rank >= found.get(first, (-1, 0))[0]:
                    found[first] = (rank, second)
        return {thing: carrier for thing, (_, carrier) in found.items()}

    def _layers(self, root: Variable, seen: set[Variable]) -> Iterator[Layer]:
        """Yield an object and everything it carries, from the bottom up."""
        if root in seen:
            return
        seen.add(root)
        merged = [i for i in self._carried(root) if self._shown_by(i, root)]
        terms = [n for i in (root, *merged) for n in self._about(i)]
        if terms or self._types[root] in self._stations or root in self._carriers.values():
            appearance = self._resolver.appearance(
                self._placed[_name(root)], self._placed, self._related
            )
            words = " with ".join(self._words(i) for i in (root, *merged))
            conditions = tuple(self._condition(n) for n in terms)
            yield Layer(
                appearance, words, tuple(terms), conditions, tuple(self._below(root)),
                tuple(n for n in terms if len(self._terms[n].ids) == 2), tuple(self._base(root)),
            )  # fmt: skip
        for above in self._carried(root):
            if above in merged:
                seen.add(above)
                for inside in self._carried(above):
                    yield from self._layers(inside, seen)
            else:
                yield from self._layers(above, seen)

    def _below(self, thing: Variable) -> list[int]:
        """Return the terms about everything below an object in its stack."""
        carrier = self._carriers.get(thing)
        if carrier is None:
            return []
        under = [i for i in self._carried(carrier) if self._is_below(i, thing)]
        if any(self._when.get(self._terms[n].predicate) == "next_in_stack"
               and self._terms[n].ids == (thing, carrier) for n in self._about(thing)):  # fmt: skip
            under.append(carrier)
        return [n for i in under for n in (*self._about(i), *self._below(i))]

    def _is_below(self, one: Variable, other: Variable) -> bool:
        """Return whether an object belongs below another, or already lies there."""
        (order, level), (its, above) = self._height(one), self._height(other)
        return order < its or (order == its and level < above < UNPLACED)

    def _height(self, thing: Variable) -> tuple[int, int]:
        """Return where in its stack an object belongs, and its level now."""
        return self._order(thing), self._levels.get(thing, UNPLACED)

    def _base(self, thing: Variable) -> list[int]:
        """Return the terms that place the lowest object of the stack, for the objects above it."""
        carrier = self._carriers.get(thing)
        if carrier is None or self._order(thing) == BOTTOM:
            return []
        lowest = [i for i in self._carried(carrier) if self._order(i) == BOTTOM]
        return [n for i in lowest for n in self._about(i) if len(self._terms[n].ids) == 2]

    def _words(self, thing: Variable) -> str:
        facts = {term.predicate for term in self._terms if thing in term.ids}
        return self._resolver.words(self._kinds[thing], facts)

    def _condition(self, number: int) -> str:
        """Return a goal term in the domain's words."""
        term = self._terms[number]
        kinds = [f"the {self._resolver.words(kind, ())}" for kind in term.args]
        says = self._says[term.predicate] or " ".join((term.predicate, *("{}",) * len(kinds)))
        return says.format(*kinds)

    def _carried(self, carrier: Variable) -> list[Variable]:
        """Return what lies directly on or in an object, the lowest first."""
        carried = [thing for thing, host in self._carriers.items() if host == carrier]
        return sorted(carried, key=self._height)

    def _order(self, thing: Variable) -> int:
        rules = [self._when.get(self._terms[n].predicate) for n in self._about(thing)]
        return BOTTOM if "bottom_of_stack" in rules else TOP if "top_of_stack" in rules else MIDDLE

    def _about(self, thing: Variable) -> list[int]:
        """Return the terms about an object itself, not about what it carries."""
        return [
            number
            for number, term in enumerate(self._terms)
            if (term.ids[0] == thing and not self._is_carrier(term.ids))
            or (len(term.ids) == 2 and term.ids[1] == thing and self._is_carrier(term.ids))
        ]

    def _is_carrier(self, ids: tuple[Variable, ...]) -> bool:
        """Return whether the first of two objects carries the second."""
        return len(ids) == 2 and self._carriers.get(ids[1]) == ids[0]

    def _shown_by(self, thing: Variable, carrier: Variable) -> bool:
        """Return whether an object is visible only in the picture of its container."""
        rendering = self._resolver.rendering
        group = rendering.group_of(self._kinds[carrier])
        if group is None:
            return False
        inside = group.entities[self._kinds[carrier]].assets.named.get(self._kinds[thing])
        return inside is not None and inside.asset is None

    def _as_placed(self, thing: Variable) -> Placed:
        made = Object(_name(thing), self._kinds[thing], self._types[thing])
        facts = frozenset(t.predicate for t in self._terms if t.ids == (thing,))
        host = self._carriers.get(thing)
        return Placed(made, None, None if host is None else _name(host), facts=facts)

    def _facts_of(self, thing: Variable) -> Iterator[tuple[str, ...]]:
        for term in self._terms:
            if thing in term.ids:
                yield (term.predicate, *term.args)


def _name(variable: Variable) -> str:
    return f"goal {variable}"
