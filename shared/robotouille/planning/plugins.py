"""Plug-ins: planners for particular kinds of domains (docs/planners.md, "Add a planner")."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol

from robotouille.errors import PluginError
from robotouille.planning.plan import Limits, Plan, SearchResult, Watch
from robotouille.world.world import State, World

GROUP = "robotouille.planners"


BUILT_IN = {"kitchen": "robotouille.planning.kitchen.plugin:KITCHEN"}
"""Import paths of the built-in plug-ins by name."""


class AnytimeSearch(Protocol):
    """A search from one state for all players of a world: first any plan, then better ones."""

    def greedy(self, limits: Limits) -> SearchResult | None:
        """Return a plan found quickly, or None to leave it to the beam search."""

    def improve(self, known: Plan | None, limits: Limits) -> SearchResult:
        """Return a better plan or a better bound within the limits.

        Args:
            known: The shortest plan so far of any planner, or None.
        """


class DomainPlanner(Protocol):
    """A planner for one kind of domain.

    Methods return None to decline a state, goal or size that the planner does not support. Equal
    arguments must give equal results, unless `limits.stop` ends the search.
    """

    def recognises(self, world: World) -> bool:
        """Return whether a world's domain is of this kind, judging by its definitions."""

    def solve(
        self, world: World, start: State, limits: Limits, watch: Watch | None
    ) -> SearchResult | None:
        """Return the shortest plan of all players, the best plan and bound, or None to decline.

        Args:
            start: A state of the world, initial or later.
            watch: A callback to call regularly.
        """

    def anytime(self, world: World, start: State) -> AnytimeSearch | None:
        """Return a search for play, which prefers plans to proofs, or None to decline."""


def domain_planner(world: World) -> DomainPlanner | None:
    """Return the first plug-in that recognises a world, or None.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
    """
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
    except Exception as error:  # Importing a plug-in can raise anything.
        why = f"{type(error).__name__}: {error}"
        raise PluginError(GROUP, entry.name, entry.value, why) from error
    methods = ("recognises", "solve", "anytime")
    missing = [name for name in methods if not callable(getattr(planner, name, None))]
    if missing:
        raise PluginError(GROUP, entry.name, entry.value, f"it has no {' and no '.join(missing)}")
    return planner
