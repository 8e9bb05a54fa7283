"""Learning curves over seeds: tables and pictures."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from robotouille.files.writing import whole_file

Numbers = npt.NDArray[np.float64]

WINDOW = 5
"""Rollouts in a point of a curve."""
RESAMPLES = 2_000
FIELDS = ("task", "algorithm", "steps", "measure", "mean", "low", "high", "seeds")


@dataclass(frozen=True)
class RunCurves:
    """Curves of one algorithm on one task.

    Attributes:
        steps: Joint steps taken at each point.
        measures: By name, one row for each seed and one column for each point; not a number
            where no episode ended, or none reached the goal.
    """

    task: str
    algorithm: str
    steps: Numbers
    measures: dict[str, Numbers]


def rows(curves: RunCurves) -> Iterator[tuple[object, ...]]:
    """Yield the means over seeds with 95 % bootstrap intervals; see `FIELDS`."""
    for measure, values in curves.measures.items():
        # A run shorter than a window has one point, so that no table is empty.
        window = min(WINDOW, len(curves.steps))
        for point in range(0, len(curves.steps) - window + 1, window):
            part = values[:, point : point + window]
            there = ~np.isnan(part).all(axis=1)
            if not there.any():
                continue
            means = np.nanmean(part[there], axis=1)
            low, high = interval(means)
            steps = int(curves.steps[point + window - 1])
            numbers = (f"{x:.4f}" for x in (means.mean(), low, high))
            yield curves.task, curves.algorithm, steps, measure, *numbers, len(means)


def interval(values: Numbers) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of a mean, which depends on the values only."""
    draws = np.random.default_rng(0).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.percentile(values[draws].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def write_curves(path: Path, all_curves: Sequence[RunCurves]) -> None:
    """Write curves as CSV."""
    with whole_file(path) as file:
        writer = csv.writer(file)
        writer.writerow(FIELDS)
        for curves in all_curves:
            writer.writerows(rows(curves))


def draw(path: Path, tables: Sequence[Path]) -> None:
    """Draw written curves: a column of panels for each task, with the intervals as areas.

    Nothing is drawn from empty tables.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
    """
    from matplotlib import pyplot

    table = [row for each in tables for row in csv.DictReader(each.read_text("utf-8").splitlines())]
    tasks = list(dict.fromkeys(row["task"] for row in table))
    if not tasks:
        return
    figure, panels = pyplot.subplots(
        2, len(tasks), figsize=(3.2 * len(tasks), 4.6), layout="constrained", squeeze=False
    )
    for column, task in enumerate(tasks):
        own = [row for row in table if row["task"] == task]
        found = {row["measure"] for row in own}
        first, second = ("score", None) if "score" in found else ("goals", "steps")
        for panel, measure in zip(panels[:, column], (first, second), strict=True):
            if measure is None:
                panel.set_axis_off()
                continue
            for algorithm in dict.fromkeys(row["algorithm"] for row in own):
                line = [
                    row for row in own
                    if (row["algorithm"], row["measure"]) == (algorithm, measure)
                ]  # fmt: skip
                x = [int(row["steps"]) / 1e6 for row in line]
                panel.plot(x, [float(row["mean"]) for row in line], label=algorithm)
                low, high = ([float(row[name]) for row in line] for name in ("low", "high"))
                panel.fill_between(x, low, high, alpha=0.25)
            panel.set_ylabel(LABELS[measure])
            panel.set_xlabel("million joint steps")
        panels[0, column].set_title(task, fontsize=9)
        panels[0, column].legend(fontsize=8)
    with whole_file(path, text=False) as file:
        figure.savefig(file, dpi=110)


LABELS = {
    "goals": "episodes at the goal",
    "steps": "steps to the goal",
    "score": "points of a shift",
}
