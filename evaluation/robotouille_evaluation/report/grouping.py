"""Groups of rows that can be compared: by player, data set and task."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from robotouille.html_report.intervals import Interval
from robotouille_evaluation.metrics.outcomes import score_share
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.metrics.statistics import bootstrap
from robotouille_evaluation.report import published

OTHER_AGENTS = frozenset({"io", "plag", "reflexion", "planner", "random", "scripted"})
"""First words of built-in agents and published experiments other than ReAct, in lower case."""
RULES = frozenset({"prior", "rules"})
"""Words in the names of strategies that state the rules, such as the paper's ReAct + Prior."""

T = TypeVar("T")

RowGroups = dict[str, list[ResultRow]]

DATASETS = ("synchronous", "asynchronous", "multi_agent")
"""The paper's order. Other data sets, such as `shifts`, follow in alphabetical order."""

Setting = Callable[[ResultRow], str]

SETTINGS: tuple[Setting, ...] = (
    lambda row: f"{row.pack.name} {row.pack.version} {row.pack.digest[:8]}",
    lambda row: row.variant,
    lambda row: row.kind,
    lambda row: row.timing,
    lambda row: row.pace,
    lambda row: row.budget.rule,
)
SETTINGS_OF_VARIANTS: tuple[Setting, ...] = (
    # A run of the variant `delay-free` changes the pack and so its digest.
    lambda row: f"{row.pack.name.removesuffix('-delay-free')} {row.pack.version}",
    lambda row: row.timing,
    lambda row: row.pace,
    lambda row: row.budget.rule,
)
"""Settings in which the columns of a comparison of variants must agree."""


def by(rows: Iterable[ResultRow], key: Callable[[ResultRow], str]) -> RowGroups:
    """Return the rows by a key, in the order in which the keys first occur."""
    found: RowGroups = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found


def player_of(row: ResultRow) -> str:
    """Return the row's player, without the data set in the name of a published experiment.

    As in the paper, the experiments of a method on its two data sets, such as `IO/synchronous/io`
    and `IO/asynchronous/io`, are one player.
    """
    own = f"/{row.dataset}/"
    if own not in row.strategy:
        return row.player
    return row.player.replace(row.strategy, row.strategy.replace(own, "/", 1), 1)


def named(rows: Sequence[ResultRow], settings: Sequence[Setting] = SETTINGS) -> RowGroups:
    """Return the rows by player.

    A mean over different settings would be meaningless. If rows differ in a setting (by default
    pack, variant, kind of instance, timing, pace and step budget) or in team size, each combination
    is a group of its own whose name includes the settings that differ.
    """
    sizes: dict[str, set[int]] = {}
    for row in rows:
        sizes.setdefault(row.instance, set()).add(row.seats)

    def team(row: ResultRow) -> str:
        if len(sizes[row.instance]) == 1:
            return ""
        return f"{row.seats} players" if row.seats > 1 else "alone"

    differing = [get for get in (*settings, team) if len({get(row) for row in rows}) > 1]

    def name(row: ResultRow) -> str:
        return " · ".join([player_of(row), *filter(None, (get(row) for get in differing))])

    return dict(sorted(by(rows, name).items()))


def datasets(rows: Iterable[ResultRow]) -> RowGroups:
    """Return the rows by data set, in the paper's order."""

    def place(name: str) -> tuple[int, str]:
        return (DATASETS.index(name) if name in DATASETS else len(DATASETS), name)

    groups = by(rows, lambda row: row.dataset)
    return {name: groups[name] for name in sorted(groups, key=place)}


def by_player_and_set(
    rows: Sequence[ResultRow],
) -> Iterator[tuple[str, str, list[ResultRow]]]:
    """Yield each player with a data set and the player's episodes of it."""
    for name, group in named(rows).items():
        for dataset, episodes in datasets(group).items():
            yield name, dataset, episodes


def largest(groups: Mapping[str, list[T]], number: int) -> dict[str, list[T]]:
    """Return the groups with the most entries, in their original order."""
    chosen = set(sorted(groups, key=lambda name: -len(groups[name]))[:number])
    return {name: group for name, group in groups.items() if name in chosen}


def tasks(rows: Iterable[ResultRow]) -> RowGroups:
    """Return the rows by task, in the order of the tasks' numbers."""
    groups = by(rows, lambda row: row.task)
    return {name: groups[name] for name in sorted(groups, key=lambda t: (task_number(t) or 0, t))}


def task_number(task: str) -> int | None:
    """Return the number of the task in the paper, 1 to 10.

    Names of shipped tasks begin with `01_`. Names in the published package begin with `0_`, except
    those of teams, which begin with `1_`.
    """
    dataset, _, name = task.rpartition("/")
    found = re.match(r"(\d{1,9})_", name)
    if not found:
        return None
    from_zero = len(found[1]) == 1 and dataset != "multi_agent"
    return int(found[1]) + from_zero


def part_played(dataset: str, rows: Iterable[ResultRow]) -> str:
    """Return which part of a data set of the paper was played, such as `2 of 10 tasks`.

    The result is empty for a whole data set, and for data sets that the paper does not have.
    """
    known = published.SUCCESS_BY_TASK.get(dataset)
    if known is None:
        return ""
    number = len({row.task for row in rows})
    whole = max(map(len, known.values()))
    return f"{number} of {whole} tasks" if number < whole else ""


def may_be_react(row: ResultRow) -> bool:
    """Return False if the variant or the agent's name shows that it is not the published ReAct."""
    first, *others = re.split(r"[-/ ]", (row.strategy or row.agent).lower())
    return not (row.variant or first in OTHER_AGENTS or RULES.intersection(others))


def is_ablation(row: ResultRow) -> bool:
    """Return True if the row is from one of the published ablations of ReAct."""
    return row.strategy.startswith("ReAct/ablations/")


def score_interval(rows: Iterable[ResultRow]) -> Interval | None:
    """Return the mean share of the planner's points in shifts, with its bootstrap interval."""
    return interval(rows, score_share, binary=False)


def interval(
    rows: Iterable[ResultRow],
    value: Callable[[ResultRow], float | None],
    *,
    binary: bool = True,
) -> Interval | None:
    """Return the mean of a value with its bootstrap interval, clustered by instance.

    Args:
        binary: Values of 0 and 1 are failures and successes.
    """
    clusters: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        found = value(row)
        if found is not None:
            clusters.setdefault((row.dataset, row.task, row.instance), []).append(float(found))
    return bootstrap([clusters[key] for key in sorted(clusters)], binary=binary)
