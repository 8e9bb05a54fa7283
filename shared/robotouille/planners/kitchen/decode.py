"""From a compact plan to a plan of the world: which table, which meal, under which name."""

from __future__ import annotations

from collections.abc import Sequence

from robotouille.planners.kitchen.compact_state import (
    ADD,
    BELOW,
    BOIL,
    FILL,
    HELD,
    INSIDE,
    ITEMS,
    MOVE,
    OBJECTS,
    PICK,
    PLACE,
    PLAYERS,
    POUR,
    PROCESS,
    PUT,
    TABLE,
    WAIT,
)
from robotouille.planners.kitchen.kernels import Ints, ints
from robotouille.planners.kitchen.model import KitchenModel, bound_action
from robotouille.planners.kitchen.transitions import act, in_order, spot, tick
from robotouille.planning.plan import Joint, Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.state import State

__all__ = ["decode"]


def decode(
    model: KitchenModel, start: State, code: list[int], path: Sequence[Sequence[int]]
) -> Plan:
    """The plan of a path of joint actions from a compact state.

    Each is a list of actions in the order in which they apply, with the player's number times
    2²⁰ added. A player who is alone, and not where an action is done, walks there first.
    """
    decoder = _Decoder(model, start, ints(code))
    for joint in path:
        if model.kitchen[PLAYERS] == 1:
            decoder.alone(joint[0])
        else:
            decoder.together(joint)
    return Plan(tuple(decoder.steps))


class _Decoder:
    def __init__(self, model: KitchenModel, state: State, s: Ints) -> None:
        self.model, self.k = model, model.kitchen
        self.state, self.s = state, s
        self.steps: list[Joint] = []
        self.who = ints(range(len(model.players)))

    def alone(self, action: int) -> None:
        if action % 16 != WAIT:
            later = ints(self.s)
            tick(self.k, later)
            there = spot(self.k, later, action)
            if self.s[self.k[PLACE]] != there:
                self._step([self._walk(0, there, self.state)])
                self.s = later
                self.s[self.k[PLACE]] = there
        self.together([action] if action % 16 != WAIT else [])

    def together(self, joint: Sequence[int]) -> None:
        now = self.state
        taken = []
        for coded in joint:
            p, action = coded >> 20, coded & 0xFFFFF
            ground = self._action(p, action, now)
            act(self.k, self.s, p, action)
            taken.append(ground)
            facts = (now.facts | ground.touched) ^ ground.removed
            now = State(now.world, facts, now.timers)
        tick(self.k, self.s)
        in_order(self.k, self.s, self.who)
        self._step(taken)

    def _step(self, taken: list[GroundAction]) -> None:
        self.steps.append(tuple(taken))
        self.state = self.state.step(taken).state

    def _here(self, p: int, state: State) -> str:
        player = self.model.players[self.who[p]]
        names = self.model.stations + self.model.tables
        return next(s for s in names if state.holds("loc", player, s))

    def _name_of(self, place: int, state: State) -> str:
        """The station of a place; of free tables the first that nobody is at."""
        k, model = self.k, self.model
        if k[OBJECTS] <= place < k[TABLE]:
            return model.stations[place - k[OBJECTS]]
        if place == k[TABLE]:
            return next(
                t
                for t in model.tables
                if state.holds("station_empty", t) and state.holds("vacant", t)
            )
        name = model.objects[place]
        predicate = "item_on" if place < k[ITEMS] else "container_at"
        return next(t for t in model.tables if state.holds(predicate, name, t))

    def _walk(self, p: int, place: int, state: State) -> GroundAction:
        binding = {
            "p1": self.model.players[self.who[p]],
            "s1": self._here(p, state),
            "s2": self._name_of(place, state),
        }
        return bound_action(self.model.world, self.model.rules.actions["move"], binding)

    def _action(self, p: int, action: int, state: State) -> GroundAction:
        kind, x, y = action % 16, action // 16 % 64, action // 1024
        if kind == MOVE:
            return self._walk(p, x, state)
        model, k, s = self.model, self.k, self.s
        names = model.rules.actions
        binding = {"p1": self.model.players[self.who[p]], "s1": self._here(p, state)}
        held = s[k[HELD] + p] - 1
        if kind == PICK and x >= k[ITEMS]:
            return self._bound(names["pick container"], binding, c1=x)
        if kind == PICK and s[k[BELOW] + x] < k[OBJECTS]:
            return self._bound(names["unstack"], binding, i1=x, i2=s[k[BELOW] + x])
        if kind == PICK:
            return self._bound(names["pick item"], binding, i1=x)
        if kind == PUT and x < k[OBJECTS]:
            return self._bound(names["stack"], binding, i1=held, i2=x)
        if kind == PUT and held >= k[ITEMS]:
            return self._bound(names["place container"], binding, c1=held)
        if kind == PUT:
            return self._bound(names["place item"], binding, i1=held)
        if kind == PROCESS:
            return self._bound(model.rules.processes[y].action, binding, i1=x)
        if kind == FILL:
            return self._bound(names["fill"], binding, c1=x)
        if kind == POUR:
            binding["m1"] = self._meal_in(held, state)
            return self._bound(names["pour"], binding, c1=x, c2=held)
        pot = s[k[INSIDE] + x] - 1
        binding["m1"] = self._meal_in(pot, state)
        if kind == BOIL:
            return self._bound(names["boil"], binding, c1=pot)
        if kind != ADD:
            raise AssertionError(f"an action of unknown kind {kind}")
        return self._bound(names["add"], binding, i1=held, c1=pot)

    def _meal_in(self, container: int, state: State) -> str:
        name = self.model.objects[container]
        meals = (o.name for o in state.objects if o.type == "meal")
        return next(m for m in meals if state.holds("in", m, name))

    def _bound(self, action: str, binding: dict[str, str], **objects: int) -> GroundAction:
        names = {key: self.model.objects[o] for key, o in objects.items()}
        return bound_action(self.model.world, action, {**binding, **names})
