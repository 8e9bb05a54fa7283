"""Kitchens in a row, and exact distances to check against."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from robotouille import State, World
from robotouille.planning.kitchen.bound.lower_bound import heuristic
from robotouille.planning.kitchen.bound.scratch import new_scratch
from robotouille.planning.kitchen.kernels import record
from robotouille.planning.kitchen.solver import KitchenSearch, kitchen_search
from robotouille.planning.plan import replay
from robotouille.planning.solvers import solve
from robotouille.world.grounding.actions import GroundAction
from tests.world.kitchens import kitchen

Json = dict[str, Any]

FACTS = {
    "patty": ["iscookable"],
    "chicken": ["iscookable", "isfryable"],
    "lettuce": ["iscuttable"],
    "onion": ["iscuttable", "isfryableifcut"],
}


def row(
    stations: str, *goal: tuple[str, str], things: str = "", at: int = 0, **delays: int
) -> World:
    """Return a world with a cook at one of the stations in a row.

    Objects are `kind@station`, piles from below. A goal is a predicate with `kind+number` for each
    argument.
    """
    kinds = stations.split()
    named = [thing.split("@") for thing in things.split()]
    items: list[Json] = []
    for kind, x in named:
        if kind not in ("pot", "bowl", "water"):
            level = sum(item["x"] == int(x) for item in items)
            items.append({"name": kind, "x": int(x), "y": 0, "stack-level": level,
                          "predicates": FACTS.get(kind, [])})  # fmt: skip
    return kitchen(
        width=len(kinds),
        stations=placed((kind, x) for x, kind in enumerate(kinds)),
        items=items,
        containers=placed((k, int(x)) for k, x in named if k in ("pot", "bowl")),
        meals=placed((k, int(x)) for k, x in named if k == "water"),
        players=[{"name": "robot", "x": at, "y": 1, "direction": [0, -1]}],
        config={name: {"default": steps} for name, steps in delays.items()},
        goal=[term(predicate, arguments) for predicate, arguments in goal],
    )


def placed(things: Any) -> list[Json]:
    return [{"name": kind, "x": x, "y": 0} for kind, x in things]


def term(predicate: str, arguments: str) -> Json:
    pairs = [argument.split("+") for argument in arguments.split()]
    return {
        "predicate": predicate,
        "args": [k for k, _ in pairs],
        "ids": [int(n) for _, n in pairs],
    }


Successors = Callable[[State], Iterator[State]]


@dataclass(frozen=True)
class Explored:
    """All reachable states and the steps from each to the goal; None for dead ends."""

    world: World
    states: list[State]
    distances: list[int | None]


def explored(world: World, cap: int, start: State | None = None) -> Explored | None:
    """Return all reachable states, or None beyond `cap`."""
    successors = _one_acts if len(world.players) == 1 else _all_act
    states = [world.initial if start is None else start]
    numbers = {states[0]: 0}
    sources: list[list[int]] = [[]]
    for number, state in enumerate(states):
        for after in successors(state):
            known = numbers.setdefault(after, len(states))
            if known == len(states):
                states.append(after)
                sources.append([])
            sources[known].append(number)
        if len(states) > cap:
            return None
    return Explored(world, states, _distances(states, sources))


def _one_acts(state: State) -> Iterator[State]:
    yield state.step([]).state
    for action in state.actions(state.world.players[0]):
        yield state.world.successor(state, action)


def _all_act(state: State) -> Iterator[State]:
    """Yield the states after every order of valid actions, at most one per player."""
    players = state.world.players

    def joints(now: State, taken: tuple[str, ...]) -> Iterator[list[GroundAction]]:
        yield []
        for player in players:
            for action in () if player in taken else now.actions(player):
                facts = (now.facts | action.touched) ^ action.removed
                after = State(now.world, facts, now.timers)
                for more in joints(after, (*taken, player)):
                    yield [action, *more]

    for joint in joints(state, ()):
        yield state.step(joint).state


def _distances(states: list[State], sources: list[list[int]]) -> list[int | None]:
    found: list[int | None] = [0 if state.goal_reached else None for state in states]
    queue = deque(number for number, steps in enumerate(found) if steps == 0)
    while queue:
        target = queue.popleft()
        for source in sources[target]:
            if found[source] is None:
                found[source] = (found[target] or 0) + 1
                queue.append(source)
    return found


def received(state: State, distance: int | None) -> str:
    """Describe a state for a failed check."""
    task = state.world.task
    facts = [f for f in state.fact_names() if not f.startswith(("vacant", "station_empty"))]
    goal = [(term.predicate, term.args, term.ids) for term in task.problem.goal]
    return f"{task.name}: distance {distance}\n{facts}\n{state.timer_rows()}\n{goal}"


def check_heuristic(state: State, distance: int | None) -> bool:
    """Check that the heuristic does not exceed the distance. Return False without a search."""
    search = kitchen_search(state.world, state)
    if search is None:
        return False
    if distance is not None:
        assert least_heuristic(search) <= distance, received(state, distance)
    return True


def check_turns(found: Explored) -> None:
    """Check the heuristic in the middle of steps, after one cook's action that begins no delay."""
    steps = dict(zip(found.states, found.distances, strict=True))
    for state in found.states:
        for action in (a for p in state.world.players for a in state.actions(p) if not a.effects):
            facts = (state.facts | action.touched) ^ action.removed
            middle = State(state.world, facts, state.timers)
            others = [p for p in state.world.players if p != action.player]
            joints = [[action], *([action, a] for p in others for a in middle.actions(p))]
            ends = [steps[state.step(joint).state] for joint in joints]
            least = min((1 + left for left in ends if left is not None), default=None)
            search = kitchen_search(state.world, middle)
            assert search is not None
            if least is not None:
                assert least_heuristic(search, turns=1) <= least, received(middle, least)


def least_heuristic(search: KitchenSearch, turns: int = 0) -> int:
    """Return the least heuristic of all goal assignments at a search's start."""
    kitchen, start, scratch = search.model.record, search.compact, record(new_scratch())
    found = [heuristic(kitchen, goal, start, scratch, turns) for goal in search.goals]
    return min(found, default=1 << 30)


def check_answer(state: State, distance: int | None) -> None:
    """Check that the result is a plan of the exact length, or a proof that no plan exists."""
    answer = solve(state.world, state)
    if distance is None:
        assert answer.plan is None, received(state, distance)
        assert answer.unsolvable
        return
    assert answer.plan is not None, received(state, distance)
    assert (len(answer.plan), answer.bound) == (distance, distance), received(state, distance)
    assert answer.optimal
    assert not answer.unsolvable
    report = replay(answer.plan, state.world, state)
    assert report.ok, f"{report}\n{received(state, distance)}"
