"""States after a sequence of actions."""

from __future__ import annotations

from robotouille import State, World, load_task
from robotouille.planning.plan import read_plan

POT_AT_SINK = [
    "move table2", "pick-up-container pot1", "move sink1", "place-container", "fill-pot",
]  # fmt: skip
BOILING = [
    *POT_AT_SINK, "-", "-", "-", "pick-up-container pot1", "move stove1", "place-container",
    "boil-water",
]  # fmt: skip
"""Actions in `asynchronous/09`."""


def after(name: str, *lines: str) -> State:
    """Return a task's state after the first player's `ACTION ARGUMENT…` lines (`-` waits)."""
    state = World(name).initial
    player = state.world.players[0]
    for line in lines:
        word, *arguments = line.split()
        actions = [a for a in state.actions(player) if a.name == word]
        chosen = [a for a in actions if set(arguments) <= set(a.arguments)][:1]
        assert chosen or line == "-"
        state = state.step(chosen).state
    return state


def planned(name: str, seats: int, steps: int | None = None) -> list[State]:
    """Return the states of a task's shipped plan for a team, up to a step."""
    task = load_task(name, seats=seats)
    world = World(task)
    suffix = f"@{seats}" if seats > 1 else ""
    plan = next(task.folder.glob(f"{task.name.rpartition('/')[2].partition('@')[0]}{suffix}.plan"))
    states = [world.initial]
    for joint in list(read_plan(plan.read_text(), world))[:steps]:
        states.append(states[-1].step(list(joint)).state)
    return states
