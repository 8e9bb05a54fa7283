"""Published numbers that stand next to results: those the paper prints, or those of a checkout."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean

from robotouille_evaluation.packs.pack import FigureData
from robotouille_evaluation.packs.published_figures import REACT
from robotouille_evaluation.report import published
from robotouille_evaluation.report.bins import (
    AWAY,
    FARTHER_AWAY,
    OPTIMALITY_BINS,
    STEPS_TO_GO_BINS,
    optimality_bin,
    steps_to_go_bin,
)

Shares = Mapping[str, Mapping[str, float]]
"""Per cent by data set and bin or kind."""
FailureKind = tuple[str, str]
"""Category and subcategory."""


BINNED = {
    "optimality": (optimality_bin, OPTIMALITY_BINS),
    # The published ratios are numbers, so the last bin, "out of reach", is unknown.
    "steps_to_go": (steps_to_go_bin, STEPS_TO_GO_BINS[:-1]),
}
"""Figures with histograms: the bin of a value, and all bins."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Published numbers of gpt-4o with ReAct.

    `repetitions` are the repeated transitions of each episode by data set and `successes` or
    `failures`. `failure_kinds` are the failures by player and data set. The paper prints neither.
    """

    optimality: Shares = field(default_factory=lambda: published.OPTIMALITY)
    steps_to_go: Shares = field(default_factory=lambda: published.STEPS_TO_GO)
    failures: Shares = field(default_factory=lambda: published.FAILURES)
    repetitions: Mapping[tuple[str, str], Sequence[float]] = field(default_factory=dict)
    failure_kinds: Mapping[tuple[str, str], Sequence[FailureKind]] = field(default_factory=dict)

    def mean_repetitions(self, dataset: str, group: str) -> float | None:
        """Return the mean number of repeated transitions, if it is known."""
        found = self.repetitions.get((dataset, group))
        return fmean(found) if found else None


def reference_of(figures: Iterable[FigureData]) -> Reference:
    """Return the numbers behind published figures; without figures, those the paper prints."""
    found = list(figures)
    if not found:
        return Reference()
    samples = {
        (each.figure, each.dataset, each.group): each.values
        for each in found
        if each.figure != "failures" and each.values
    }
    kinds: dict[tuple[str, str], list[FailureKind]] = {}
    for each in found:
        if each.figure == "failures":
            category, _, subcategory = each.group.partition(": ")
            count = round(sum(each.values))
            kinds.setdefault((each.player, each.dataset), []).extend(
                [(category, subcategory)] * count
            )
    binned: dict[str, dict[str, dict[str, float]]] = {"optimality": {}, "steps_to_go": {}}
    for (figure, dataset, _), values in samples.items():
        if figure in binned:
            bin_of, bins = BINNED[figure]
            binned[figure][dataset] = dict.fromkeys(bins, 0.0) | _shares(map(bin_of, values))
    for shares in binned["steps_to_go"].values():
        shares[AWAY] = sum(shares[name] for name in FARTHER_AWAY)
    return Reference(
        optimality=binned["optimality"],
        steps_to_go=binned["steps_to_go"],
        failures={
            dataset: _failure_shares(each)
            for (player, dataset), each in kinds.items()
            if player == REACT
        },
        repetitions={
            (dataset, group): values
            for (figure, dataset, group), values in samples.items()
            if figure == "repeated_transitions"
        },
        failure_kinds=kinds,
    )


def _failure_shares(kinds: Sequence[FailureKind]) -> dict[str, float]:
    """Return the per cent of each category, and of each category with its subcategory."""
    named = [f"{category}: {subcategory}" for category, subcategory in kinds]
    return _shares(category for category, _ in kinds) | _shares(named)


def _shares(names: Iterable[str]) -> dict[str, float]:
    counts = Counter(names)
    total = counts.total()
    return {name: 100 * count / total for name, count in counts.items()}
