"""Write the golden trajectories of the shipped tasks: `python -m tests.programs.make_trajectories`.

Only the naive reference (`tests/world/reference.py`) produces them, never the world that they test.
Each task has a pseudo-random walk, stored as the position of each player's choice in the list of
valid actions (-1 for none), and its shipped plan. Both have a digest of every step's result. A
change of this file changes the meaning of recordings and published results.
"""

from __future__ import annotations

import hashlib
import json
import random
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from robotouille import load_task, task_names
from tests.world.reference import Call, Reference, ReferenceState

__all__ = ["FILE", "TASKS", "Joint", "plan_of", "summary", "trajectories"]

FILE = Path(__file__).parents[1] / "world" / "trajectories.json"
TASKS = [
    n for n in task_names() if n.split("/")[0] in ("synchronous", "asynchronous", "multi_agent")
]
PLANS = Path(__file__).parents[2] / "problems"
STEPS = 30

Joint = list[tuple[str, Call]]
"""Actions of a step with their players, in order."""


def main() -> None:
    with ProcessPoolExecutor(2) as processes:
        found = dict(zip(TASKS, processes.map(trajectories, TASKS), strict=True))
    rows = [
        f"{json.dumps(name)}: {json.dumps(rows, separators=(',', ':'))}"
        for name, rows in found.items()
    ]
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")


def trajectories(name: str) -> dict[str, Any]:
    """Return both trajectories of a task."""
    reference = Reference(load_task(name))
    choices: list[list[int]] = []
    walked = list(course(reference, lambda state: choose(reference, state, name, choices)))
    plan = iter(plan_of(name, reference.task.seats))
    followed = list(course(reference, lambda state: next(plan, None)))
    return {"choices": choices, "walk": walked, "plan": followed}


def choose(
    reference: Reference, state: ReferenceState, name: str, choices: list[list[int]]
) -> Joint | None:
    """Choose a pseudo-random valid action per player; rare actions are as likely as walks."""
    if len(choices) == STEPS:
        return None
    generator = random.Random(f"{name} {len(choices)}")
    joint, positions = [], []
    for player in reference.players:
        valid = reference.valid(state, player)
        kind = generator.choice(sorted({action for action, _ in valid})) if valid else None
        positions.append(generator.choice([i for i, c in enumerate(valid) if c[0] == kind] or [-1]))
        if valid:
            joint.append((player, valid[positions[-1]]))
    choices.append(positions)
    return joint


def course(reference: Reference, decide: Callable[[ReferenceState], Joint | None]) -> Iterator[str]:
    """Yield summaries of the initial state and of each step's result."""
    state = reference.initial
    applied: list[bool] = []
    while True:
        valid = [
            [" ".join((n, *a)) for n, a in reference.valid(state, p)] for p in reference.players
        ]
        yield summary(digest(state), valid, applied, reference.goal_reached(state))
        joint = decide(state)
        if joint is None:
            return
        state, applied = reference.step(state, joint)


def summary(
    digest: str, valid: Sequence[Iterable[str]], applied: Sequence[bool], goal_reached: bool
) -> str:
    """Return a hash of a step's result: the state, the valid actions, and what applied."""
    lists = "\n".join("; ".join(actions) for actions in valid)
    text = f"{digest}\n{lists}\n{[int(a) for a in applied]}\n{int(goal_reached)}"
    return hashlib.blake2b(text.encode(), digest_size=10).hexdigest()


def digest(state: ReferenceState) -> str:
    """Return the digest of a state as docs/episodes.md defines it."""
    rows = [f"{a}.{i}({','.join(args)})={counts}" for a, i, args, counts in state.timer_rows()]
    rows += [f"busy({player})={steps}" for player, steps in sorted(state.busy.items())]
    lines = ["facts", *sorted(f"{f[0]}({', '.join(f[1:])})" for f in state.facts), "timers", *rows]
    lines += ["used", *(f"{kind}{i + 1}" for kind, n in state.created.items() for i in range(n))]
    return hashlib.blake2b("\n".join(lines).encode(), digest_size=16).hexdigest()


def plan_of(name: str, seats: int) -> list[Joint]:
    """Return the shipped plan of a task: for each step, its actions in order."""
    file = next(f for f in (PLANS / f"{name}@{seats}.plan", PLANS / f"{name}.plan") if f.exists())
    lines = [line for line in file.read_text().splitlines() if line and not line.startswith("#")]
    plan = []
    for line in lines:
        calls = re.findall(r"([\w-]+)\(([^)]*)\)", line)
        joint = [(action, tuple(arguments.split(", "))) for action, arguments in calls]
        plan.append([(arguments[0], (action, arguments)) for action, arguments in joint])
    return plan


if __name__ == "__main__":
    main()
