"""Speed at which a game is shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robotouille.episode import Clock

SLOWEST, FASTEST = 1e-4, 1e4
"""Step rates that can be shown. The rules also allow rates outside these limits."""
DEFAULT_RATE = 5.0
"""Steps a second at which games are replayed whose steps waited for decisions."""


def real_time_rate(rules: Mapping[str, Any]) -> float | None:
    """Return the steps per second of a real-time game.

    Return None if steps wait for decisions, or if the rate cannot be shown.
    """
    rate = rules.get("step_rate") if rules.get("clock") == Clock.REALTIME else None
    if isinstance(rate, int | float) and SLOWEST <= rate <= FASTEST:
        return float(rate)
    return None


def recorded_rate(rules: Mapping[str, Any]) -> float:
    """Return the steps a second of a game's clock, or the default."""
    return real_time_rate(rules) or DEFAULT_RATE
