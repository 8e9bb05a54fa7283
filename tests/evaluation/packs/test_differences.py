"""Differences between packs: paired tasks, goals and tables."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robotouille.domain.schema import GoalTerm, ProblemFile
from robotouille_evaluation.packs import differences
from robotouille_evaluation.packs.differences import (
    Difference,
    compare_packs,
    goal_conditions,
    markdown_tables,
    match_tasks,
    same_goal,
)
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack, PackTask
from robotouille_evaluation.packs.published_checkout import read_checkout
from tests.support.checkouts import PROBLEM, write_checkout
from tests.support.published import CHECKOUT, NEEDED

pytest.importorskip("yaml")


@pytest.fixture
def pack(tmp_path: Path) -> Pack:
    return read_checkout(write_checkout(tmp_path / "checkout"), seeds=[42]).pack


def changed(pack: Pack, **fields: Any) -> Pack:
    """Return the pack with other fields in its problem."""
    problem = json.dumps({**json.loads(pack.tasks[0].problem), **fields})
    return replace(pack, tasks=(replace(pack.tasks[0], problem=problem),))


def goal(*terms: tuple[str, str, list[int]]) -> tuple[GoalTerm, ...]:
    return tuple(
        GoalTerm(predicate=predicate, args=tuple(args.split()), ids=tuple(ids))
        for predicate, args, ids in terms
    )


STACK = goal(("atop", "bread cheese", [1, 2]), ("atop", "cheese bread", [2, 3]))


def test_goals_are_equal_apart_from_numbers_and_order() -> None:
    other = goal(("atop", "cheese bread", [7, 5]), ("atop", "bread cheese", [9, 7]))
    assert same_goal(STACK, other)


@pytest.mark.parametrize(
    "other",
    [
        goal(("atop", "bread cheese", [1, 2]), ("atop", "cheese bread", [2, 1])),
        goal(("atop", "bread cheese", [1, 2]), ("atop", "cheese bread", [3, 4])),
        goal(("atop", "bread cheese", [1, 2])),
        (*STACK, *goal(("iscut", "cheese", [2]))),
    ],
)
def test_different_goals(other: tuple[GoalTerm, ...]) -> None:
    assert not same_goal(STACK, other)


def test_conditions_number_repeated_kinds() -> None:
    problem = ProblemFile.model_validate({**PROBLEM, "goal": list(STACK)})
    assert goal_conditions(problem) == ["atop(bread1, cheese)", "atop(cheese, bread2)"]


def test_tasks_are_paired_by_dish() -> None:
    def tasks(*names: str) -> Pack:
        made = tuple(PackTask(name, name.partition("/")[0], "{}", None, "") for name in names)
        return Pack("x", "1", "{}", made, ())

    found = match_tasks(
        tasks("synchronous/01_cheese_sandwich", "synchronous/02_lettuce_sandwich", "team/3_soup"),
        tasks("synchronous/1_lettuce_sandwich", "synchronous/0_cheese_sandwich", "other/3_soup"),
    )
    assert [(a and a.name, b and b.name) for a, b in found] == [
        ("synchronous/01_cheese_sandwich", "synchronous/0_cheese_sandwich"),
        ("synchronous/02_lettuce_sandwich", "synchronous/1_lettuce_sandwich"),
        ("team/3_soup", None),
        (None, "other/3_soup"),
    ]


def test_pack_equals_itself(pack: Pack) -> None:
    assert compare_packs(pack, pack).none


@pytest.mark.parametrize(
    ("fields", "difference"),
    [
        ({"width": 7}, Difference("grid", "5 × 5", "7 × 5")),
        ({"goal_description": "Toast!"}, Difference("words", "Put cheese on bread", "Toast!")),
        (
            {"stations": [{"name": "table", "x": x, "y": 1} for x in range(3)]},
            Difference("stations", "4 table", "3 table"),
        ),
        (
            {"goal": [{"predicate": "atop", "args": ["bread", "cheese"], "ids": [1, 2]}]},
            Difference("goal", "atop(cheese, bread)", "atop(bread, cheese)"),
        ),
        ({"players": [*PROBLEM["players"]] * 2}, Difference("players", "1", "2")),  # type: ignore[misc]
    ],
)
def test_differences_of_a_task(pack: Pack, fields: dict[str, Any], difference: Difference) -> None:
    found = compare_packs(pack, changed(pack, **fields))
    assert found.tasks[0].differences == (difference,)
    assert not found.none
    assert difference.b in markdown_tables(found)


def test_other_constants_change_the_budget(pack: Pack) -> None:
    other = replace(pack, tasks=(replace(pack.tasks[0], optimal=7),))
    assert compare_packs(pack, other).tasks[0].differences == (
        Difference("optimum", "5", "7"),
        Difference("budget", "8", "11"),
    )


def test_words_of_the_domain(pack: Pack) -> None:
    domain = pack.domain.replace("Do nothing", "Wait")
    found = compare_packs(pack, replace(pack, domain=domain))
    assert found.wording == (Difference("action wait", "Do nothing", "Wait"),)


def test_markdown_cells_are_escaped(pack: Pack) -> None:
    found = compare_packs(pack, changed(pack, goal_description="a|b\n[c]"))
    line = next(line for line in markdown_tables(found).splitlines() if "words" in line)
    assert line.endswith("| a\\|b\N{REPLACEMENT CHARACTER}\\[c\\] |")


@NEEDED
def test_published_tasks_have_counterparts() -> None:
    published = read_checkout(CHECKOUT, seeds=[]).pack
    pairs = {b.name: a for a, b in match_tasks(build_own_pack(), published) if b is not None}
    for name, ours in pairs.items():
        dataset, _, task = name.partition("/")
        number = task.partition("_")[0]
        if number.isdigit() and not dataset.endswith("_train"):
            first = 0 if dataset == "multi_agent" else 1
            assert ours is not None
            assert ours.name.startswith(f"{dataset}/{int(number) + first:02}_")


def test_very_many_tasks_are_paired_by_name_only(monkeypatch: pytest.MonkeyPatch) -> None:
    own = build_own_pack()
    other = replace(own.tasks[0], name=f"{own.tasks[0].name}_2")
    changed = replace(own, tasks=(other, *own.tasks[1:]))
    assert match_tasks(own, changed)[0] == (own.tasks[0], other)
    monkeypatch.setattr(differences, "MAX_PAIRS", 10)
    pairs = match_tasks(own, changed)
    assert pairs[0] == (own.tasks[0], None)
    assert pairs[1] == (own.tasks[1], own.tasks[1])
    assert pairs[-1] == (None, other)


@pytest.mark.slow
def test_goals_of_long_chains_are_compared() -> None:
    """Each of the thousand objects was compared with all conditions in a thousand rounds."""
    chain = goal(*(("atop", "bread bread", [i, i + 1]) for i in range(300)))
    assert same_goal(chain, tuple(reversed(chain)))
    assert not same_goal(chain, goal(*(("atop", "bread bread", [i, i]) for i in range(300))))
