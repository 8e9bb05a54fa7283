"""Translation of the world's states into compact states, and of paths back into plans.

A path does not say which table or which name of a meal it means; the decoder chooses.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from robotouille.planning.kitchen.compact_state import (
    ADD,
    BOIL,
    FILL,
    MOVE,
    NONE,
    PICK,
    POUR,
    PROCESS,
    PUT,
    WAIT,
    CompactState,
    Kitchen,
    copy_state,
    decode_action,
    empty_state,
)
from robotouille.planning.kitchen.kernels import Ints, blank_records, ints, kernel, plain, records
from robotouille.planning.kitchen.model import KitchenModel, bound_action
from robotouille.planning.kitchen.transitions import (
    advance_timers,
    apply_action,
    place_of_action,
    sort_players,
)
from robotouille.planning.plan import Joint, Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

TimerRows = dict[tuple[str, int, tuple[str, ...]], tuple[int, ...]]


def encode(model: KitchenModel, state: State) -> CompactState:
    """Return the compact state with the first goal assignment."""
    encoder = _Encoder(model, state)
    encoder.objects()
    encoder.players()
    encoder.counters()
    return encoder.compact


class _Encoder:
    def __init__(self, model: KitchenModel, state: State) -> None:
        self.model, self.kitchen = model, model.kitchen
        self.codes = {name: i for i, name in enumerate(model.objects)}
        self.codes |= {name: self.kitchen.objects + i for i, name in enumerate(model.stations)}
        self.codes |= dict.fromkeys(model.tables, self.kitchen.table_code)
        self.meals = {name: m for m, name in enumerate(model.meals)}
        self.compact = empty_state(self.kitchen)
        self.atoms = state.atoms()
        self.timers: TimerRows = {(a, i, args): c for a, i, args, c in state.timer_rows()}
        self.lowest: dict[str, int] = {}
        """The lowest object on each plain table."""

    def objects(self) -> None:
        """Store what each object and meal is on or in, and what players hold."""
        kitchen, compact, codes = self.kitchen, self.compact, self.codes
        for atom in self.atoms:
            match atom:
                case ("item_on" | "container_at" | "atop", name, under):
                    compact.below[codes[name]] = codes[under]
                    if atom[0] != "atop" and under in self.model.tables:
                        self.lowest[under] = codes[name]
                case ("has_item" | "has_container", player, name):
                    p = self.model.players.index(player)
                    compact.below[codes[name]] = kitchen.hand_code + p
                    compact.held[p] = codes[name] + 1
                case ("addedto", name, meal):
                    compact.below[codes[name]] = kitchen.meal_code + self.meals[meal]
                case ("in", meal, name):
                    compact.inside[self.meals[meal]] = codes[name] + 1
                case ("isboiling", meal):
                    compact.boiled[self.meals[meal]] = 1

    def players(self) -> None:
        """Store the players' places. Call after `objects`."""
        compact = self.compact
        for atom in self.atoms:
            if atom[0] == "loc":
                p = self.model.players.index(atom[1])
                compact.place[p] = self.lowest.get(atom[2], self.codes[atom[2]])
        # A plan may start with putting the object down, since its pick-up is not part of the plan.
        if self.kitchen.players == 1 and compact.held[0]:
            compact.may_have_walked = 1

    def counters(self) -> None:
        """Store the progress of work and delays. Call after `objects`."""
        kitchen, compact, model = self.kitchen, self.compact, self.model
        atoms = set(self.atoms)
        for q, process in enumerate(model.rules.processes):
            for o, item in enumerate(model.objects[: kitchen.items]):
                counter = kitchen.progress[q][o]
                if counter == NONE:
                    continue
                if (process.result, item) in atoms:
                    compact.counters[counter] = 1 if process.timed else kitchen.total[q][o]
                elif not process.timed:
                    progress = self.timers.get((process.action, 0, (item,)), (0,))
                    compact.counters[counter] = progress[0]
                else:
                    self._running(process.action, (item,), kitchen.process_timer[q][o])
        names = model.rules.actions
        for c, container in enumerate(model.objects[kitchen.items :], kitchen.items):
            if kitchen.meals:
                self._running(names.get("fill", ""), (container,), kitchen.fill_timer[c])
            for meal, m in self.meals.items():
                if not compact.boiled[m]:
                    about = (meal, container)
                    self._running(names.get("boil", ""), about, kitchen.boil_timer[m][c])

    def _running(self, action: str, about: tuple[str, ...], counters: Ints) -> None:
        """Store the progress of an action's delay at each station."""
        for station, counter in zip(self.model.stations, counters, strict=True):
            if counter == NONE:
                continue
            for (name, _, arguments), progress in self.timers.items():
                if name == action and set(arguments) == {*about, station}:
                    self.compact.counters[counter] = progress[1] + 1


@dataclass(slots=True)
class PathAction:
    """One action of a path, with the properties of the state in which it is taken."""

    step: int
    player: int
    action: int
    person: int = 0  # the player's number in the world
    place: int = 0  # the place of the action
    walks: int = 0  # 1: a single player walks to the place first
    held: int = 0  # the held object, or -1
    under: int = 0  # code of what the picked-up object was on
    pot: int = 0  # the pot of the meal that is boiled or added to


def decode(
    model: KitchenModel,
    start: State,
    compact: CompactState,
    path: Sequence[Sequence[tuple[int, int]]],
) -> Plan:
    """Return the plan of a path of joint actions.

    A single player who is not at the place of an action walks there first.

    Args:
        compact: `start` as a record.
        path: Lists of players and their actions, in the order in which they apply.
    """
    # One kernel traces the whole path, which avoids a call into compiled code for each action.
    acts = [PathAction(step, p, action) for step, joint in enumerate(path) for p, action in joint]
    order = ints(range(len(model.players)))
    traced = records(PathAction, acts)
    work = blank_records(partial(empty_state, model.kitchen), 2)
    trace(model.record, compact, work, order, len(path), traced)
    decoder = _Decoder(model, start)
    joints: list[list[PathAction]] = [[] for _ in path]
    for act in plain(PathAction, traced):
        joints[act.step].append(act)
    for joint in joints:
        decoder.step(joint)
    return Plan(tuple(decoder.steps))


@kernel
def trace(
    kitchen: Kitchen,
    start: CompactState,
    work: Sequence[CompactState],
    order: Ints,
    steps: int,
    acts: Sequence[PathAction],
) -> None:
    """Store with each action the properties of its state. `work` is room for two states."""
    state, later = work[0], work[1]
    copy_state(kitchen, start, state)
    number = 0
    for step in range(steps):
        while number < len(acts) and acts[number].step == step:
            act = acts[number]
            kind, x, _ = decode_action(act.action)
            if kind != WAIT:
                if kitchen.players == 1:
                    walk_first(kitchen, state, later, act)
                act.person = order[act.player]
                act.place = place_of_action(kitchen, state, act.action)
                act.held = state.held[act.player] - 1
                if kind == PICK:
                    act.under = state.below[x]
                if kind in (BOIL, ADD):
                    act.pot = state.inside[x] - 1
                apply_action(kitchen, state, act.player, act.action)
            number += 1
        advance_timers(kitchen, state)
        sort_players(kitchen, state, order)


@kernel
def walk_first(kitchen: Kitchen, state: CompactState, later: CompactState, act: PathAction) -> None:
    """Let the only player walk to the place of an action. `later` is work space."""
    copy_state(kitchen, state, later)
    advance_timers(kitchen, later)
    place = place_of_action(kitchen, later, act.action)
    if state.place[0] != place:
        copy_state(kitchen, later, state)
        state.place[0] = place
        act.walks = 1


class _Decoder:
    """Builder of a plan that follows the world's states to find names."""

    def __init__(self, model: KitchenModel, state: State) -> None:
        self.model, self.kitchen = model, model.kitchen
        self.state = state
        self.steps: list[Joint] = []
        self.meals = dict(enumerate(model.meals))

    def step(self, joint: Iterable[PathAction]) -> None:
        now = self.state
        taken = []
        for act in joint:
            kind, x, y = decode_action(act.action)
            if kind == WAIT:
                continue
            if act.walks:
                self._take([self._walk(act.person, act.place, now)])
                now = self.state
            ground = self._action(act, kind, x, y, now)
            taken.append(ground)
            # Players act one after another within a step, so names depend on the facts in between.
            facts = (now.facts | ground.touched) ^ ground.removed
            now = State(now.world, facts, now.timers)
        self._take(taken)

    def _take(self, taken: list[GroundAction]) -> None:
        self.steps.append(tuple(taken))
        self.state = self.state.step(taken).state

    def _here(self, person: int, state: State) -> str:
        player = self.model.players[person]
        names = self.model.stations + self.model.tables
        return next(s for s in names if state.holds("loc", player, s))

    def _name_of(self, place: int, state: State) -> str:
        """Return the station of a place; for an empty table, the first one without a player."""
        kitchen, model = self.kitchen, self.model
        if kitchen.objects <= place < kitchen.table_code:
            return model.stations[place - kitchen.objects]
        if place == kitchen.table_code:
            return next(
                t
                for t in model.tables
                if state.holds("station_empty", t) and state.holds("vacant", t)
            )
        name = model.objects[place]
        predicate = "item_on" if place < kitchen.items else "container_at"
        return next(t for t in model.tables if state.holds(predicate, name, t))

    def _walk(self, person: int, place: int, state: State) -> GroundAction:
        binding = {
            "p1": self.model.players[person],
            "s1": self._here(person, state),
            "s2": self._name_of(place, state),
        }
        return bound_action(self.model.world, self.model.rules.actions["move"], binding)

    def _action(self, act: PathAction, kind: int, x: int, y: int, state: State) -> GroundAction:
        if kind == MOVE:
            return self._walk(act.person, x, state)
        model, items, objects = self.model, self.kitchen.items, self.kitchen.objects
        names = model.rules.actions
        binding = {"p1": model.players[act.person], "s1": self._here(act.person, state)}
        if kind == PICK and x >= items:
            return self._bound(names["pick container"], binding, c1=x)
        if kind == PICK and act.under < objects:
            return self._bound(names["unstack"], binding, i1=x, i2=act.under)
        if kind == PICK:
            return self._bound(names["pick item"], binding, i1=x)
        if kind == PUT and x < objects:
            return self._bound(names["stack"], binding, i1=act.held, i2=x)
        if kind == PUT and act.held >= items:
            return self._bound(names["place container"], binding, c1=act.held)
        if kind == PUT:
            return self._bound(names["place item"], binding, i1=act.held)
        if kind == PROCESS:
            return self._bound(model.rules.processes[y].action, binding, i1=x)
        if kind == FILL:
            return self._bound(names["fill"], binding, c1=x)
        if kind == POUR:
            binding["m1"] = self._meal(y, act.held, state)
            return self._bound(names["pour"], binding, c1=x, c2=act.held)
        binding["m1"] = self._meal(x, act.pot, state)
        if kind == BOIL:
            return self._bound(names["boil"], binding, c1=act.pot)
        if kind != ADD:
            raise AssertionError(f"an action of unknown kind {kind}")
        return self._bound(names["add"], binding, i1=act.held, c1=act.pot)

    def _meal(self, m: int, pot: int, state: State) -> str:
        """Return the name of a meal in a pot."""
        if m not in self.meals:
            # A pot may get a second meal. Before their first action, its new meals are equal.
            named = self.meals.values()
            found = (o.name for o in state.objects if o.type == "meal" and o.name not in named)
            container = self.model.objects[pot]
            self.meals[m] = next(name for name in found if state.holds("in", name, container))
        return self.meals[m]

    def _bound(self, action: str, binding: dict[str, str], **objects: int) -> GroundAction:
        names = {key: self.model.objects[o] for key, o in objects.items()}
        return bound_action(self.model.world, action, {**binding, **names})
