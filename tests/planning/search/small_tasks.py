"""Random tasks whose goals take some steps, and tiny kitchens from the shipped domain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hypothesis import assume
from hypothesis import strategies as st

from robotouille import State, Task, Timing, World
from robotouille.domain.schema import GoalTerm, ProblemFile
from robotouille.domain.task import build_task, read_domain
from tests.support.oracle import explore
from tests.world.random_tasks import tasks

__all__ = ["deep_tasks", "tiny_kitchens"]


@st.composite
def deep_tasks(draw: st.DrawFn, cap: int = 60) -> Task:
    """Return a random domain with a goal that holds far from the start, if possible."""
    task = draw(tasks())
    return _deepened(draw, replace(task, seats=draw(st.integers(1, 2))), cap)


def _deepened(draw: st.DrawFn, task: Task, cap: int) -> Task:
    world = World(task)
    seen = set(world.initial.atoms())
    firsts = []
    for state in explore(task, world, cap, with_goal=False).states.values():
        new = [atom for atom in state.atoms() if atom not in seen]
        seen.update(new)
        if new:
            firsts.append((state, new))
    assume(firsts)
    far, new = draw(st.sampled_from(firsts[-3:]))
    more = draw(st.lists(st.sampled_from(far.atoms()), max_size=2, unique=True))
    wanted = dict.fromkeys([draw(st.sampled_from(new)), *more])
    goal = tuple(_term(far, atom) for atom in wanted)
    return replace(task, problem=task.problem.model_copy(update={"goal": goal}))


def _term(state: State, atom: tuple[str, ...]) -> GoalTerm:
    """Return a fact about any objects of the kinds."""
    names = [thing.name for thing in state.objects]
    kinds = tuple(state.world.thing(name).kind for name in atom[1:])
    ids = tuple(names.index(name) + 1 for name in atom[1:])
    return GoalTerm(predicate=atom[0], args=kinds, ids=ids)


GOALS: list[list[tuple[str, list[str], list[int]]]] = [
    [("iscut", ["item"], [1])],
    [("iscooked", ["patty"], [1]), ("clear", ["patty"], [1])],
    [("item_on", ["bread", "table"], [1, 2]), ("atop", ["item", "bread"], [3, 1])],
    [("atop", ["item", "item"], [1, 2]), ("item_at", ["lettuce", "table"], [1, 3])],
    [("iscut", ["lettuce"], [1]), ("has_item", ["robot", "lettuce"], [2, 1])],
    [("isfried", ["item"], [1])],
    [("in", ["water", "pot"], [1, 2])],
    [("isboiling", ["water"], [1])],
    [("loc", ["robot", "board"], [1, 2]), ("nothing", ["robot"], [1])],
    [("atop", ["bread", "bread"], [1, 2])],
]

STATIONS = ["table", "table", "board", "stove", "fryer", "sink"]
ITEMS = {
    "bread": [],
    "lettuce": ["iscuttable"],
    "patty": ["iscookable"],
    "potato": ["iscuttable", "isfryableifcut"],
}


@st.composite
def tiny_kitchens(draw: st.DrawFn, players: int = 1) -> Task:
    """Draw a kitchen with two or three stations and one or two items; not all are solvable."""
    kinds = draw(st.lists(st.sampled_from(STATIONS), min_size=2, max_size=3))
    stations = [{"name": kind, "x": x, "y": 0} for x, kind in enumerate(kinds)]
    free = draw(st.permutations(range(len(kinds))))
    items = draw(st.lists(st.sampled_from(sorted(ITEMS)), min_size=0, max_size=2))
    pot = draw(st.booleans()) and len(items) < len(free)
    places = iter(free)
    problem: dict[str, Any] = {
        "version": "2.0",
        "width": 3,
        "height": 2,
        "config": {
            name: {"default": draw(st.integers(1, 2))}
            for name in ("num_cuts", "cook_time", "fry_time", "fill_time", "boil_time")
        },
        "stations": stations,
        "items": [
            {"name": item, "x": next(places), "y": 0, "predicates": ITEMS[item]} for item in items
        ],
        "containers": [{"name": "pot", "x": next(places), "y": 0}] if pot else [],
        "meals": [],
        "players": [
            {"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in range(players)
        ],
        "goal_description": "",
        "goal": [
            {"predicate": predicate, "args": args, "ids": ids}
            for predicate, args, ids in draw(st.sampled_from(GOALS))
        ],
    }
    task = build_task(
        "tiny",
        read_domain("robotouille"),
        ProblemFile.model_validate(problem),
        timing=draw(st.sampled_from(list(Timing))),
    )
    return _deepened(draw, task, 150) if draw(st.booleans()) else task
