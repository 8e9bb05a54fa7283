"""Rows in groups that may be compared: by player, data set and task, and what else differs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

from robotouille_evaluation.metrics.intervals import Interval, bootstrap
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.report import published

__all__ = ["by", "datasets", "interval", "named", "part_played", "task_number", "tasks"]

Group = dict[str, list[EpisodeRow]]

DATASETS = ("synchronous", "asynchronous", "multi_agent")
"""The order in which the paper has them; others follow by name."""


def by(rows: Iterable[EpisodeRow], key: Callable[[EpisodeRow], str]) -> Group:
    """Rows by a key, in the order in which the keys first occur."""
    found: Group = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found


def named(rows: Sequence[EpisodeRow]) -> Group:
    """Rows by player. Where packs, variants, kinds of instances, timings, budgets, what the world
    does meanwhile, or the size of an instance's team differ, they are groups of their own and named
    so: a mean over them would say nothing."""
    played: dict[str, set[int]] = {}
    for row in rows:
        played.setdefault(row.instance, set()).add(row.seats)

    def team(row: EpisodeRow) -> str:
        if len(played[row.instance]) == 1:
            return ""
        return f"{row.seats} players" if row.seats > 1 else "alone"

    differing = [get for get in (*_SETTINGS, team) if len({get(row) for row in rows}) > 1]

    def name(row: EpisodeRow) -> str:
        return " · ".join([row.player, *filter(None, (get(row) for get in differing))])

    return dict(sorted(by(rows, name).items()))


_SETTINGS: tuple[Callable[[EpisodeRow], str], ...] = (
    lambda row: f"{row.pack.name} {row.pack.version} {row.pack.digest[:8]}",
    lambda row: row.variant,
    lambda row: row.kind,
    lambda row: row.timing,
    lambda row: row.pace,
    lambda row: row.budget.rule,
)


def datasets(rows: Iterable[EpisodeRow]) -> Group:
    """Rows by data set, in the paper's order."""

    def place(name: str) -> tuple[int, str]:
        return (DATASETS.index(name) if name in DATASETS else len(DATASETS), name)

    groups = by(rows, lambda row: row.dataset)
    return {name: groups[name] for name in sorted(groups, key=place)}


def tasks(rows: Iterable[EpisodeRow]) -> Group:
    """Rows by task, in the order of their numbers."""
    groups = by(rows, lambda row: row.task)
    return {name: groups[name] for name in sorted(groups, key=lambda t: (task_number(t) or 0, t))}


def task_number(task: str) -> int | None:
    """Which of the paper's ten tasks it is, 1 to 10: ours are named `01_…`, the published `0_…`."""
    found = re.match(r"(\d{1,9})_", task.rpartition("/")[2])
    if not found:
        return None
    digits = found[1]
    return int(digits) if len(digits) > 1 else int(digits) + 1


def part_played(dataset: str, rows: Iterable[EpisodeRow]) -> str:
    """Of a data set that the paper has too, how much was played: `2 of 10 tasks`; nothing for all
    of it."""
    known = published.SUCCESS_BY_TASK.get(dataset)
    if known is None:
        return ""
    number = len({row.task for row in rows})
    whole = max(map(len, known.values()))
    return f"{number} of {whole} tasks" if number < whole else ""


def interval(
    rows: Iterable[EpisodeRow], value: Callable[[EpisodeRow], float | None]
) -> Interval | None:
    """The mean of a value with its bootstrap interval; the trials of an instance are one draw."""
    clusters: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        found = value(row)
        if found is not None:
            clusters.setdefault((row.dataset, row.task, row.instance), []).append(float(found))
    return bootstrap([clusters[key] for key in sorted(clusters)])
