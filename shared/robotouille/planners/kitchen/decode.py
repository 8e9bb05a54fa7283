"""From a compact plan to a plan of the world: which table, which meal, under which name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from robotouille.planners.kitchen.compact_state import (
    ADD,
    BOIL,
    FILL,
    MOVE,
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
from robotouille.planners.kitchen.kernels import (
    Ints,
    blank_records,
    ints,
    kernel,
    plain,
    records,
)
from robotouille.planners.kitchen.model import KitchenModel, bound_action
from robotouille.planners.kitchen.transitions import (
    advance_timers,
    apply_action,
    place_of_action,
    sort_players,
)
from robotouille.planning.plan import Joint, Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State

__all__ = ["decode"]


@dataclass(slots=True)
class Act:
    """One action of a path, and what the state has to say of it when it is done."""

    step: int
    player: int
    action: int
    person: int = 0  # the player, as the world numbers them
    place: int = 0  # where it is done
    walks: int = 0  # 1: a player who is alone walks there in a step before
    held: int = 0  # what the player holds, -1 for nothing
    under: int = 0  # what the object that is picked up is on
    pot: int = 0  # that with the meal that is boiled or added to


def decode(
    model: KitchenModel,
    start: State,
    compact: CompactState,
    path: Sequence[Sequence[tuple[int, int]]],
) -> Plan:
    """The plan of a path of joint actions from a state; `compact` is that state for kernels.

    Each is a list of players and their actions, in the order in which they apply. A player who is
    alone, and not where an action is done, walks there first.
    """
    acts = [Act(step, p, action) for step, joint in enumerate(path) for p, action in joint]
    order = ints(range(len(model.players)))
    traced = records(Act, acts)
    work = blank_records(partial(empty_state, model.kitchen), 2)
    trace(model.record, compact, work, order, len(path), traced)
    decoder = _Decoder(model, start)
    joints: list[list[Act]] = [[] for _ in path]
    for act in plain(Act, traced):
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
    acts: Sequence[Act],
) -> None:
    """Note with each action of a path what the state says of it; `work` is room for two states."""
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
def walk_first(kitchen: Kitchen, state: CompactState, later: CompactState, act: Act) -> None:
    """Let the only player walk to where an action is done; `later` is work space."""
    copy_state(kitchen, state, later)
    advance_timers(kitchen, later)
    place = place_of_action(kitchen, later, act.action)
    if state.place[0] != place:
        copy_state(kitchen, later, state)
        state.place[0] = place
        act.walks = 1


class _Decoder:
    """Says in the world's names what is done, and follows the world's states."""

    def __init__(self, model: KitchenModel, state: State) -> None:
        self.model, self.kitchen = model, model.kitchen
        self.state = state
        self.steps: list[Joint] = []

    def step(self, joint: Iterable[Act]) -> None:
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
        """The station of a place; of free tables the first that nobody is at."""
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

    def _action(self, act: Act, kind: int, x: int, y: int, state: State) -> GroundAction:
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
            binding["m1"] = self._meal_in(act.held, state)
            return self._bound(names["pour"], binding, c1=x, c2=act.held)
        binding["m1"] = self._meal_in(act.pot, state)
        if kind == BOIL:
            return self._bound(names["boil"], binding, c1=act.pot)
        if kind != ADD:
            raise AssertionError(f"an action of unknown kind {kind}")
        return self._bound(names["add"], binding, i1=act.held, c1=act.pot)

    def _meal_in(self, container: int, state: State) -> str:
        name = self.model.objects[container]
        meals = (o.name for o in state.objects if o.type == "meal")
        return next(m for m in meals if state.holds("in", m, name))

    def _bound(self, action: str, binding: dict[str, str], **objects: int) -> GroundAction:
        names = {key: self.model.objects[o] for key, o in objects.items()}
        return bound_action(self.model.world, action, {**binding, **names})
