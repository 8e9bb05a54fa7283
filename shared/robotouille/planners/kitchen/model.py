"""A world's kitchen in the compact layout, and its states to and fro."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from robotouille.planners.kitchen.compact_state import (
    ABLE,
    AFTER,
    BELOW,
    BOIL_TOTAL,
    BOILED,
    BOILING,
    CLASSES,
    DONE,
    FILL_TOTAL,
    FILLING,
    HAND,
    HELD,
    INSIDE,
    IS_POT,
    ITEMS,
    LOOSE,
    MEAL,
    MEALS,
    OBJECTS,
    PLACE,
    PLAYERS,
    PROCESS_CLASS,
    PROCESSES,
    SHIFT,
    SINK_CLASS,
    SIZE,
    STATION_CLASS,
    STATIONS,
    STOVE_CLASS,
    TABLE,
    TABLES,
    TIMED,
    TIMER,
    TIMER_EFFECT,
    TIMER_KIND,
    TIMER_OBJECT,
    TIMER_SLOT,
    TIMER_STATION,
    TIMER_TOTAL,
    TIMERS,
    TOTAL,
    WORD,
    WORDS,
    laid_out,
)
from robotouille.planners.kitchen.kernels import Ints
from robotouille.planners.kitchen.recognition import KitchenRules, Process, recognise
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["KitchenModel", "model_of"]

MAX_OBJECTS = 32
"""Rows of the scratch space have room for no more."""

LONGEST = 60
"""Longer delays make plans that are longer than the search has room for."""

CODE = 6
"""Bits of an action's object, station or meal."""

MAX_SECOND = 7
"""How many meals and processes an action may be about besides."""

MAX_PLAYERS = 4
"""A joint action of more does not fit into one integer."""

BITS = 62

Rows = dict[tuple[str, int, tuple[str, ...]], tuple[int, ...]]


@dataclass
class KitchenModel:
    """A kitchen's names by number, and the sequence for its kernels.

    `stations` have a purpose; `tables` are the plain stations. `meals` exist; there is room for
    `kitchen[MEALS]`.
    """

    world: World
    rules: KitchenRules
    players: list[str]
    objects: list[str]
    items: int
    stations: list[str]
    tables: list[str]
    meals: list[str]
    kitchen: Ints

    def encode(self, state: State) -> list[int]:
        """The compact state, for no particular choice of objects (row 0)."""
        return _Encoder(self, state).encode()


def model_of(world: World, state: State) -> KitchenModel | None:
    """The kitchen of a world whose domain is one, with the objects of a state; else None."""
    rules = recognise(world.task.domain)
    profile = world.task.profile
    if rules is None or profile.steps_per_tile or profile.repeat_steps != 1 or state.timers.busy:
        return None
    tables = _tables(world)
    by_type = {kind: [o.name for o in state.objects if o.type == kind] for kind in _TYPES}
    items, containers, meals = (by_type[kind] for kind in ("item", "container", "meal"))
    if tables is None or len(items) + len(containers) > MAX_OBJECTS:
        return None
    if len(world.players) > MAX_PLAYERS:
        return None
    if any(world.thing(m).kind != "water" for m in meals):
        return None
    flags = {p.station for p in rules.processes} | {"issink", "isstove"}
    known = flags & world.table.types.keys()
    if any(state.holds(flag, table) for flag in sorted(known) for table in tables):
        return None
    stations = [s for s in by_type["station"] if s not in tables]
    room = max(len(meals) + _wanted_meals(world), len(rules.processes))
    if len(items) + len(containers) + len(stations) >= 1 << CODE or room > MAX_SECOND:
        return None
    if any(
        _is_enabled_too_late(state, process, item) for process in rules.processes for item in items
    ):
        return None
    draft = _Draft(world, state, rules, items, containers, stations)
    kitchen = draft.kitchen(len(tables), len(meals) + _wanted_meals(world))
    if kitchen is None or draft.longest > LONGEST or draft.uneven:
        return None
    players = list(world.players)
    objects = items + containers
    return KitchenModel(
        world, rules, players, objects, len(items), stations, tables, meals, kitchen
    )


def _is_enabled_too_late(state: State, process: Process, item: str) -> bool:
    """Whether a process is done that has not made the next one possible: it takes one more time."""
    if not state.holds(process.result, item):
        return False
    pairs = process.enables
    return any(state.holds(fact, item) and not state.holds(gained, item) for fact, gained in pairs)


_TYPES = ("station", "item", "container", "meal")


def _tables(world: World) -> list[str] | None:
    """The plain stations, which are all alike: those that the goal speaks of, if it does."""
    station_types = set(world.task.domain.station_types)
    wanted: set[tuple[str, ...]] = set()
    for variable in world.goal.variables.values():
        names = world.goal.candidates(variable.id)
        kinds = {world.thing(n).type for n in names}
        if kinds & station_types or variable.kind in station_types:
            wanted.add(tuple(names))
    if len(wanted) > 1:
        return None
    if wanted:
        return list(wanted.pop())
    return [o.name for o in world.all_objects() if o.type in station_types and o.kind == "table"]


def _wanted_meals(world: World) -> int:
    return sum(variable.kind == "water" for variable in world.goal.variables.values())


class _Draft:
    """Collects the numbers and tables of a kitchen."""

    def __init__(
        self,
        world: World,
        state: State,
        rules: KitchenRules,
        items: list[str],
        containers: list[str],
        stations: list[str],
    ) -> None:
        self.world, self.state, self.rules = world, state, rules
        self.items, self.containers, self.stations = items, containers, stations
        self.size = 0
        self.longest = 0
        self.uneven = False
        self.widths: list[int] = []
        self.timers: list[tuple[int, int, int, int, int, int]] = []

    def field(self, most: int) -> int:
        """The position of a new integer of a state that is at most so large."""
        self.size += 1
        self.widths.append(max(1, most.bit_length()))
        return self.size - 1

    def fields(self, count: int, most: int) -> int:
        first = self.size
        for _ in range(count):
            self.field(most)
        return first

    def kitchen(self, tables: int, meals: int) -> Ints | None:
        classes = self._classes()
        if classes is None:
            return None
        flags, station_class = classes
        players, items, n = len(self.world.players), len(self.items), 0
        n = items + len(self.containers)
        table = n + len(self.stations)
        hand, meal = table + 1, table + 1 + players
        self.fields(1, 1 << 12)
        self.fields(1, 1)
        place = self.fields(players, table)
        held = self.fields(players, n)
        below = self.fields(n, meal + meals)
        inside = self.fields(meals, n)
        boiled = self.fields(meals, 1)
        able, after, done, timer, total = self._processes(station_class, flags, n)
        fill, boil, fill_total, boil_total = self._meals(station_class, flags, meals, n, boiled)
        self.longest = max(self.longest, fill_total, boil_total)
        words, word, shift = self._packing()
        rows = list(zip(*self.timers, strict=True)) or [()] * 6
        numbers = {
            PLAYERS: players,
            OBJECTS: n,
            ITEMS: items,
            STATIONS: len(self.stations),
            TABLES: tables,
            MEALS: meals,
            PROCESSES: len(self.rules.processes),
            CLASSES: len(flags),
            SIZE: self.size,
            WORDS: words,
            TIMERS: len(self.timers),
            TABLE: table,
            HAND: hand,
            MEAL: meal,
            PLACE: place,
            HELD: held,
            BELOW: below,
            INSIDE: inside,
            BOILED: boiled,
            SINK_CLASS: flags.index("issink") if "issink" in flags else -2,
            STOVE_CLASS: flags.index("isstove") if "isstove" in flags else -2,
            FILL_TOTAL: fill_total,
            BOIL_TOTAL: boil_total,
        }
        arrays: dict[int, Sequence[int]] = {
            STATION_CLASS: station_class,
            PROCESS_CLASS: [flags.index(p.station) for p in self.rules.processes],
            TIMED: [int(p.timed) for p in self.rules.processes],
            TOTAL: total,
            ABLE: able,
            AFTER: after,
            DONE: done,
            TIMER: timer,
            FILLING: fill,
            BOILING: boil,
            IS_POT: self._pots(),
            TIMER_SLOT: rows[0],
            TIMER_KIND: rows[1],
            TIMER_OBJECT: rows[2],
            TIMER_STATION: rows[3],
            TIMER_TOTAL: rows[4],
            TIMER_EFFECT: rows[5],
            WORD: word,
            SHIFT: shift,
        }
        return laid_out(numbers, arrays)

    def _classes(self) -> tuple[list[str], list[int]] | None:
        """The facts that give a station its purpose, and which of them each station has."""
        flags = [p.station for p in self.rules.processes]
        for action, flag in (("fill", "issink"), ("boil", "isstove")):
            if action in self.rules.actions and flag not in flags:
                flags.append(flag)
        found = []
        for station in self.stations:
            has = [i for i, flag in enumerate(flags) if self._holds(flag, station)]
            if len(has) > 1:
                return None
            found.append(has[0] if has else -1)
        return flags, found

    def _holds(self, predicate: str, *names: str) -> bool:
        types = self.world.table.types
        return predicate in types and self.state.holds(predicate, *names)

    def _pots(self) -> list[int]:
        kinds = {c: 1 if self._holds("ispot", c) else 0 for c in self.containers}
        bowls = {c: 2 for c in self.containers if self._holds("isbowl", c)}
        return [0] * len(self.items) + [{**kinds, **bowls}[c] for c in self.containers]

    def _processes(
        self, station_class: list[int], flags: list[str], n: int
    ) -> tuple[list[int], list[int], list[int], list[int], list[int]]:
        able, after, done, timer, total = [], [], [], [], []
        for process in self.rules.processes:
            for o, item in enumerate(self.items):
                first = self._enabled_by(process, item)
                places = [
                    i for i, c in enumerate(station_class) if c == flags.index(process.station)
                ]
                possible = first is not None and bool(places)
                count = self._total(process, item, places) if possible else 0
                able.append(int(possible))
                after.append(first or 0)
                total.append(count)
                self.longest = max(self.longest, count)
                if possible or self._holds(process.result, item):
                    done.append(self.field(1 if process.timed else max(count, 1)))
                else:
                    done.append(-1)
                for i in range(len(self.stations)):
                    if possible and process.timed and i in places:
                        timer.append(self.field(count + 1))
                        row = (timer[-1], 0, o, n + i, count, done[-1])
                        self.timers.append(row)
                    else:
                        timer.append(-1)
        return able, after, done, timer, total

    def _enabled_by(self, process: Process, item: str) -> int | None:
        """0 if the process can be performed on an item; else the number of the process (from 1)
        that makes it possible; None if nothing does."""
        if self._holds(process.requires, item):
            return 0
        for number, other in enumerate(self.rules.processes, start=1):
            for condition, gained in other.enables:
                if gained == process.requires and self._holds(condition, item):
                    return number
        return None

    def _total(self, process: Process, item: str, places: list[int]) -> int:
        station = self.stations[places[0]]
        return _count(self.world, process.action, i1=item, s1=station)

    def _meals(
        self, station_class: list[int], flags: list[str], meals: int, n: int, boiled: int
    ) -> tuple[list[int], list[int], int, int]:
        fill, boil = [], []
        fill_total = boil_total = 0
        items = len(self.items)
        for c, container in enumerate(self.containers):
            for i, station in enumerate(self.stations):
                fill.append(-1)
                if not meals or not self._holds("ispot", container):
                    continue
                if station_class[i] >= 0 and flags[station_class[i]] == "issink":
                    name = self.rules.actions["fill"]
                    total = _count(self.world, name, c1=container, s1=station)
                    self.uneven |= fill_total not in (0, total)
                    fill_total = total
                    fill[-1] = self.field(fill_total + 1)
                    row = (fill[-1], 1, items + c, n + i, fill_total, items + c)
                    self.timers.append(row)
        for m in range(meals):
            for c, container in enumerate(self.containers):
                for i, station in enumerate(self.stations):
                    boil.append(-1)
                    if not self._holds("ispot", container):
                        continue
                    if station_class[i] >= 0 and flags[station_class[i]] == "isstove":
                        total = self._boil_total(container, station)
                        self.uneven |= boil_total not in (0, total)
                        boil_total = total
                        boil[-1] = self.field(boil_total + 1)
                        row = (boil[-1], 2, items + c, n + i, boil_total, boiled + m)
                        self.timers.append(row)
        return fill, boil, fill_total, boil_total

    def _boil_total(self, container: str, station: str) -> int:
        name = self.rules.actions["boil"]
        water = next((o.name for o in self.world.all_objects() if o.kind == "water"), "water1")
        self.world.admit([water])
        return _count(self.world, name, c1=container, s1=station, m1=water)

    def _packing(self) -> tuple[int, list[int], list[int]]:
        word, shift = [], []
        number = used = 0
        for width in self.widths:
            if used + width > BITS:
                number, used = number + 1, 0
            word.append(number)
            shift.append(used)
            used += width
        return number + 1, word, shift


def _count(world: World, action: str, **binding: str) -> int:
    """Updates after which a process takes effect."""
    ground = bound_action(world, action, {"p1": world.players[0], **binding})
    return next(node.total for effect in ground.effects for node in effect.counters())


def bound_action(world: World, name: str, binding: dict[str, str]) -> GroundAction:
    """The ground action with its parameters bound to objects."""
    schema = next(s for s in world.schemas if s.name == name)
    return world.action(name, *(binding[parameter] for parameter, _ in schema.parameters))


class _Encoder:
    def __init__(self, model: KitchenModel, state: State) -> None:
        self.model, self.k = model, model.kitchen
        self.codes = {name: i for i, name in enumerate(model.objects)}
        self.codes |= {name: self.k[OBJECTS] + i for i, name in enumerate(model.stations)}
        self.codes |= dict.fromkeys(model.tables, self.k[TABLE])
        self.numbers = {name: i for i, name in enumerate(model.meals)}
        self.s = [0] * self.k[SIZE]
        self.atoms = state.atoms()
        self.rows: Rows = {(a, i, args): c for a, i, args, c in state.timer_rows()}

    def encode(self) -> list[int]:
        k, s = self.k, self.s
        lowest: dict[str, int] = {}
        for atom in self.atoms:
            match atom:
                case ("item_on" | "container_at" | "atop", name, under):
                    s[k[BELOW] + self.codes[name]] = self.codes[under]
                    if atom[0] != "atop" and under in self.model.tables:
                        lowest[under] = self.codes[name]
                case ("has_item" | "has_container", player, name):
                    p = self.model.players.index(player)
                    s[k[BELOW] + self.codes[name]] = k[HAND] + p
                    s[k[HELD] + p] = self.codes[name] + 1
                case ("addedto", name, meal):
                    s[k[BELOW] + self.codes[name]] = k[MEAL] + self.numbers[meal]
                case ("in", meal, name):
                    s[k[INSIDE] + self.numbers[meal]] = self.codes[name] + 1
                case ("isboiling", meal):
                    s[k[BOILED] + self.numbers[meal]] = 1
        for atom in self.atoms:
            if atom[0] == "loc":
                p = self.model.players.index(atom[1])
                s[k[PLACE] + p] = lowest.get(atom[2], self.codes[atom[2]])
        if k[PLAYERS] == 1 and s[k[HELD]]:
            s[LOOSE] = 1
        self._counters(set(self.atoms))
        return s

    def _counters(self, atoms: Iterable[tuple[str, ...]]) -> None:
        k, s, model = self.k, self.s, self.model
        for q, process in enumerate(model.rules.processes):
            for o, item in enumerate(model.objects[: k[ITEMS]]):
                at = q * k[ITEMS] + o
                if k[k[DONE] + at] < 0:
                    continue
                if (process.result, item) in atoms:
                    s[k[k[DONE] + at]] = 1 if process.timed else k[k[TOTAL] + at]
                elif not process.timed:
                    s[k[k[DONE] + at]] = self.rows.get((process.action, 0, (item,)), (0,))[0]
                else:
                    self._timers(process.action, (item,), TIMER, at)
        names = model.rules.actions
        for c, container in enumerate(model.objects[k[ITEMS] :]):
            if k[MEALS]:
                self._timers(names.get("fill", ""), (container,), FILLING, c)
            for meal, m in self.numbers.items():
                if not s[k[BOILED] + m]:
                    row = m * (k[OBJECTS] - k[ITEMS]) + c
                    self._timers(names.get("boil", ""), (meal, container), BOILING, row)

    def _timers(self, action: str, about: tuple[str, ...], table: int, row: int) -> None:
        for i, station in enumerate(self.model.stations):
            slot = self.k[self.k[table] + row * self.k[STATIONS] + i]
            if slot < 0:
                continue
            for (name, _, arguments), counters in self.rows.items():
                if name == action and set(arguments) == {*about, station}:
                    self.s[slot] = counters[1] + 1
