"""Invented episode rows for tests of metrics and reports."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

from robotouille_evaluation.metrics import (
    BudgetRow,
    Counts,
    EpisodeMeasures,
    Optimum,
    PackId,
    Result,
    ResultRow,
    TotalUsage,
)
from robotouille_evaluation.metrics.failure_kinds import CATEGORIES, Subcategory
from robotouille_evaluation.metrics.rows import FailureRow, ScoreRow

__all__ = ["TASKS", "made_up_rows", "row", "shift_row"]

PACK = PackId(name="ours", version="1.0", digest="0123456789abcdef")
TASKS = {
    "synchronous": {"01_cheese_sandwich": 8, "02_lettuce_sandwich": 14, "04_hamburger": 8},
    "asynchronous": {"01_cheese_chicken_sandwich": 21, "06_potato_soup": 19},
    "multi_agent": {"01_lettuce_burger": 14},
}


def row(**fields: Any) -> ResultRow:
    """Return the row of a success in the optimum of 8 steps, with a budget of 12."""
    values: dict[str, Any] = {
        "run": "test",
        "pack": PACK,
        "dataset": "synchronous",
        "task": "01_cheese_sandwich",
        "instance": "own-01-0",
        "agent": "planner",
        "budget": BudgetRow(rule="own", steps=12),
        "optimum": Optimum(steps=8, bound=8, proven=True),
        "outcome": Result(success=True, steps=8, ended_by="goal"),
    }
    return ResultRow(**{**values, **fields})


def shift_row(points: int, planner: int | None = 100, **fields: Any) -> ResultRow:
    """Return the row of a shift with points, four served orders and an expired one."""
    values: dict[str, Any] = {
        "dataset": "shifts",
        "budget": BudgetRow(rule="shift", steps=180),
        "optimum": Optimum(),
        "outcome": Result(success=False, steps=180, ended_by="shift-over"),
        "score": ScoreRow(points=points, served=4, expired=1, planner=planner),
    }
    return row(**{**values, **fields})


def made_up_rows(
    instances: int = 10, skills: dict[str, float] | None = None, seed: int = 0
) -> Iterator[ResultRow]:
    """Yield episodes of agents with different skills in several tasks."""
    generator = random.Random(seed)
    for agent, skill in (skills or {"planner": 1.0, "react": 0.5, "random": 0.05}).items():
        for dataset, tasks in TASKS.items():
            for task, optimum in tasks.items():
                for instance in range(instances):
                    yield _made_up(generator, agent, skill, dataset, task, optimum, instance)


def _made_up(
    generator: random.Random,
    agent: str,
    skill: float,
    dataset: str,
    task: str,
    optimum: int,
    instance: int,
) -> ResultRow:
    budget = optimum * 3 // 2
    success = generator.random() < skill * (1.0 if dataset == "synchronous" else skill)
    steps = generator.randint(optimum, budget) if success and skill < 1 else budget
    steps = optimum if skill == 1 else steps
    left = 0.0 if success else generator.choice((0.4, 0.8, 1.0, 1.3))
    subcategory = generator.choice(list(Subcategory))
    failure = FailureRow(category=CATEGORIES[subcategory], subcategory=subcategory.value)
    seats = 2 if dataset == "multi_agent" else 1
    return row(
        dataset=dataset,
        task=task,
        instance=f"own-{dataset}-{task[:2]}-{instance}",
        seed=instance,
        agent=agent,
        strategy="react" if agent == "react" else "",
        model="small-model" if agent == "react" else "",
        seats=seats,
        budget=BudgetRow(rule="own", steps=budget),
        optimum=Optimum(steps=optimum, bound=optimum, proven=True),
        outcome=Result(success=success, steps=steps, ended_by="goal" if success else "step-limit"),
        counts=Counts(
            invalid=generator.randint(0, 5), malformed=generator.randint(0, 2), calls=steps + 7
        ),
        usage=TotalUsage(prompt_tokens=steps * 900, completion_tokens=steps * 80, cost=steps / 500),
        seconds=steps * 1.5,
        repetitions=0 if success else generator.randint(0, 12),
        recording=f"recordings/{agent}/{task}-{instance}.rtr",
        measures=EpisodeMeasures(
            to_go_least=left,
            to_go_most=left,
            asynchronous_first=generator.random() < 0.5 if dataset == "asynchronous" else None,
            waiting_share=0.1,
            idle_share=0.05,
            stumbles=3,
            recovered=2,
            contributions={"robot1": 0.4, "robot2": 0.6} if seats > 1 else {},
            overlap=0.5 if seats > 1 else None,
            failure=None if success else failure,
        ),
    )
