"""Bins of the published histograms. A bin contains its lower bound: 1 is in `1 to 1.5`."""

from __future__ import annotations

from robotouille_evaluation.metrics.rows import EpisodeMeasures

OPTIMALITY_BINS = ("1", "1 to 1.25", "1.25 to 1.5", "more than 1.5")
"""The published histogram ends at 1.5, which its last bin contains."""
STEPS_TO_GO_BINS = ("below 0.5", "0.5 to 1", "1 to 1.5", "1.5 or more", "out of reach")
FARTHER_AWAY, AWAY = STEPS_TO_GO_BINS[2:4], "1 or more"
"""Bins that the paper's text adds up, and their sum."""


def optimality_bin(rate: float) -> str:
    """Return the bin of steps taken / fewest steps."""
    one, low, middle, high = OPTIMALITY_BINS
    if rate < 1.25:
        return one if rate <= 1 else low
    return middle if rate <= 1.5 else high


def steps_to_go_bin(share: float) -> str:
    """Return the bin of steps to go / fewest steps."""
    near, little, away, far, _ = STEPS_TO_GO_BINS
    if share < 1:
        return near if share < 0.5 else little
    return away if share < 1.5 else far


def bin_of_steps_to_go(measures: EpisodeMeasures) -> str | None:
    """Return the bin in the paper's histogram, or None if the bounds fall into different bins."""
    if measures.out_of_reach:
        return "out of reach"
    least, most = measures.to_go_least, measures.to_go_most
    if least is None or most is None:
        return None
    found = {steps_to_go_bin(least), steps_to_go_bin(most)}
    return found.pop() if len(found) == 1 else None
