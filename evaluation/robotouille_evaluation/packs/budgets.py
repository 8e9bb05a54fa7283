"""How many steps a run may take: as published, or by the instance's own optimum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["MULTIPLIER", "Budget", "BudgetKind", "own_budget", "published_budget"]

BudgetKind = Literal["published", "own"]

MULTIPLIER = 1.5
"""Of the optimum (paper, section 4)."""


@dataclass(frozen=True, slots=True)
class Budget:
    """A limit of steps; a run goes on while fewer are taken than `steps`, which may be 31.5.

    `kind` belongs beside every result: numbers under different budgets do not compare.
    """

    kind: BudgetKind
    optimal: int
    steps: float

    @property
    def max_steps(self) -> int:
        """The steps that are taken at most: 32 of 31.5."""
        return math.ceil(self.steps)


def published_budget(constant: int, multiplier: float = MULTIPLIER) -> Budget:
    """The published limit: one constant a task, whatever the layout, and no rounding."""
    return Budget("published", constant, constant * multiplier)


def own_budget(optimal: int, multiplier: float = MULTIPLIER) -> Budget:
    """The limit by the length of the shortest plan known of the instance."""
    return Budget("own", optimal, optimal * multiplier)
