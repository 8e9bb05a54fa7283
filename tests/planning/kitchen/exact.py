"""Exact distances to the goal by breadth first in the world, and what is checked against them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from robotouille import State, World
from robotouille.planners.kitchen.heuristic.lower_bound import heuristic
from robotouille.planners.kitchen.heuristic.scratch import new_scratch
from robotouille.planners.kitchen.kernels import record
from robotouille.planners.kitchen.solver import KitchenSearch, kitchen_search
from robotouille.planning.solvers import solve
from robotouille.planning.validation import replay
from robotouille.world.grounding.actions import GroundAction

__all__ = ["Explored", "check_answer", "check_heuristic", "explored"]

Successors = Callable[[State], Iterator[State]]


@dataclass(frozen=True)
class Explored:
    """All states that can be reached, and the steps from each to the goal; None if it cannot."""

    world: World
    states: list[State]
    distances: list[int | None]


def explored(world: World, cap: int, start: State | None = None) -> Explored | None:
    """Everything that can happen, by one action or one joint action a step; None beyond a cap."""
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
    """Every order of valid actions, one or none of each player's."""
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


def told(state: State, distance: int | None) -> str:
    """A state in words, for a failed check."""
    task = state.world.task
    facts = [f for f in state.fact_names() if not f.startswith(("vacant", "station_empty"))]
    goal = [(term.predicate, term.args, term.ids) for term in task.problem.goal]
    return f"{task.name}: distance {distance}\n{facts}\n{state.timer_rows()}\n{goal}"


def check_heuristic(state: State, distance: int | None) -> bool:
    """No heuristic exceeds the distance; False if this is nothing for the kitchen planner."""
    search = kitchen_search(state.world, state)
    if search is None:
        return False
    if distance is not None:
        assert least_heuristic(search) <= distance, told(state, distance)
    return True


def least_heuristic(search: KitchenSearch) -> int:
    """The heuristic of a search's start: the least of all goal assignments."""
    scratch = record(new_scratch())
    found = [heuristic(search.model.record, goal, search.compact, scratch) for goal in search.goals]
    return min(found, default=1 << 30)


def check_answer(state: State, distance: int | None) -> None:
    """The answer is a plan of the exact length that replays, or the proof that there is none."""
    answer = solve(state.world, state)
    if distance is None:
        assert answer.plan is None, told(state, distance)
        assert answer.unsolvable
        return
    assert answer.plan is not None, told(state, distance)
    assert (len(answer.plan), answer.bound) == (distance, distance), told(state, distance)
    assert answer.optimal
    assert not answer.unsolvable
    report = replay(answer.plan, state.world, state)
    assert report.ok, f"{report}\n{told(state, distance)}"
