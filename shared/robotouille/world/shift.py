"""Shifts: orders that arrive over time, are served, or expire (docs/shifts.md).

`Orders` is the part of a state that only tasks with a shift have. `ShiftRules` computes it, and the
facts that serving changes, at the end of each step. It knows nothing of players, so the orders of a
seed are the same whatever the players do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, NamedTuple

from robotouille.domain.schema import MAX_POINTS, Arrival, Dish, Shift
from robotouille.errors import WrongArgumentError, WrongWorldError
from robotouille.world.grounding.atoms import AtomTable, bits_of
from robotouille.world.grounding.goal import Goal, Variable
from robotouille.world.grounding.ground_task import GroundTask
from robotouille.world.grounding.objects import Object
from robotouille.world.timers import Timers

MAX_KEPT = 2_000
"""Arrangements of things for which it is known whether they are a dish."""
MAX_TRIED = 100
"""Choices of parts that are tried, which matters only to dishes with parts of any kind."""


class OpenOrder(NamedTuple):
    """Order that waits for its dish: its number in the shift, and the step in which it expires."""

    number: int
    due: int


class Orders(NamedTuple):
    """Orders of a shift at one moment.

    Attributes:
        time: Steps since the beginning of the shift.
        open: The open orders, in the order of their arrival.
        arrived: The number of orders so far, open or not.
        score: Points for served dishes, less the penalties for expired orders.
        served: The number of served orders.
        expired: The number of expired orders.
    """

    time: int
    open: tuple[OpenOrder, ...]
    arrived: int
    score: int
    served: int
    expired: int

    @property
    def row(self) -> list[Any]:
        """The orders as JSON values; `ShiftRules.restored` reads them back."""
        return [self.time, [list(order) for order in self.open], *self[2:]]

    def waited(self) -> Orders:
        """Return the orders a step later, if nothing else has changed."""
        return self._replace(time=self.time + 1)

    @property
    def by_urgency(self) -> list[OpenOrder]:
        """The open orders, the one that expires first at the beginning."""
        return sorted(self.open, key=lambda order: (order.due, order.number))


class Fulfilment(NamedTuple):
    """Result of a step: the facts and timers after serving, and the orders."""

    facts: int
    timers: Timers
    orders: Orders


class ShiftRules:
    """Rules of a task's shift, over the atoms of its world. All times are in steps of the task.

    Attributes:
        menu: The dishes by name.
        most_open: The largest number of open orders.
        steps: The length of the shift.
        bound: Points that nobody can exceed.
        initial: The orders in the initial state.
        parts: By dish, the number of things that it consists of.
        serving: The stations that serve, each with the thing of each fact that puts one there.
        discarding: The stations that return things without serving them.
        returns: The rules by which things return.
    """

    def __init__(self, task: GroundTask, shift: Shift) -> None:
        self._task = task
        self._factor = task.task.profile.delay_factor
        self.menu = shift.menu
        self.most_open = shift.most_open
        self.steps = shift.steps * self._factor
        self.bound = shift.bound(self._factor) or 0
        # `build_task` has drawn the orders.
        self._arrivals = tuple(each for each in shift.arrivals if isinstance(each, Arrival))
        self._goals = {
            name: Goal(task.task, task.table, task.all_objects, dish.goal)
            for name, dish in shift.menu.items()
        }
        self.returns = Return(task, shift)
        self.parts = {
            name: sum(self.returns.moves(_type_of(v, task)) for v in goal.variables.values())
            for name, goal in self._goals.items()
        }
        self._known: dict[tuple[str, frozenset[str], int], bool] = {}
        self._counter, self._bins = shift.serve.station, shift.discard
        self._find_surfaces()
        self.initial = self._arrive(Orders(0, (), 0, 0, 0, 0))

    def refresh(self) -> None:
        """Include objects that have been added to the world."""
        for goal in self._goals.values():
            goal.refresh()
        self._known.clear()
        self.returns.refresh()
        self._find_surfaces()

    def _find_surfaces(self) -> None:
        returns, bins = self.returns, self._bins
        self.serving = returns.surfaces(self._counter)
        self.discarding = returns.surfaces(bins) if bins is not None else {}
        self._serving_mask = returns.things_mask(self.serving)
        self._discarding_mask = returns.things_mask(self.discarding)

    # Orders

    @property
    def arrivals(self) -> tuple[tuple[int, str], ...]:
        """The time and the dish of each order."""
        return tuple((each.at * self._factor, each.dish) for each in self._arrivals)

    def dish_name(self, number: int) -> str:
        """Return the name of the dish of an order."""
        return self._arrivals[number].dish

    def goal(self, name: str) -> Goal:
        """Return the conditions of a dish."""
        return self._goals[name]

    def dish(self, number: int) -> Dish:
        """Return the dish of an order."""
        return self.menu[self.dish_name(number)]

    def patience(self, number: int) -> int:
        """Return the number of steps that an order stays open."""
        return self.patience_for(self.dish_name(number))

    def patience_for(self, name: str) -> int:
        """Return the number of steps that an order of a dish stays open."""
        return self.menu[name].patience * self._factor

    def worth(self, order: OpenOrder, time: int) -> int:
        """Return the points for an open order whose dish is served at a time."""
        dish, left = self.dish(order.number), max(0, order.due - time)
        return dish.points + dish.tip * left // self.patience(order.number)

    def over(self, orders: Orders) -> bool:
        """Return whether the shift has ended."""
        return orders.time >= self.steps

    def advance(self, facts: int, timers: Timers, orders: Orders) -> Fulfilment:
        """Return what follows from a step: served dishes, expired orders and new ones."""
        if self.over(orders):
            return Fulfilment(facts, timers, orders)
        orders = orders.waited()
        if facts & self._discarding_mask:
            for surface in self.discarding.values():
                things = self.returns.things_at(surface, facts)
                facts, timers = self.returns.put_back(things, facts, timers, soiled=False)
        if facts & self._serving_mask and orders.open:
            for surface in self.serving.values():
                facts, timers, orders = self._serve(surface, facts, timers, orders)
        if any(order.due <= orders.time for order in orders.open):
            orders = self._expire(orders)
        if self._next_is_due(orders):
            orders = self._arrive(orders)
        return Fulfilment(facts, timers, orders)

    def _serve(
        self, surface: dict[int, str], facts: int, timers: Timers, orders: Orders
    ) -> Fulfilment:
        things = self.returns.things_at(surface, facts)
        if not things:
            return Fulfilment(facts, timers, orders)
        alone = self.returns.facts_about(things, facts)
        # Of two orders for one dish, the dish goes to the one that expires first.
        for order in orders.by_urgency:
            if self._is_dish(self.dish_name(order.number), things, alone):
                facts, timers = self.returns.put_back(things, facts, timers, soiled=True)
                left = tuple(each for each in orders.open if each != order)
                score = orders.score + self.worth(order, orders.time)
                orders = orders._replace(open=left, score=score, served=orders.served + 1)
                break
        return Fulfilment(facts, timers, orders)

    def things_on(self, station: str, facts: int) -> frozenset[str]:
        """Return all things on a station that serves."""
        return self.returns.things_at(self.serving[station], facts)

    def fits(self, name: str, facts: int) -> bool:
        """Return whether a station for serving is empty, or has only parts of a dish."""
        if not facts & self._serving_mask:
            return True
        piles = [self.things_on(station, facts) for station in self.serving]
        return any(self._belong_to(name, pile, facts) for pile in piles)

    def _belong_to(self, name: str, things: frozenset[str], facts: int) -> bool:
        fit = self._goals[name].fit(self.returns.facts_about(things, facts))
        return things <= {*fit.chosen.values()}

    def dish_of(self, things: frozenset[str], facts: int) -> str:
        """Return the name of the dish that the things form; empty if they form no dish."""
        alone = self.returns.facts_about(things, facts)
        return next((name for name in self.menu if self._is_dish(name, things, alone)), "")

    def _is_dish(self, name: str, things: frozenset[str], facts: int) -> bool:
        """Return whether the things are a dish, and nothing else."""
        goal = self._goals[name]
        # Without this test, the search would go through all choices of parts from a large pile.
        if len(things) != self.parts[name]:
            return False
        # Facts that never change may be all that a dish says about a part.
        key = name, things, facts & goal.relevant
        known = self._known.get(key)
        if known is None:
            if len(self._known) >= MAX_KEPT:
                self._known.clear()
            movable = self.returns.movable
            known = self._known[key] = any(
                movable.intersection(binding.values()) == things
                for binding in islice(goal.assignments(facts), MAX_TRIED)
            )
        return known

    def _expire(self, orders: Orders) -> Orders:
        late = [order for order in orders.open if order.due <= orders.time]
        return orders._replace(
            open=tuple(order for order in orders.open if order not in late),
            score=orders.score - sum(self.dish(order.number).penalty for order in late),
            expired=orders.expired + len(late),
        )

    def _next_is_due(self, orders: Orders) -> bool:
        return (
            orders.arrived < len(self._arrivals)
            and len(orders.open) < self.most_open
            and self._arrivals[orders.arrived].at * self._factor <= orders.time
        )

    def _arrive(self, orders: Orders) -> Orders:
        while self._next_is_due(orders):
            number = orders.arrived
            new = OpenOrder(number, orders.time + self.patience(number))
            orders = orders._replace(open=(*orders.open, new), arrived=number + 1)
        return orders

    def restored(self, row: Any) -> Orders:
        """Return the orders for values that come from outside this process.

        Raises:
            WrongArgumentError: The values are not of the form of `Orders.row`.
            WrongWorldError: The shift has no such orders.
        """
        try:
            time, listed, *numbers = row
            opened = tuple(OpenOrder(*order) for order in listed)
            orders = Orders(time, opened, *numbers)
        except (TypeError, ValueError):
            raise WrongArgumentError(f"expected the orders of a shift, found {row!r}") from None
        values = [*orders[:1], *orders[2:], *(value for order in opened for value in order)]
        if not all(type(value) is int for value in values):
            raise WrongArgumentError(f"expected the orders of a shift, found {row!r}")
        if not (0 <= orders.time <= self.steps and 0 <= orders.arrived <= len(self._arrivals)):
            raise WrongWorldError(f"the shift has no such orders: {row!r}")
        if not self._is_possible(orders):
            raise WrongWorldError(f"the shift has no such orders: {row!r}")
        return orders

    def _is_possible(self, orders: Orders) -> bool:
        numbers = [order.number for order in orders.open]
        counts = orders.served, orders.expired
        return (
            len(numbers) <= self.most_open
            and numbers == sorted(set(numbers))
            and all(0 <= number < orders.arrived for number in numbers)
            and all(0 < o.due - orders.time <= self.patience(o.number) for o in orders.open)
            and abs(orders.score) <= 2 * MAX_POINTS * orders.arrived
            and min(counts) >= 0
            and sum(counts) + len(numbers) == orders.arrived
        )


def _type_of(variable: Variable, task: GroundTask) -> str:
    """Return the type of the objects that a variable of a dish can stand for."""
    if variable.is_type:
        return variable.kind
    if variable.fixed is not None:
        return task.thing(variable.fixed).type
    return next((o.type for o in task.all_objects() if o.kind == variable.kind), variable.kind)


class Return:
    """Returns things from a surface to where they were at the beginning of the task.

    Attributes:
        homes: The station of each thing that can move; None for what a thing contains.
        stations: The stations.
        rules: Predicates of the layout, by the position to which they belong.
        defaults: Facts that hold unless others do, as predicates.
        derived: Predicates that follow from positions.
        soils: Predicates that served things lose.
        movable: Names of all objects that can move.
    """

    def __init__(self, task: GroundTask, shift: Shift) -> None:
        self._task = task
        self._table: AtomTable = task.table
        self.soils = frozenset(shift.serve.soils)
        self._predicates = shift.serve.predicates
        self._leaving = {shift.serve.station, shift.discard}
        domain = task.task.domain
        self._fixed_types = {*domain.station_types, *domain.player_types}
        self._types = {p.name: p.param_types for p in domain.predicate_defs}
        rules = domain.layout or ()
        self.rules = {
            when: [rule.predicate for rule in rules if rule.when == when]
            for when in ("shares_tile", "bottom_of_stack", "next_in_stack", "top_of_stack")
        }
        self.defaults = [(rule.predicate, rule.unless) for rule in rules if rule.unless]
        # Facts that follow from positions are computed again when a thing returns.
        self.derived = {rule.predicate for rule in rules}
        self.stations = [o for o in task.placed if o.type in domain.station_types]
        self.homes = {o.name: self._home(o) for o in task.placed if self.moves(o.type)}
        self.refresh()

    def refresh(self) -> None:
        """Include objects that have been added to the world."""
        everything = self._task.all_objects()
        self.movable = frozenset(o.name for o in everything if self.moves(o.type))

    def moves(self, type_: str) -> bool:
        """Return whether objects of a type can be served or thrown away."""
        return type_ not in self._fixed_types

    def _home(self, thing: Object) -> str | None:
        """Return the station where a thing is at the beginning; None for what a thing contains."""
        here = next((o.name for o in self.stations if o.tile == thing.tile), None)
        shared = ((p, thing.name, here or "") for p in self.rules["shares_tile"])
        return here if self._table.mask(shared) else None

    # Surfaces

    def surfaces(self, kind: str) -> dict[str, dict[int, str]]:
        """Return the stations of a kind, with the thing of each fact that puts one there."""
        return {
            station.name: {
                self._table.bit[atom]: atom[1]
                for atom in self._table.bit
                if atom[0] in self._predicates and atom[2:] == (station.name,)
            }
            for station in self._task.placed
            if station.kind == kind
        }

    def things_mask(self, surfaces: dict[str, dict[int, str]]) -> int:
        """Return the mask of all facts that put a thing on a surface."""
        mask = 0
        for surface in surfaces.values():
            for bit in surface:
                mask |= bit
        return mask

    def things_at(self, surface: dict[int, str], facts: int) -> frozenset[str]:
        """Return the things on a surface, with what is in or on them."""
        found = {name for bit, name in surface.items() if facts & bit}
        waiting = list(found)
        while waiting:
            for other in self._related(waiting.pop(), facts):
                if other not in found:
                    found.add(other)
                    waiting.append(other)
        return frozenset(found)

    def _related(self, name: str, facts: int) -> Iterator[str]:
        atoms = self._table.atoms
        for bit in bits_of(facts & self._table.mentions(name)):
            yield from self.movable.intersection(atoms[bit][1:])

    def facts_about(self, things: Iterable[str], facts: int) -> int:
        """Return the facts without those about other things that can move."""
        for name in self.movable.difference(things):
            facts &= ~self._table.mentions(name)
        return facts

    # Putting back

    def put_back(
        self, things: frozenset[str], facts: int, timers: Timers, *, soiled: bool
    ) -> tuple[int, Timers]:
        """Return the facts and timers after things have returned to their first places.

        Created things cease to exist. `soiled` things lose the facts of `Serving.soils`; others
        keep them only if they have them now.
        """
        if not things:
            return facts, timers
        kept = things.intersection(self.homes)
        touched = {name for thing in things for name in self._places_of(thing, facts)}
        touched -= things - kept
        unsoiled = self._unsoiled(kept, facts) if not soiled else 0
        # The names of created things become free again. Otherwise each pot of water would add
        # atoms, and players could slow a game down by emptying one again and again.
        for name in things:
            facts &= ~self._table.mentions(name)
        # Sorted, so that a state does not depend on the order of a set.
        for name in sorted(things):
            home = self.homes.get(name)
            if home is not None:
                station = self._station_with_room(name, home, facts)
                facts = self._place(name, station, facts)
                touched |= {name, station}
        facts |= unsoiled
        left = tuple(e for e in timers.entries if things.isdisjoint(e[0].label[2]))
        if len(left) < len(timers.entries):
            timers = timers.table.get(left, timers.busy)
        return self._with_defaults(touched, facts), timers

    def _places_of(self, thing: str, facts: int) -> set[str]:
        """Return all objects that share a fact with a thing."""
        atoms = self._table.atoms
        return {n for i in bits_of(facts & self._table.mentions(thing)) for n in atoms[i][1:]}

    def _unsoiled(self, things: Iterable[str], facts: int) -> int:
        bits = (self._table.mask([(soil, name)]) for soil in self.soils for name in things)
        return sum(bit for bit in bits if facts & bit)

    def _station_with_room(self, name: str, home: str, facts: int) -> str:
        """Return the thing's station, or an empty one like it if something else is there."""
        type_ = self._task.thing(name).type
        for station in self.stations_for(home):
            there = set(self._related(station, facts))
            alike = all(self._task.thing(other).type == type_ for other in there)
            piles_up = station == home and alike and self._top(home, type_, facts) is not None
            if not there or piles_up:
                return station
        return home

    def stations_for(self, home: str) -> tuple[str, ...]:
        """Return the stations to which a thing can return, the best first: its home."""
        kind = self._task.thing(home).kind
        others = [o for o in self.stations if o.kind not in self._leaving]
        others.sort(key=lambda o: (o.kind != kind, o.name not in self._task.floor.plain))
        return (home, *(o.name for o in others))

    def own_facts(self, name: str) -> int:
        """Return the mask of a thing's first facts that positions do not determine."""
        mask = 0
        for bit in bits_of(self._task.initial_facts & self._table.mentions(name)):
            atom = self._table.atoms[bit]
            if len(atom) == 2 and atom[0] not in self.derived and atom[0] not in self.soils:
                mask |= 1 << bit
        return mask

    def _place(self, name: str, station: str, facts: int) -> int:
        """Put a thing on a station, on top of what is there."""
        table = self._table
        facts |= self.own_facts(name)
        type_ = self._task.thing(name).type
        below = self._top(station, type_, facts)
        for predicate in self.rules["shares_tile"]:
            facts |= table.mask([(predicate, name, station)])
        if below is None:
            facts |= table.mask((p, name, station) for p in self.rules["bottom_of_stack"])
        else:
            facts |= table.mask((p, name, below) for p in self.rules["next_in_stack"])
            facts &= ~table.mask((p, below) for p in self.rules["top_of_stack"])
        return facts | table.mask((p, name) for p in self.rules["top_of_stack"])

    def _top(self, station: str, type_: str, facts: int) -> str | None:
        """Return the thing of a type on top of a station's stack."""
        for predicate in self.rules["shares_tile"]:
            if self._types[predicate][0] != type_:
                continue
            for thing in self._table.by_type[type_]:
                here = self._table.mask([(predicate, thing, station)])
                top = self._table.mask((p, thing) for p in self.rules["top_of_stack"])
                if facts & here and facts & top:
                    return thing
        return None

    def _with_defaults(self, names: Iterable[str], facts: int) -> int:
        """Compute the facts again that hold unless others do, such as `station_empty`."""
        table = self._table
        for predicate, unless in self.defaults:
            spoilers = 0
            for other in unless or ():
                if other in table.fluents:
                    spoilers |= table.matching((other, *(None for _ in self._types[other])))
            for name in names:
                bit = table.mask([(predicate, name)])
                spoiled = facts & spoilers & table.mentions(name)
                facts = facts & ~bit if spoiled else facts | bit
        return facts
