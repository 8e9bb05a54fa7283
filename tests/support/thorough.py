"""How many examples the property tests try: more or fewer with ROBOTOUILLE_FUZZ=FACTOR."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

__all__ = ["FACTOR", "thorough"]

FACTOR = float(os.environ.get("ROBOTOUILLE_FUZZ", "1"))
"""How many times as many examples property tests try."""


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
