"""Short searches in plain Python, before the planner is compiled.

Compiling takes up to a minute, and most searches take less than a second without it.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor

from robotouille import State, Task
from robotouille.certification.certificate import Certificate, Deadline, certify
from robotouille.certification.certifying import BUDGET
from robotouille.planning import solvers
from robotouille.planning.plan import Limits
from robotouille.processes import spawn_context

SECONDS = 5.0


def searched_plainly(
    task: Task, start: State | None, expansions: int | None, seconds: float
) -> Certificate | None:
    """Return the answer of a search, or None if plain Python does not find it in some seconds."""
    # A process compiles functions, or does not, when it imports them, so another one is needed.
    before = os.environ.get("ROBOTOUILLE_COMPILE")
    os.environ["ROBOTOUILLE_COMPILE"] = "0"
    try:
        with ProcessPoolExecutor(1, spawn_context()) as pool:
            limit = min(seconds, SECONDS)
            return pool.submit(_answer, task, start, expansions, limit).result()
    finally:
        if before is None:
            del os.environ["ROBOTOUILLE_COMPILE"]
        else:
            os.environ["ROBOTOUILLE_COMPILE"] = before


def _answer(
    task: Task, start: State | None, expansions: int | None, seconds: float
) -> Certificate | None:
    deadline = Deadline(seconds)
    limits = Limits(expansions, BUDGET.states, deadline)
    found = certify(task, solvers.solve, limits, start=start)
    return None if deadline.struck else found
