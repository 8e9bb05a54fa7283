"""From a state of the world to a compact one."""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import NONE, CompactState, empty_state
from robotouille.planners.kitchen.kernels import Ints
from robotouille.planners.kitchen.model import KitchenModel
from robotouille.world.world import State

__all__ = ["encode"]

TimerRows = dict[tuple[str, int, tuple[str, ...]], tuple[int, ...]]


def encode(model: KitchenModel, state: State) -> CompactState:
    """The compact state, for the first of the goal assignments."""
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
        """The lowest object on a plain table."""

    def objects(self) -> None:
        """What objects and meals are on and in, and what players hold."""
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
        """Where players are; follows `objects`."""
        compact = self.compact
        for atom in self.atoms:
            if atom[0] == "loc":
                p = self.model.players.index(atom[1])
                compact.place[p] = self.lowest.get(atom[2], self.codes[atom[2]])
        if self.kitchen.players == 1 and compact.held[0]:
            compact.may_have_walked = 1

    def counters(self) -> None:
        """How far work and delays have got; follows `objects`."""
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
        """Note how far an action's delay has got at each station, whose counters are given."""
        for station, counter in zip(self.model.stations, counters, strict=True):
            if counter == NONE:
                continue
            for (name, _, arguments), progress in self.timers.items():
                if name == action and set(arguments) == {*about, station}:
                    self.compact.counters[counter] = progress[1] + 1
