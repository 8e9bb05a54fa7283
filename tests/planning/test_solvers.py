"""One question, one kind of answer, by whichever search."""

from __future__ import annotations

import pytest

from robotouille import World, WrongArgumentError
from robotouille.planning import Limits, Proof, Search, SearchResult, replay, solve

ONE, TEAM = World("synchronous/01"), World("multi_agent/01@2")


@pytest.mark.parametrize("search", list(Search))
@pytest.mark.parametrize("world", [ONE, TEAM], ids=["one", "team"])
def test_every_search_answers_alike(world: World, search: Search) -> None:
    result = solve(world, search=search, limits=Limits(expansions=300))
    assert isinstance(result, SearchResult)
    assert result.plan is not None and result.length == len(result.plan)
    assert replay(result.plan, world).ok
    assert 0 <= result.bound <= result.length
    assert result.gap == result.length - result.bound
    assert result.planner


def test_beam_search_proves_nothing_and_the_optimal_one_all() -> None:
    assert solve(ONE, search="beam").proof is Proof.NONE
    assert solve(ONE).optimal
    assert solve(ONE, search="optimal") == solve(ONE)


def test_a_plan_from_the_middle() -> None:
    plan = solve(ONE).plan
    assert plan is not None
    state = ONE.initial.step(plan.steps[0]).state
    for search in Search:
        assert solve(ONE, state, search=search).length == 7


def test_what_is_no_search() -> None:
    with pytest.raises(WrongArgumentError, match="'optimal', 'anytime', 'beam', found 'fast'"):
        solve(ONE, search="fast")


def test_no_plan_has_no_length() -> None:
    assert SearchResult(None, 3, Proof.NONE, "nobody", 0).length is None
