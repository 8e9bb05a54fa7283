"""A world's kitchen for the kernels: numbers for its names, and its constant tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

from robotouille.planning.kitchen.compact_state import (
    BOILING,
    BOWL,
    FILLING,
    MAX_MEALS,
    MAX_NUMBERED,
    MAX_OBJECTS,
    MAX_PLAYERS,
    MAX_PROCESSES,
    NONE,
    POT,
    PROCESSING,
    Kitchen,
)
from robotouille.planning.kitchen.kernels import Cube, Table, record
from robotouille.planning.kitchen.recognition import (
    KitchenRules,
    Process,
    recognise,
)
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

# Longer delays lead to plans that exceed the search's stacks (`nodes.MAX_F`).
MAX_DELAY = 60

# Words stay non-negative in signed 64-bit integers, so that shifts do not copy the sign bit.
WORD_BITS = 62

# Greater than `goal_assignments.MAX_ASSIGNMENTS`.
MAX_ASSIGNMENT = 1 << 12

NO_CLASS = -2
"""A class that no station has."""


@dataclass
class KitchenModel:
    """The names of a kitchen by number.

    `stations` have a purpose; `tables` are the plain stations. `meals` are the existing meals;
    `kitchen.meals` also counts those still to be made. `record` is `kitchen` for kernels.
    """

    world: World
    rules: KitchenRules
    players: list[str]
    objects: list[str]
    stations: list[str]
    tables: list[str]
    meals: list[str]
    kitchen: Kitchen
    record: Kitchen


_rules: WeakKeyDictionary[World, KitchenRules | None] = WeakKeyDictionary()


def rules_of(world: World) -> KitchenRules | None:
    """Return the rules of a world that is a kitchen, else None. Results are cached."""
    if world not in _rules:
        _rules[world] = recognise(world.task.domain) if world.is_undivided else None
    return _rules[world]


def model_of(world: World, state: State) -> KitchenModel | None:
    """Return the kitchen of a world with the objects of a state, or None if it is not supported."""
    rules = rules_of(world)
    profile = world.task.profile
    # Walks must take one step, as in the timing profile `benchmark`: compact states have no tiles.
    if rules is None or profile.steps_per_tile or profile.repeat_steps != 1 or state.timers.busy:
        return None
    tables = _tables(world)
    by_type = {kind: [o.name for o in state.objects if o.type == kind] for kind in _TYPES}
    items, containers, meals = (by_type[kind] for kind in ("item", "container", "meal"))
    if tables is None or any(world.thing(m).kind != "water" for m in meals):
        return None
    flags = {p.station for p in rules.processes} | {"issink", "isstove"}
    known = flags & world.table.types.keys()
    # Plain tables are interchangeable only if none of them has a purpose.
    if any(state.holds(flag, table) for flag in sorted(known) for table in tables):
        return None
    stations = [s for s in by_type["station"] if s not in tables]
    room_for_meals = len(meals) + _wanted_meals(world)
    if (
        len(world.players) > MAX_PLAYERS
        or len(items) + len(containers) > MAX_OBJECTS
        or len(items) + len(containers) + len(stations) > MAX_NUMBERED
        or room_for_meals > MAX_MEALS
        or len(rules.processes) > MAX_PROCESSES
    ):
        return None
    pairs = [(process, item) for process in rules.processes for item in items]
    if any(_is_enabled_too_late(state, *p) or _is_blocked(state, *p) for p in pairs):
        return None
    draft = _Draft(world, state, rules, items, containers, stations)
    if draft.has_pot_as_bowl:
        return None
    kitchen = draft.kitchen(len(tables), room_for_meals)
    if kitchen is None or draft.longest_delay > MAX_DELAY or draft.uneven:
        return None
    players, objects = list(world.players), items + containers
    return KitchenModel(
        world, rules, players, objects, stations, tables, meals, kitchen, record(kitchen)
    )


def _is_enabled_too_late(state: State, process: Process, item: str) -> bool:
    """Return whether a process is done whose enabling effect has not happened yet.

    A compact state cannot express that the effect follows later.
    """
    if not state.holds(process.result, item):
        return False
    pairs = process.enables
    return any(state.holds(fact, item) and not state.holds(gained, item) for fact, gained in pairs)


def _is_blocked(state: State, process: Process, item: str) -> bool:
    """Return whether a fact forbids a process on an item although its delay has not begun."""
    if state.holds(process.result, item) or not any(
        state.holds(f, item) for f in process.forbidden
    ):
        return False
    return not any(name == process.action and item in who for name, _, who, _ in state.timer_rows())


_TYPES = ("station", "item", "container", "meal")


def _tables(world: World) -> list[str] | None:
    """Return the plain stations. If the goal names stations, they are the plain ones.

    Return None if the goal distinguishes several groups of stations.
    """
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
    """Builder of a kitchen's numbers and tables."""

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
        self.objects = items + containers
        self.longest_delay = 0
        self.uneven = False
        """True if pots fill or boil at different speeds."""
        self.flags: list[str] = []
        """The fact that gives the stations of each class their purpose."""
        self.station_class: list[int] = []
        self.counter_widths: list[int] = []
        self.timers: list[tuple[int, int, int, int, int, int]] = []

    def kitchen(self, tables: int, meals: int) -> Kitchen | None:
        """Return the kitchen with `tables` plain tables and room for `meals` meals.

        Return None if a station has two purposes.
        """
        if not self._classify_stations():
            return None
        players, objects = len(self.world.players), len(self.objects)
        table_code = objects + len(self.stations)
        hand_code, meal_code = table_code + 1, table_code + 1 + players
        possible, prerequisite, total, progress, process_timer = self._processes()
        fill_timer, fill_total = self._filling(meals)
        boil_timer, boil_total = self._boiling(meals)
        self.longest_delay = max(self.longest_delay, fill_total, boil_total)
        widths = [_bits(MAX_ASSIGNMENT), _bits(1)]
        widths += [_bits(table_code)] * players + [_bits(objects)] * players
        widths += [_bits(meal_code + meals)] * objects
        widths += [_bits(objects)] * meals + [_bits(1)] * meals + self.counter_widths
        words, shifts = _packed(widths)
        timers = [list(column) for column in zip(*self.timers, strict=True)] or [[]] * 6
        return Kitchen(
            players=players,
            objects=objects,
            items=len(self.items),
            stations=len(self.stations),
            tables=tables,
            meals=meals,
            processes=len(self.rules.processes),
            classes=len(self.flags),
            timers=len(self.timers),
            counters=len(self.counter_widths),
            words=words[-1] + 1,
            table_code=table_code,
            hand_code=hand_code,
            meal_code=meal_code,
            sink_class=self._class_of("issink"),
            stove_class=self._class_of("isstove"),
            fill_total=fill_total,
            boil_total=boil_total,
            station_class=self.station_class,
            process_class=[self.flags.index(p.station) for p in self.rules.processes],
            timed=[int(p.timed) for p in self.rules.processes],
            possible=possible,
            prerequisite=prerequisite,
            total=total,
            progress=progress,
            process_timer=process_timer,
            fill_timer=fill_timer,
            boil_timer=boil_timer,
            container_kind=self._container_kinds(),
            timer_counter=timers[0],
            timer_kind=timers[1],
            timer_object=timers[2],
            timer_station=timers[3],
            timer_total=timers[4],
            timer_effect=timers[5],
            key_word=words,
            key_shift=shifts,
            key_mask=[(1 << width) - 1 for width in widths],
        )

    def _counter(self, most: int) -> int:
        """Add a counter with values up to `most` and return its number."""
        self.counter_widths.append(_bits(most))
        return len(self.counter_widths) - 1

    def _timer(self, kind: int, o: int, station: int, total: int, effect: int) -> int:
        """Add a timer and return its counter."""
        # The counter exceeds the total by one before the timer takes effect.
        counter = self._counter(total + 1)
        self.timers.append((counter, kind, o, len(self.objects) + station, total, effect))
        return counter

    def _classify_stations(self) -> bool:
        """Determine the class of each station. Return False if a station has several."""
        self.flags = [p.station for p in self.rules.processes]
        for action, flag in (("fill", "issink"), ("boil", "isstove")):
            if action in self.rules.actions and flag not in self.flags:
                self.flags.append(flag)
        for station in self.stations:
            has = [i for i, flag in enumerate(self.flags) if self._holds(flag, station)]
            if len(has) > 1:
                return False
            self.station_class.append(has[0] if has else NONE)
        return True

    def _class_of(self, flag: str) -> int:
        return self.flags.index(flag) if flag in self.flags else NO_CLASS

    def _holds(self, predicate: str, *names: str) -> bool:
        types = self.world.table.types
        return predicate in types and self.state.holds(predicate, *names)

    @property
    def has_pot_as_bowl(self) -> bool:
        """True if meals could be poured into a pot."""
        return any(self._holds("ispot", c) and self._holds("isbowl", c) for c in self.containers)

    def _container_kinds(self) -> list[int]:
        kinds = []
        for name in self.containers:
            kind = POT if self._holds("ispot", name) else 0
            kinds.append(BOWL if self._holds("isbowl", name) else kind)
        return [0] * len(self.items) + kinds

    def _processes(self) -> tuple[Table, Table, Table, Table, Cube]:
        """Return five tables by process and item.

        They contain whether the process is possible, its prerequisite, its duration, the counter
        that marks it as done, and its timers by station.
        """
        count = len(self.rules.processes)
        possible: list[list[int]] = [[] for _ in range(count)]
        before: list[list[int]] = [[] for _ in range(count)]
        totals: list[list[int]] = [[] for _ in range(count)]
        progress: list[list[int]] = [[] for _ in range(count)]
        timers: list[list[list[int]]] = [[] for _ in range(count)]
        for q, process in enumerate(self.rules.processes):
            only = self.flags.index(process.station)
            places = [i for i, c in enumerate(self.station_class) if c == only]
            for o, item in enumerate(self.items):
                first = self._enabled_by(process, item)
                ever = first is not None and bool(places)
                total = self._total(process, item, places) if ever else 0
                possible[q].append(int(ever))
                before[q].append(NONE if first is None else first)
                totals[q].append(total)
                self.longest_delay = max(self.longest_delay, total)
                flag = NONE
                if ever or self._holds(process.result, item):
                    flag = self._counter(1 if process.timed else max(total, 1))
                progress[q].append(flag)
                row = [NONE] * len(self.stations)
                for station in places if ever and process.timed else ():
                    row[station] = self._timer(PROCESSING, o, station, total, flag)
                timers[q].append(row)
        return possible, before, totals, progress, timers

    def _enabled_by(self, process: Process, item: str) -> int | None:
        """Return the number of the process that enables a process on an item.

        Return NONE if the process needs no other one, and None if nothing enables it.
        """
        # A problem file may declare an item fried although nobody cut it.
        if self._holds(process.requires, item) or self._holds(process.result, item):
            return NONE
        for number, other in enumerate(self.rules.processes):
            for condition, gained in other.enables:
                if gained == process.requires and self._holds(condition, item):
                    return number
        return None

    def _total(self, process: Process, item: str, places: list[int]) -> int:
        station = self.stations[places[0]]
        return _count(self.world, process.action, i1=item, s1=station)

    def _places(self, container: str, flag: str) -> list[int]:
        """Return the stations with a fact if the container is a pot, else none."""
        if not self._holds("ispot", container):
            return []
        only = self._class_of(flag)
        return [i for i, c in enumerate(self.station_class) if c == only]

    def _filling(self, meals: int) -> tuple[Table, int]:
        """Return each object's counters by station for filling, and the delay."""
        rows, total = [[NONE] * len(self.stations) for _ in self.objects], 0
        for c, container in enumerate(self.containers, len(self.items)):
            for station in self._places(container, "issink") if meals else ():
                names = {"c1": container, "s1": self.stations[station]}
                count = _count(self.world, self.rules.actions["fill"], **names)
                self.uneven |= total not in (0, count)
                total = count
                rows[c][station] = self._timer(FILLING, c, station, total, c)
        return rows, total

    def _boiling(self, meals: int) -> tuple[Cube, int]:
        """Return each meal's and object's counters by station for boiling, and the delay."""
        rows = [[[NONE] * len(self.stations) for _ in self.objects] for _ in range(meals)]
        total = 0
        for m in range(meals):
            for c, container in enumerate(self.containers, len(self.items)):
                for station in self._places(container, "isstove"):
                    count = self._boil_total(container, self.stations[station])
                    self.uneven |= total not in (0, count)
                    total = count
                    rows[m][c][station] = self._timer(BOILING, c, station, total, m)
        return rows, total

    def _boil_total(self, container: str, station: str) -> int:
        name = self.rules.actions["boil"]
        water = next((o.name for o in self.world.all_objects() if o.kind == "water"), "water1")
        self.world.admit([water])
        return _count(self.world, name, c1=container, s1=station, m1=water)


def _bits(most: int) -> int:
    """Return the number of bits for integers up to `most`."""
    return max(1, most.bit_length())


def _packed(widths: Iterable[int]) -> tuple[list[int], list[int]]:
    """Return the word and the position in it for integers of these widths."""
    words, shifts = [], []
    word = used = 0
    for width in widths:
        if used + width > WORD_BITS:
            word, used = word + 1, 0
        words.append(word)
        shifts.append(used)
        used += width
    return words, shifts


def _count(world: World, action: str, **binding: str) -> int:
    """Return the number of updates after which a process takes effect."""
    ground = bound_action(world, action, {"p1": world.players[0], **binding})
    return next(node.total for effect in ground.effects for node in effect.counters())


def bound_action(world: World, name: str, binding: dict[str, str]) -> GroundAction:
    """Return the ground action with its parameters bound to objects."""
    schema = next(s for s in world.schemas if s.name == name)
    return world.action(name, *(binding[parameter] for parameter, _ in schema.parameters))
