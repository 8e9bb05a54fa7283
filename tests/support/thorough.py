"""Number of examples in property tests, scaled by ROBOTOUILLE_FUZZ=FACTOR."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

__all__ = ["FACTOR", "STRIDE", "thorough"]

FACTOR = float(os.environ.get("ROBOTOUILLE_FUZZ", "1"))
"""Factor for the number of examples."""

STRIDE = max(1, round(1 / FACTOR)) | 1
"""Distance of the bits that tests flip in a file: 1, unless the factor asks for fewer. It is odd,
so that the position within the byte varies."""


def thorough(examples: int, **more: int) -> settings:
    """Return settings for this many examples, which are fixed unless the factor exceeds 1."""
    return settings(
        max_examples=max(1, int(examples * FACTOR)),
        derandomize=FACTOR <= 1,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        **more,
    )
