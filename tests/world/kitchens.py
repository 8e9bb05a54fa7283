"""Small kitchens for single tests, and helpers that play in them."""

from __future__ import annotations

from typing import Any

from robotouille import State, World, load_task
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import Timing, build_task, read_domain

__all__ = [
    "FILL",
    "STATES",
    "act",
    "filling_pot",
    "full_pot",
    "kitchen",
    "play",
    "problem",
    "waiting",
]


def problem(**fields: Any) -> dict[str, Any]:
    """Return a problem: two tables, a board, two stoves, a sink, and a cook in front of table1."""
    return {
        "version": "2.0",
        "width": 6,
        "height": 5,
        "config": {},
        "stations": [
            {"name": "table", "x": 0, "y": 0},
            {"name": "table", "x": 1, "y": 0},
            {"name": "board", "x": 2, "y": 0},
            {"name": "stove", "x": 3, "y": 0},
            {"name": "stove", "x": 4, "y": 0},
            {"name": "sink", "x": 5, "y": 0},
        ],
        "items": [],
        "containers": [],
        "meals": [],
        "players": [{"name": "robot", "x": 0, "y": 1, "direction": [0, -1]}],
        "goal_description": "",
        "goal": [{"predicate": "clear", "args": ["item"], "ids": [1]}],
        **fields,
    }


def kitchen(
    *,
    timing: str = "benchmark",
    seats: int | None = None,
    domain: str = "robotouille",
    **fields: Any,
) -> World:
    """Return the world of `problem(**fields)`."""
    task = build_task(
        "test",
        read_domain(domain),
        ProblemFile.model_validate(problem(**fields)),
        timing=Timing(timing),
        seats=seats,
    )
    return World(task)


def act(state: State, action: str, *arguments: str) -> State:
    """Return the state after one action, which must be valid."""
    result = state.step(state.world.action(action, *arguments))
    assert all(attempt.applied for attempt in result.attempts), result.attempts
    return result.state


def play(state: State, *sentences: str, player: str = "") -> State:
    """Return the state after several actions, given as sentences."""
    for sentence in sentences:
        actor = player or state.world.players[0]
        result = state.step(state.world.parse(state, actor, sentence))
        assert result.attempts[0].applied
        state = result.state
    return state


def waiting(state: State, steps: int) -> State:
    """Return the state after some steps without actions."""
    for _ in range(steps):
        state = state.step([]).state
    return state


FILL = (
    "Move robot1 from table3 to table2",
    "Pick up pot1 at table2 with robot1",
    "Move robot1 from table2 to sink1",
    "Put down pot1 at sink1 with robot1",
    "Start filling pot1 with water at sink1 with robot1",
)


def full_pot() -> State:
    """Return a state with a pot of water at the sink: `water1` has been created."""
    state = waiting(play(World(load_task("asynchronous/06")).initial, *FILL), 3)
    assert [o.name for o in state.objects if o.type == "meal"] == ["water1"]
    return state


def filling_pot() -> State:
    return waiting(play(World(load_task("asynchronous/06")).initial, *FILL), 1)


def walking() -> State:
    world = World(load_task("multi_agent/01", timing="people"))
    state = world.initial.step(world.action("move", "robot1", "table2", "table7")).state
    assert state.busy_steps("robot1") > 0
    return state


STATES = {
    "initial": lambda: World(load_task("multi_agent/01")).initial,
    "filling": filling_pot,
    "full": full_pot,
    "walking": walking,
}


def bolt_recycler() -> World:
    """Return a workshop whose dispenser is also its recycling bin and recycles anything."""
    raw = read_domain("workshop").model_dump(mode="json", by_alias=True, exclude_unset=True)
    for action in raw["action_defs"]:
        if action["name"] == "recycle":
            action["precons"] = [c for c in action["precons"] if c["predicate"] != "isoffcut"]
    world = {
        "width": 3,
        "height": 3,
        "config": {"drop_time": {"default": 1}},
        "objects": {
            "bench": [{"name": "dispenser", "x": 1, "y": 0, "predicates": ["isbin"]}],
            "worker": [{"name": "fitter", "x": 1, "y": 1, "direction": [0, -1]}],
        },
        "goal": [{"predicate": "isflat", "args": ["bolt"], "ids": [1]}],
    }
    return World(
        build_task("bolts", DomainFile.model_validate(raw), ProblemFile.model_validate(world))
    )
