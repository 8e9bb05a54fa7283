"""What a planner finds: a plan, a proven lower bound, and the kind of proof."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from robotouille.planning.plan import Plan

__all__ = ["UNLIMITED", "Limits", "Proof", "SearchResult", "Watch"]


class Proof(StrEnum):
    """Why a lower bound holds.

    `EXHAUSTED`: every state nearer than the bound was expanded or merged with an equal one.
    `HEURISTIC`: no state is left whose steps so far and admissible heuristic add up to less.
    `EXTERNAL`: an independent planner found the same length. `NONE`: there is no bound but 0.
    """

    EXHAUSTED = "exhausted search"
    HEURISTIC = "admissible heuristic"
    EXTERNAL = "external check"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Limits:
    """When to give up: after so many expansions, with so many states kept, or when `stop` says so.

    The first two are the same on every machine; `stop` (a timeout, an interrupt) is not. It is
    asked every few thousand expansions.
    """

    expansions: int | None = None
    states: int | None = None
    stop: Callable[[], bool] | None = None


UNLIMITED = Limits()
"""Never give up."""


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The best plan found (None if none), and a bound that every plan's length reaches.

    `unsolvable` says that it is proven that there is no plan at all. `planner` names the planner
    and its version.
    """

    plan: Plan | None
    bound: int
    proof: Proof
    planner: str
    expansions: int
    unsolvable: bool = False

    @property
    def length(self) -> int | None:
        """How many steps the plan takes; None without a plan."""
        return None if self.plan is None else len(self.plan)

    @property
    def optimal(self) -> bool:
        """Whether the plan is proven to be as short as any."""
        return self.plan is not None and self.bound >= len(self.plan)

    @property
    def gap(self) -> int | None:
        """Steps between the plan and the bound; None without a plan."""
        return None if self.plan is None else max(0, len(self.plan) - self.bound)


Watch = Callable[[int, int, int | None], None]
"""Called now and then during a search: expansions so far, bound, length of the best plan."""
