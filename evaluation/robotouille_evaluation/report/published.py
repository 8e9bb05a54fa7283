"""Results published in the Robotouille paper, for comparison.

Gonzalez-Pumariega, Yean, Sunkara, Choudhury: "Robotouille: An Asynchronous Planning Benchmark for
LLM Agents" (ICLR 2025). The paper used other instances, so reports mark these numbers. Numbers are
as printed, even where a table's total is not the mean of its rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean

SOURCE = "Gonzalez-Pumariega et al., Robotouille, ICLR 2025"


LEADERBOARD = "ReAct (leaderboard of the repository)"


@dataclass(frozen=True, slots=True)
class PublishedSuccess:
    """Success rates in per cent of a model and strategy. None: not in the paper.

    `error` is the standard error of the rate on asynchronous tasks, where the paper prints one.
    """

    model: str
    strategy: str
    synchronous: float | None
    asynchronous: float | None
    error: float | None = None

    def cell(self, dataset: str) -> str | None:
        """Return the rate on a data set in words; None if it is unknown."""
        if dataset == "synchronous" and self.synchronous is not None:
            return f"{self.synchronous:.3g} %"
        if dataset != "asynchronous" or self.asynchronous is None:
            return None
        error = "" if self.error is None else f" ± {self.error:.3g}"
        return f"{self.asynchronous:.3g} %{error}"


SUCCESS = (
    PublishedSuccess("gpt-4o", "I/O", 4.0, 1.0),
    PublishedSuccess("gpt-4o", "I/O CoT", 14.0, 1.0),
    PublishedSuccess("gpt-4o", "ReAct", 47.0, 11.0),
    PublishedSuccess("gpt-4o", "PLaG (BaG)", None, 13.0),
    PublishedSuccess("gpt-4o", "Reflexion", None, 17.0),
    PublishedSuccess("gpt-4o", "ReAct, tasks 1 to 3", None, 30.0, 8.5),
    PublishedSuccess("gpt-4o", "ReAct + Prior, tasks 1 to 3", None, 40.0, 5.0),
    PublishedSuccess("gpt-4o-mini", "I/O", 4.0, 0.0),
    PublishedSuccess("gpt-4o-mini", "I/O CoT", 10.0, 1.0),
    PublishedSuccess("gpt-4o-mini", "ReAct", 11.0, 0.0),
    PublishedSuccess("gemini-1.5-flash", "I/O", 0.0, 0.0),
    PublishedSuccess("gemini-1.5-flash", "I/O CoT", 13.0, 0.0),
    PublishedSuccess("gemini-1.5-flash", "ReAct", 0.0, 0.0),
    PublishedSuccess("claude-3-haiku", "I/O", 1.0, 0.0),
    PublishedSuccess("claude-3-haiku", "I/O CoT", 2.0, 0.0),
    PublishedSuccess("claude-3-haiku", "ReAct", 2.0, 0.0),
    PublishedSuccess("Qwen2-72B-Instruct", LEADERBOARD, 7.0, 2.0),
    PublishedSuccess("Qwen2-32B-Instruct", LEADERBOARD, 6.0, 1.0),
    PublishedSuccess("Meta-Llama-3.1-70B-Instruct", LEADERBOARD, 2.0, 0.0),
    PublishedSuccess("Meta-Llama-3.1-8B-Instruct", LEADERBOARD, 1.0, 0.0),
)
"""Tables "successes" and "other-async-baselines" (totals), then finding 7 (section 4.2.4) in the
place of gpt-4o's last rows, and at the end the models that only the leaderboard in the published
repository's README (release c8236a2e) has."""

SUCCESS_INSTANCES = 100
"""Instances of each data set: ten of each task."""

SUCCESS_BY_TASK: dict[str, dict[str, tuple[float, ...]]] = {
    "synchronous": {
        "I/O": (20, 0, 10, 0, 0, 10, 0, 0, 0, 0),
        "I/O CoT": (40, 20, 30, 10, 0, 20, 0, 10, 10, 0),
        "ReAct": (70, 80, 80, 40, 60, 20, 50, 30, 20, 20),
    },
    "asynchronous": {
        "I/O": (10, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        "I/O CoT": (0, 0, 0, 0, 10, 0, 0, 0, 0, 0),
        "ReAct": (20, 30, 40, 10, 0, 10, 0, 0, 0, 0),
        "PLaG (BaG)": (20, 30, 20, 30, 10, 20, 0, 0, 0, 0),
        "Reflexion": (30, 50, 40, 10, 10, 30, 0, 0, 0, 0),
    },
}
"""Tables "tasks-results" and "other-async-baselines": gpt-4o, per cent for tasks 1 to 10."""


def success_on_tasks(each: PublishedSuccess, dataset: str, numbers: Iterable[int]) -> float | None:
    """Return the mean rate on some tasks of a data set, if the paper has rates by task."""
    rates = SUCCESS_BY_TASK.get(dataset, {}).get(each.strategy)
    if each.model != "gpt-4o" or rates is None:
        return None
    return fmean(rates[number - 1] for number in numbers)


HORIZONS = {
    "synchronous": (10, 14, 24, 10, 15, 23, 36, 44, 63, 57),
    "asynchronous": (21, 27, 37, 42, 46, 19, 42, 46, 68, 82),
}
"""Table "tasks-results": horizon lengths of tasks 1 to 10."""

OPTIMALITY = {
    "synchronous": {"1": 55.3},
    "asynchronous": {"1": 9.1, "1 to 1.25": 63.6},
}
"""Section 4.2.2, finding 2: gpt-4o ReAct, per cent of successes by bin."""

STEPS_TO_GO = {
    "synchronous": {"0.5 to 1": 41.5, "1 or more": 45.3},
    "asynchronous": {"0.5 to 1": 58.6, "1 or more": 25.3},
}
"""Section 4.2.2, finding 3: gpt-4o ReAct, per cent of failures by bin. The paper writes (0.5, 1],
but its numbers count the value 1 to the next bin."""

FAILURES = {
    "synchronous": {
        "goal": 64.1,
        "transition": 32.1,
        "goal: Bad Start": 28.3,
        "transition: Violates 'One item at station' rule": 24.5,
    },
    "asynchronous": {
        "goal": 34.1,
        "transition": 56.8,
        "transition: Violates 'One item at station' rule": 53.4,
    },
}
"""Section 4.2.3, finding 4: gpt-4o ReAct, per cent of failures, annotated by people."""

RECOVERY = {"synchronous": (17, 58.8, 90.0), "asynchronous": (52, 40.4, 57.1)}
"""Appendix "Transition Failure Recovery Analysis": gpt-4o ReAct, number of transition failures,
per cent that recovered, and per cent of these that did not repeat the mistake."""

ASYNCHRONOUS_FIRST = (16.0, 6.0)
"""Section 4.2.4, finding 6: success in per cent with asynchronous work first, and without."""


@dataclass(frozen=True, slots=True)
class PublishedAblation:
    """Row of table "ablation1": solved tasks out of 9, mean steps, cost in US dollars."""

    name: str
    solved: int
    steps: float
    cost: float


ABLATIONS = (
    PublishedAblation("no-history", 1, 29.11, 2.11),
    PublishedAblation("no-history-mpc", 1, 28.66, 2.70),
    PublishedAblation("last-action", 1, 29.55, 2.35),
    PublishedAblation("last-action-mpc", 2, 26.66, 2.92),
    PublishedAblation("last-reasoning-action", 1, 28.88, 2.46),
    PublishedAblation("last-reasoning-action-mpc", 3, 28.33, 2.64),
    PublishedAblation("last-obs-reasoning-action", 2, 26.77, 3.02),
    PublishedAblation("last-obs-reasoning-action-mpc", 3, 23.88, 2.93),
)
ABLATION_DATASET, ABLATION_TASKS, ABLATION_EPISODES = "synchronous", 3, 9
"""The published configurations `ReAct/ablations` have three tasks and three seeds."""

STOCHASTIC = {2: (80.0, 10.0), 3: (80.0, 20.0), 7: (50.0, 0.0), 8: (30.0, 10.0), 9: (20.0, 10.0),
              10: (20.0, 0.0)}  # fmt: skip
"""Table "stochastic-results": synchronous tasks, per cent without and with random reversals."""

SYNCHRONOUS_VARIANTS = {1: (50.0, 20.0), 2: (60.0, 30.0), 3: (50.0, 40.0)}
"""Table "dataset-comparison": asynchronous tasks, per cent without and with delays."""
