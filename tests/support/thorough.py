"""How many examples the property tests try: more or fewer with ROBOTOUILLE_FUZZ=FACTOR."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

__all__ = ["FACTOR", "STRIDE", "thorough"]

FACTOR = float(os.environ.get("ROBOTOUILLE_FUZZ", "1"))
"""How many times as many examples property tests try."""

STRIDE = max(1, round(1 / FACTOR)) | 1
"""Of all bits of a file each so-many-eth is flipped: every one, unless the factor asks for fewer.
Odd, so that it is another bit of a byte each time."""


def thorough(examples: int, **more: int) -> settings:
    """So many examples, always the same ones unless the factor asks for more."""
    return settings(
        max_examples=max(1, int(examples * FACTOR)),
        derandomize=FACTOR <= 1,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        **more,
    )
