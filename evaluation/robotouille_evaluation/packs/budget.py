"""Step budgets, which limit the length of an episode."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

BudgetKind = Literal["published", "own", "shift"]

MULTIPLIER = 1.5
"""Factor of the optimum (paper, section 4)."""


@dataclass(frozen=True, slots=True)
class Budget:
    """Limit of steps, which may be a fraction such as 31.5.

    Results under budgets of different kinds are not comparable, so results name the kind.
    """

    kind: BudgetKind
    optimal: int
    steps: float

    @property
    def max_steps(self) -> int:
        """Most steps that are taken: 32 for a limit of 31.5."""
        return math.ceil(self.steps)


def published_budget(constant: int, multiplier: float = MULTIPLIER) -> Budget:
    """Return the published budget: one constant per task for all layouts, without rounding."""
    return Budget("published", constant, constant * multiplier)


def own_budget(optimal: int) -> Budget:
    """Return the budget for the length of an instance's shortest known plan."""
    return Budget("own", optimal, optimal * MULTIPLIER)


def shift_budget(steps: int) -> Budget:
    """Return the budget of a shift, which is its length."""
    return Budget("shift", steps, steps)
