"""Plan files, and one interface for all searches."""

from __future__ import annotations

import pytest

from robotouille import FileError, World, WrongArgumentError
from robotouille.errors import MAX_FAULTS
from robotouille.planning import Limits, Proof, Search, SearchResult, replay, solve
from robotouille.planning.plan import read_plan
from tests.support.samples import quick_sample

WORLD = World("synchronous/01")
FIRST = str(WORLD.initial.actions("robot1")[0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mvoe(robot1, table1, table2)", "did you mean 'move'"),
        ("move(robot1, table1)", "takes"),
        ("move(robot1, tabel1, table2)", "did you mean 'table1'"),
        ("move(table1, table1, table2)", "is a station"),
        ("move robot1 table1 table2", "expected an action like"),
        (f"{FIRST}\n\n{FIRST}; jump()", "line 3"),
        ("# task: synchronous/02_lettuce_sandwich@1\n-", "synchronous/02"),
    ],
)
def test_faults_are_named(text: str, words: str) -> None:
    with pytest.raises(FileError) as error:
        read_plan(text, WORLD, "my.plan")
    assert words in str(error.value)
    assert "my.plan" in str(error.value)


def test_dash_is_a_step_without_actions() -> None:
    plan = read_plan(f"-\n{FIRST}\n-\n", WORLD)
    assert [len(step) for step in plan] == [0, 1, 0]


ONE, TEAM = World("synchronous/01"), World("multi_agent/01@2")


@pytest.mark.parametrize("search", list(Search))
@pytest.mark.parametrize("world", quick_sample([ONE, TEAM]), ids=["one", "team"])
def test_all_searches_return_valid_plans(world: World, search: Search) -> None:
    result = solve(world, search=search, limits=Limits(expansions=300))
    assert isinstance(result, SearchResult)
    assert result.plan is not None and result.length == len(result.plan)
    assert replay(result.plan, world).ok
    assert 0 <= result.bound <= result.length
    assert result.gap == result.length - result.bound
    assert result.planner


def test_only_optimal_search_gives_a_proof() -> None:
    assert solve(ONE, search="beam").proof is Proof.NONE
    assert solve(ONE).optimal
    assert solve(ONE, search="optimal") == solve(ONE)


def test_plan_from_a_later_state() -> None:
    plan = solve(ONE).plan
    assert plan is not None
    state = ONE.initial.step(plan.steps[0]).state
    for search in Search:
        assert solve(ONE, state, search=search).length == 7


def test_unknown_search_is_rejected() -> None:
    with pytest.raises(WrongArgumentError, match="'optimal', 'anytime', 'beam', found 'fast'"):
        solve(ONE, search="fast")


def test_reading_stops_after_many_faults() -> None:
    """Each fault is compared with all names, so a file of a million would take an hour."""
    with pytest.raises(FileError) as refused:
        read_plan("mvoe(robot1)\n" * (MAX_FAULTS + 50), WORLD)
    assert len(refused.value.faults) == MAX_FAULTS + 1
    assert str(refused.value.faults[-1]) == "more than 1,000 faults"
