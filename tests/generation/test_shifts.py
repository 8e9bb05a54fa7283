"""Generated shifts: valid files with other kitchens, menus and orders that bots can serve."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille import Task, World, load_task
from robotouille.domain.schema import Arrival, ProblemFile
from robotouille.generation import GenerationError, generator_of
from robotouille.generation.shifts import stars_of
from robotouille.planning.policies.shift_policy import play_shift
from robotouille_client.cli.main import app
from tests.support.shifts import file_of


def short(folder: Path, **changes: Any) -> str:
    """Write a shift of 40 steps for one player, and return its path."""
    path = folder / "short.json"
    path.write_text(json.dumps(file_of(steps=40, **changes) | {"seats": [1]}))
    return str(path)


def called(*words: str) -> Result:
    return CliRunner().invoke(app, ["generate", *words])


def stored(problem: ProblemFile) -> Counter[tuple[str, int, str]]:
    """Return the kinds of things with their levels and the kinds of their stations."""
    stations = {(s.x, s.y): s.name for s in problem.objects["station"]}
    return Counter(
        (thing.name, thing.stack_level or 0, stations[thing.x, thing.y])
        for thing in problem.objects["item"]
    )


@pytest.mark.slow
def test_kitchen_menu_and_orders_change_with_the_seed(tmp_path: Path) -> None:
    original = load_task(short(tmp_path))
    drawn = [generator_of(original).draw(seed) for seed in range(1, 7)]
    assert len({each.text for each in drawn}) == len(drawn)
    assert original.problem.shift is not None
    menus = set()
    for problem in (each.task.problem for each in drawn):
        assert stored(problem) == stored(original.problem)
        assert problem.shift is not None
        menu = problem.shift.menu
        assert menu.items() <= original.problem.shift.menu.items()
        orders = [each for each in problem.shift.arrivals if isinstance(each, Arrival)]
        assert {order.dish for order in orders} <= menu.keys()
        assert all(order.at < 40 for order in orders)
        menus.add(tuple(menu))
    assert len(menus) > 1


@pytest.mark.slow
def test_seed_has_one_valid_file_with_the_points_of_planner_bots(tmp_path: Path) -> None:
    words = [short(tmp_path), "--seed", "7"]
    result = called(*words, "--out", str(tmp_path / "new"))
    assert result.exit_code == 0, result.output
    assert "attempt 1; planner bots earn" in result.stdout
    (file,) = (tmp_path / "new").iterdir()
    linted = CliRunner().invoke(app, ["lint", str(file)])
    assert "no faults" in linted.stdout and "warning" not in linted.stdout
    task = load_task(str(file))
    assert task.problem.shift is not None
    points = task.problem.shift.planner
    _, last = play_shift(World(task))
    assert last.orders is not None
    assert last.orders.served >= 1
    assert points == {1: last.orders.score}
    assert task.problem.shift.stars == stars_of(points)
    # The command would refuse to replace another file.
    again = called(*words, "--out", str(tmp_path / "new"), "--json")
    assert json.loads(again.stdout)["points"] == {"1": last.orders.score}


def test_stars_are_shares_of_the_points_of_planner_bots() -> None:
    assert stars_of({2: 90, 1: 100}) == {1: (25, 48, 60), 2: (25, 48, 60)}
    assert stars_of({1: -5, 2: 33}) == {1: (1, 1, 1), 2: (9, 16, 20)}


def with_seed(path: Path, seed: int) -> Task:
    return load_task(str(path), seed=seed)


def test_orders_of_a_generated_shift_do_not_depend_on_the_seed_of_a_game(tmp_path: Path) -> None:
    path = tmp_path / "drawn.json"
    path.write_text(generator_of(load_task(short(tmp_path))).draw(3).text)
    assert with_seed(path, 0).digest == with_seed(path, 5).digest


@pytest.mark.slow
def test_shift_that_bots_cannot_serve_is_refused(tmp_path: Path) -> None:
    hasty = file_of()["shift"]["menu"]
    for dish in hasty.values():
        dish["patience"] = 2
    generator = generator_of(load_task(short(tmp_path, menu=hasty)), attempts=1)
    with pytest.raises(GenerationError, match="planner bots serve no order with 1 players"):
        generator.instance(42)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--kind", "noisy"], "kind: shifts/01_sandwich_bar is a shift, which has no plan to keep"),
        (["--min-steps", "5"], "min-steps: shifts/01_sandwich_bar is a shift"),
        (["--max-steps", "5"], "max-steps: shifts/01_sandwich_bar is a shift"),
        (["--held"], "held: everything begins on a station in a shift"),
    ],
)
def test_options_that_need_a_goal_are_refused(words: list[str], expected: str) -> None:
    result = called("shifts/01", *words)
    assert result.exit_code == 1
    assert expected in result.output


@pytest.mark.slow
def test_irrelevant_things_can_be_added(tmp_path: Path) -> None:
    generated = called(short(tmp_path), "--stations", "2", "--items", "1", "--out", "-")
    assert generated.exit_code == 0, generated.output
    more = ProblemFile.model_validate_json(generated.stdout)
    before = load_task(short(tmp_path)).problem
    for type_, count in (("station", 2), ("item", 1)):
        assert len(more.objects[type_]) == len(before.objects[type_]) + count
