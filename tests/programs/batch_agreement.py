"""Compare the compiled batch engine with the world for a given number of steps.

python -m tests.programs.batch_agreement --steps 10000000 --seed 1

The steps are divided among all shipped tasks, the pancake kitchen and the workshop.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from robotouille import task_names
from robotouille.batch import BatchWorld
from robotouille.compiling import COMPILED
from tests.batch.agreement import agree, world_of

__all__ = ["main"]

COPIES = 50
OTHERS = (
    "examples/pancakes", "workshop/01", "workshop/02", "workshop/02:people", "bolts",
    "asynchronous/09:people", "multi_agent/07@3:people", "multi_agent/10@4:people",
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000_000, help="total number of joint steps")
    parser.add_argument("--seed", type=lambda text: int(text, 0), default=0)
    parser.add_argument("tasks", nargs="*", help="tasks (default: all with a goal)")
    options = parser.parse_args(arguments)
    # The batch engine refuses shifts.
    shipped = [name for name in task_names() if not name.startswith("shifts/")]
    names = options.tasks or [*shipped, *OTHERS]
    steps = 1 + options.steps // (len(names) * COPIES)
    taken = ends = 0
    for name in names:
        world = world_of(name)
        ends += agree(BatchWorld(world, COPIES), world, COPIES, steps, options.seed)
        taken += steps * COPIES
        print(f"{name}: {steps * COPIES:,} joint steps agree", flush=True)
    print(json.dumps({"compiled": COMPILED, "steps": taken, "ends": ends}))


if __name__ == "__main__":
    main()
