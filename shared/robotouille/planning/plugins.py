"""Planners made for one kind of domain: what they offer, and how they are found.

Those in `BUILT_IN` are asked first, then those that installed distributions name under the entry
point group `robotouille.planners`, in the order of their names. The first that recognises a world
plans; if none does, or that one declines, the general planners do. A plug-in is imported when it
is first asked.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol

from robotouille.errors import PluginError
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits, SearchResult, Watch
from robotouille.world.world import State, World

__all__ = ["BUILT_IN", "GROUP", "AnytimeSearch", "DomainPlanner", "domain_planner"]

GROUP = "robotouille.planners"

BUILT_IN = {"kitchen": "robotouille.planners.kitchen.plugin:KITCHEN"}
"""Where the shipped plug-ins are, by name."""


class AnytimeSearch(Protocol):
    """A search from one state for all players of a world: a plan at once, then a better one."""

    def greedy(self, limits: Limits) -> SearchResult | None:
        """A plan at once, if there is a quick way to one; None leaves it to the beam search."""

    def improve(self, known: Plan | None, limits: Limits) -> SearchResult:
        """A better plan than the known one, or more proof, as far as the limits allow.

        Args:
            known: The shortest plan so far, by whatever planner; None if there is none.
        """


class DomainPlanner(Protocol):
    """A planner made for one kind of domain.

    With None it declines a state, a goal or a size that it does not model. What it answers is the
    same for the same arguments, unless `limits.stop` intervenes.
    """

    def recognises(self, world: World) -> bool:
        """Whether a world's domain is of this kind, judged by its definitions."""

    def solve(
        self, world: World, start: State, limits: Limits, watch: Watch | None
    ) -> SearchResult | None:
        """The shortest plan of all players together, or the best plan and bound within limits.

        Args:
            start: A state of the world, initial or not.
            watch: To be called now and then.

        Returns:
            None where it declines.
        """

    def anytime(self, world: World, start: State) -> AnytimeSearch | None:
        """A search for play, where plans matter more than proofs; None where it declines."""


def domain_planner(world: World) -> DomainPlanner | None:
    """The first plug-in that recognises a world. Raises PluginError."""
    return next((planner for planner in _planners() if planner.recognises(world)), None)


def _planners() -> Iterator[DomainPlanner]:
    for name, target in BUILT_IN.items():
        yield _load(EntryPoint(name, target, GROUP))
    for entry in _installed():
        yield _load(entry)


@cache
def _installed() -> tuple[EntryPoint, ...]:
    return tuple(sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)))


@cache
def _load(entry: EntryPoint) -> DomainPlanner:
    try:
        planner: DomainPlanner = entry.load()
    except Exception as error:  # whatever the import of somebody else's module may raise
        why = f"{type(error).__name__}: {error}"
        raise PluginError(GROUP, entry.name, entry.value, why) from error
    methods = ("recognises", "solve", "anytime")
    missing = [name for name in methods if not callable(getattr(planner, name, None))]
    if missing:
        raise PluginError(GROUP, entry.name, entry.value, f"it has no {' and no '.join(missing)}")
    return planner
