"""Measure the hot paths of the world and the protocol on small, medium and large tasks."""

from __future__ import annotations

import random
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, field

import msgpack

from robotouille import GroundAction, State, World, load_task
from robotouille.protocol.states import StateWriter

TASKS = ("synchronous/01", "asynchronous/09", "multi_agent/09", "multi_agent/10")
WALK = 40_000


@dataclass
class Row:
    """Results of one task; times in seconds, sizes in bytes."""

    task: str
    load: float
    steps: float
    steps_and_actions: float
    actions: float
    text: float
    diff: float
    delta_p95: int
    snapshot: int
    goal: float
    memory: float
    ground_actions: int = 0
    extra: dict[str, float] = field(default_factory=dict)


def best(work: Callable[[], object], repeat: int = 5) -> float:
    """Return the shortest of several runs in seconds, the one least disturbed by other programs."""
    times = []
    for _ in range(repeat):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return min(times)


def load(name: str) -> World:
    """Load a task, ground it, and list every player's first actions."""
    world = World(load_task(name))
    for player in world.players:
        world.initial.actions(player)
    return world


def walk(world: World, steps: int, seed: int) -> list[tuple[State, str, GroundAction]]:
    """Return a random walk of valid actions in which the players take turns."""
    generator = random.Random(seed)
    state, course = world.initial, []
    for i in range(steps):
        player = world.players[i % len(world.players)]
        actions = state.actions(player)
        action = actions[int(generator.random() * len(actions))]
        course.append((state, player, action))
        state = world.successor(state, action)
    return course


def measure(name: str) -> Row:
    """Measure one task."""
    load_seconds = best(lambda: load(name))
    world = load(name)
    for seed in range(3):
        walk(world, WALK, seed)
    course = walk(world, WALK, 3)

    def bare() -> None:
        successor = world.successor
        for state, _, action in course:
            successor(state, action)

    def with_goal() -> None:
        for state, _, action in course:
            _ = world.successor(state, action).goal_reached

    def listed() -> None:
        for state, player, _ in course:
            world.actions(state, player)

    walking = best(lambda: walk(world, WALK, 4), 3)
    sample = course[:: WALK // 200]
    writer = StateWriter(world)
    tables, values = writer.tables(world.initial), writer.values(world.initial)
    task = world.task.to_json()
    snapshot = len(msgpack.packb({"type": "snapshot", "task": task, **tables, **values}))
    pairs = joint_walk(world, 5000)
    sizes = [len(delta(writer, i, *pair)) for i, pair in enumerate(pairs)]
    deltas = best(lambda: [delta(writer, i, *p) for i, p in enumerate(pairs)])
    return Row(
        task=name,
        load=load_seconds,
        steps=WALK / best(with_goal),
        steps_and_actions=WALK / walking,
        actions=best(listed) / WALK,
        text=best(lambda: [s.text(p) for s, p, _ in sample]) / len(sample),
        diff=deltas / len(pairs),
        delta_p95=sorted(sizes)[int(len(sizes) * 0.95)],
        snapshot=snapshot,
        goal=best(lambda: [s.goal_reached for s, _, _ in course]) / WALK,
        memory=memory(world, course),
        ground_actions=len(world.known_actions),
        extra={"bare": WALK / best(bare)},
    )


def joint_walk(world: World, steps: int) -> list[tuple[State, State, list[GroundAction]]]:
    """Return a random walk in which every player acts in every step."""
    generator = random.Random(9)
    state, course = world.initial, []
    for _ in range(steps):
        joint = [generator.choice(state.actions(player)) for player in world.players]
        after = state.step(joint).state
        course.append((state, after, joint))
        state = after
    return course


def delta(
    writer: StateWriter, step: int, before: State, after: State, joint: list[GroundAction]
) -> bytes:
    """Return the delta of a step as the server packs it."""
    message = {"type": "delta", "step": step, **writer.changes(before, after)}
    message["did"] = [[i, action.name, *action.arguments] for i, action in enumerate(joint)]
    message["seq"] = [step] * len(joint)
    packed: bytes = msgpack.packb(message)
    return packed


def memory(world: World, course: list[tuple[State, str, GroundAction]]) -> float:
    """Return the bytes per state of a set of states."""
    actions = [action for _, _, action in course[:10_000]]
    tracemalloc.start()
    state, kept = world.initial, {world.initial}
    for action in actions:
        state = world.successor(state, action)
        kept.add(state)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return used / len(kept)


# Targets: `load` is a maximum in seconds, the others are minimum rates.
TARGETS: dict[str, dict[str, float]] = {
    "synchronous/01": {"steps": 500_000, "steps_and_actions": 250_000},
    "multi_agent/09": {"steps": 300_000, "steps_and_actions": 100_000, "load": 0.05},
    "multi_agent/10": {"steps": 300_000, "steps_and_actions": 100_000, "load": 0.05},
}


def table(rows: list[Row]) -> list[list[str]]:
    """Format the results as text, one line for each measure."""
    lines = [["", *(row.task for row in rows)]]

    def line(title: str, show: Callable[[Row], str], key: str = "") -> None:
        cells = []
        for row in rows:
            target = TARGETS.get(row.task, {}).get(key)
            mark = ""
            if target is not None:
                value = getattr(row, key)
                ratio = target / value if key == "load" else value / target
                mark = f" ({ratio:.1f}×)"
            cells.append(show(row) + mark)
        lines.append([title, *cells])

    line("load and ground", lambda r: f"{r.load * 1e3:.1f} ms", "load")
    line("steps/s with goal test", lambda r: f"{r.steps:,.0f}", "steps")
    line(
        "steps/s with listing of actions",
        lambda r: f"{r.steps_and_actions:,.0f}",
        "steps_and_actions",
    )
    line("bare transitions/s", lambda r: f"{r.extra['bare']:,.0f}")
    line("valid actions of one seat", lambda r: f"{r.actions * 1e6:.2f} µs")
    line("text observation", lambda r: f"{r.text * 1e6:.0f} µs")
    line("packed delta", lambda r: f"{r.diff * 1e6:.1f} µs")
    line("delta, 95th percentile", lambda r: f"{r.delta_p95} B (limit 300)")
    line("snapshot with task", lambda r: f"{r.snapshot / 1024:.1f} KiB (limit 64)")
    line("goal test", lambda r: f"{r.goal * 1e6:.2f} µs")
    line("memory per state", lambda r: f"{r.memory:.0f} B")
    line("ground actions seen", lambda r: f"{r.ground_actions:,}")
    return lines


def main() -> list[Row]:
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    rows = [measure(name) for name in track(TASKS, "measuring", transient=True, console=console)]
    lines = table(rows)
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    print("World: one process, pure Python, random valid actions")
    for line in lines:
        cells = [line[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True)]
        print("  ".join(cells))
    print("(n×): n times as good as the target")
    return rows


if __name__ == "__main__":
    main()
