"""Plug-ins from entry points: their order, and errors if they cannot be loaded."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robotouille import World
from robotouille.errors import PluginError
from robotouille.planning import plugins
from robotouille.planning.plan import Limits, Proof, replay
from robotouille.planning.solvers import AnytimePlanner, solve

WORKSHOP_PLANNER = '''
"""A planner for workshops. It knows one plan by heart."""


from robotouille.certification.step_limit import plan_beside
from robotouille.planning.plan import Proof, SearchResult


class WorkshopSearch:
    def __init__(self, world):
        self.plan = plan_beside(world)

    def greedy(self, limits):
        return SearchResult(self.plan, 0, Proof.NONE, "workshop 1", 0)

    def improve(self, known, limits):
        return SearchResult(known, 5, Proof.EXTERNAL, "workshop 1", 1)


class WorkshopPlanner:
    def recognises(self, world):
        return any(action.name == "dispense" for action in world.task.domain.action_defs)

    def solve(self, world, start, limits, watch):
        search = self.anytime(world, start)
        return None if search is None else search.improve(search.plan, limits)

    def anytime(self, world, start):
        return WorkshopSearch(world) if start is world.initial else None


WORKSHOP = WorkshopPlanner()
'''


Install = Callable[[str, str], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Install a distribution with an entry point and a module."""

    def write(target: str, source: str) -> None:
        (tmp_path / "workshop_planner.py").write_text(source)
        info = tmp_path / "workshop_planner-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: workshop\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{plugins.GROUP}]\nworkshop = {target}\n")

    plugins._installed.cache_clear()
    plugins._load.cache_clear()
    monkeypatch.syspath_prepend(tmp_path)
    yield write
    plugins._installed.cache_clear()
    plugins._load.cache_clear()
    sys.modules.pop("workshop_planner", None)


def test_installed_plugin_plans_for_its_domain(install: Install) -> None:
    install("workshop_planner:WORKSHOP", WORKSHOP_PLANNER)
    world = World("workshop/01")
    found = solve(world)
    assert (found.planner, found.bound, found.proof) == ("workshop 1", 5, Proof.EXTERNAL)
    assert found.plan is not None
    assert replay(found.plan, world).ok
    first, second = AnytimePlanner(world).search(world.initial)
    assert (first.planner, first.bound) == ("workshop 1", 0)
    assert (second.planner, second.bound) == ("workshop 1", 5)


@pytest.mark.slow
def test_declined_states_go_to_the_general_planners(install: Install) -> None:
    install("workshop_planner:WORKSHOP", WORKSHOP_PLANNER)
    world = World("workshop/01")
    later = world.successor(world.initial, world.initial.actions(world.players[0])[0])
    assert solve(world, later, limits=Limits(expansions=1)).planner == "general 1"
    (result,) = AnytimePlanner(world).search(later)
    assert result.planner == "beam 1"


def test_general_planners_plan_without_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "BUILT_IN", {})
    world = World("synchronous/01")
    found = solve(world)
    assert (found.planner, len(found.plan or ()), found.optimal) == ("general 1", 8, True)
    (result,) = AnytimePlanner(world).search(world.initial)
    assert result.planner == "beam 1"
    assert result.plan is not None
    assert replay(result.plan, world).ok


def test_built_in_plugin_comes_first(install: Install) -> None:
    install("workshop_planner:WORKSHOP", WORKSHOP_PLANNER)
    assert solve(World("synchronous/01")).planner == "kitchen A* 3"


@pytest.mark.parametrize(
    ("target", "source", "why"),
    [
        ("workshop_planner:WORKSHOP", "import no_such_module", "No module named 'no_such_module'"),
        ("workshop_planner:NOTHING", WORKSHOP_PLANNER, "has no attribute 'NOTHING'"),
        (
            "workshop_planner:plan_beside",
            WORKSHOP_PLANNER,
            "it has no recognises and no solve and no anytime",
        ),
    ],
)
def test_broken_plugin_is_named(install: Install, target: str, source: str, why: str) -> None:
    install(target, source)
    with pytest.raises(PluginError, match=why) as caught:
        solve(World("workshop/01"))
    assert caught.value.name == "workshop"
    assert f"'workshop' ({target}) of robotouille.planners" in str(caught.value)
