"""Courses of play, in which each state is searched from, and what compact states say."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace

from robotouille import State, World
from robotouille.planners.kitchen.applicable import applicable_actions
from robotouille.planners.kitchen.compact_state import (
    PICK,
    PUT,
    CompactState,
    Kitchen,
    copy_state,
    decode_action,
    empty_state,
)
from robotouille.planners.kitchen.kernels import record, zeros
from robotouille.planners.kitchen.model import KitchenModel
from robotouille.planners.kitchen.solver import KitchenSearch, kitchen_search
from robotouille.planners.kitchen.transitions import (
    advance_timers,
    apply_action,
    place_of_action,
)
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits


def kind_of(action: int) -> int:
    kind, _, _ = decode_action(action)
    return kind


def walk(world: World, rng: random.Random, steps: int) -> Iterator[KitchenSearch]:
    """A search from every state of a course of play at random, in which things get on."""
    state = world.initial
    for _ in range(steps):
        search = kitchen_search(world, state)
        if search is None or not len(search.goals):
            return
        yield search
        useful = list(possible(search, rng.randrange(len(search.goals))))
        progress = [action for action, _ in useful if kind_of(action) not in (PICK, PUT)]
        if useful and rng.random() < 0.8:
            action = (
                rng.choice(progress) if progress and rng.random() < 0.5 else rng.choice(useful)[0]
            )
            state = after_plan(state, search.plan([[(0, action)]]))
        else:
            state = world.successor(state, rng.choice(state.actions(world.players[0])))


def on_the_way(world: World) -> Iterator[KitchenSearch]:
    """A search from every state of a shortest course of play."""
    state, search = world.initial, kitchen_search(world, world.initial)
    plan = search.solve(Limits(expansions=400)).plan if search is not None else None
    for joint in plan or ():
        search = kitchen_search(world, state)
        assert search is not None
        yield search
        state = state.step(joint).state


def after_plan(state: State, plan: Plan) -> State:
    for joint in plan:
        step = state.step(joint)
        assert all(attempt.applied for attempt in step.attempts), step.attempts
        state = step.state
    return state


def copied(search: KitchenSearch) -> CompactState:
    """The start of a search, to be changed."""
    state = record(empty_state(search.model.kitchen))
    copy_state(search.model.record, search.compact, state)
    return state


def after(search: KitchenSearch, action: int, here: bool) -> CompactState:
    """The compact state after an action, and after the walk before it."""
    kitchen, state = search.model.record, copied(search)
    if not here:
        advance_timers(kitchen, state)
        state.place[0] = place_of_action(kitchen, state, action)
    apply_action(kitchen, state, 0, action)
    advance_timers(kitchen, state)
    return state


def possible(search: KitchenSearch, assignment: int) -> Iterator[tuple[int, bool]]:
    """What the player can do, here and elsewhere."""
    kitchen, goal, found = search.model.record, search.goals[assignment], zeros(1024)
    for here in (True, False):
        state = copied(search)
        if not here:
            advance_timers(kitchen, state)
        for i in range(applicable_actions(kitchen, goal, state, 0, here, found, 0)):
            yield int(found[i]), here


def contents(kitchen: Kitchen, state: CompactState) -> list[list[int]]:
    """What a compact state says, but for what only the search needs."""
    return [
        list(map(int, state.place[: kitchen.players])),
        list(map(int, state.held[: kitchen.players])),
        list(map(int, state.below[: kitchen.objects])),
        list(map(int, state.inside[: kitchen.meals])),
        list(map(int, state.boiled[: kitchen.meals])),
        list(map(int, state.counters[: kitchen.counters])),
    ]


def same_kitchen(model: KitchenModel, state: State) -> KitchenModel:
    """The model of an earlier state, with names for the meals made since."""
    return replace(model, meals=[o.name for o in state.objects if o.type == "meal"])
