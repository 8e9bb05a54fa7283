"""Published generator and kitchens without delays."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import World
from robotouille.errors import FileError
from robotouille.planning import replay
from robotouille_evaluation.packs.delay_free import delay_free
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.published_layouts import ObjectLayout, generate_layout
from robotouille_evaluation.packs.published_placement import PlacementGrid
from robotouille_evaluation.packs.store import read_pack, write_pack
from tests.support.published import CHECKOUT, NEEDED, PUBLISHED, published_problem, read
from tests.support.samples import quick_sample
from tests.support.thorough import thorough


def listed(folder: str) -> list[str]:
    index = PUBLISHED / folder / "index.json"
    return list(read(index)) if index.is_file() else []


def check_instance(folder: str, name: str, *, noisy: bool) -> None:
    row = read(PUBLISHED / folder / "index.json")[name]
    layout = generate_layout(published_problem(name.rpartition("_")[0]), row["seed"], noisy=noisy)
    assert layout.problem == read(PUBLISHED / folder / f"{name}.json")
    assert layout.seed_used == row["seed_used"]
    assert list(layout.errors) == row["retries"]


@NEEDED
@pytest.mark.parametrize("name", quick_sample(listed("instances"), quick=12))
def test_published_free_instances(name: str) -> None:
    check_instance("instances", name, noisy=False)


@NEEDED
@pytest.mark.parametrize("name", listed("instances_noisy"))
def test_published_noisy_instances(name: str) -> None:
    check_instance("instances_noisy", name, noisy=True)


def problem(
    width: int = 5, height: int = 5, *, stations: int = 3, items: int = 2, containers: int = 0
) -> dict[str, Any]:
    cells = [(x, y) for y in range(height) for x in range(width)]
    places = cells[width:] + cells[:width]
    kinds = ("table", "board", "stove")
    return {
        "version": "1.0.0",
        "width": width,
        "height": height,
        "stations": [
            {"name": kinds[i % 3], "x": x, "y": y}
            for i, (x, y) in zip(range(stations), places, strict=False)
        ],
        "items": [
            {"name": "lettuce", "x": x, "y": y, "stack-level": 0, "predicates": ["iscuttable"]}
            for _, (x, y) in zip(range(items), places, strict=False)
        ],
        "containers": [
            {"name": "pot", "x": x, "y": y}
            for _, (x, y) in zip(range(containers), places, strict=False)
        ],
        "players": [{"name": "robot", "x": 0, "y": 0, "direction": [0, 1]}],
        "goal_description": "",
        "goal": [],
    }


PROBLEMS = st.builds(
    problem,
    st.integers(2, 6),
    st.integers(2, 6),
    stations=st.integers(1, 8),
    items=st.integers(0, 6),
    containers=st.integers(0, 3),
)
ERRORS = {
    "No replaceable stations found",
    "Item force add failed",
    "Container force add failed",
    "No place for the groups found",
    "No player stands beside a station",
    "0",
}


def check_layout(raw: dict[str, Any], layout: ObjectLayout, *, noisy: bool) -> None:
    found = layout.problem
    own = Counter(thing["name"] for thing in raw["stations"])
    assert own <= Counter(thing["name"] for thing in found["stations"])
    own = Counter(thing["name"] for thing in (on_stations(raw) if noisy else raw["items"]))
    assert own <= Counter(thing["name"] for thing in found["items"])
    assert len(found["containers"]) == (0 if noisy else len(raw["containers"]))
    cells = [(thing["x"], thing["y"]) for thing in found["stations"]]
    assert len(set(cells)) == len(cells)
    (player,) = found["players"]
    stand = (player["x"], player["y"])
    floor = PlacementGrid(raw["width"], raw["height"])
    assert stand not in cells
    assert floor.reaches(cells, stand)
    faced = (stand[0] + player["direction"][0], stand[1] + player["direction"][1])
    assert faced == cells[0]
    if not noisy:
        places = [(t["x"], t["y"]) for t in (*found["items"], *found["containers"])]
        assert len(set(places)) == len(places)
        assert set(places) <= {*cells, stand}
        assert all(item["stack-level"] == 0 for item in found["items"])
    assert found["goal"] == raw["goal"]
    assert layout.seed_used == layout.seed + len(layout.errors)
    assert set(layout.errors) <= ERRORS


@pytest.mark.slow
@thorough(60)
@given(PROBLEMS, st.integers(0, 10_000))
def test_objects_are_kept_and_reachable(raw: dict[str, Any], seed: int) -> None:
    try:
        layout = generate_layout(raw, seed)
    except FileError as error:
        assert "no layout for the seeds" in str(error)
    else:
        check_layout(raw, layout, noisy=False)
        assert generate_layout(raw, seed) == layout


@thorough(25)
@given(
    st.builds(problem, st.integers(4, 6), st.integers(4, 6), stations=st.integers(1, 4)),
    st.integers(0, 10_000),
)
def test_noisy_layout_keeps_items_on_stations(raw: dict[str, Any], seed: int) -> None:
    layout = generate_layout(raw, seed, noisy=True)
    check_layout(raw, layout, noisy=True)
    stations = layout.problem["stations"][: len(raw["stations"])]
    origin = {(s["x"], s["y"]): i for i, s in enumerate(sorted_by_cell(raw["stations"]))}
    before = on_stations(raw)
    for old, new in zip(before, layout.problem["items"][: len(before)], strict=True):
        station = stations[origin[old["x"], old["y"]]]
        assert (new["x"], new["y"]) == (station["x"], station["y"])


def on_stations(raw: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the items on stations. Noisy layouts lose other items."""
    cells = {(station["x"], station["y"]) for station in raw["stations"]}
    return [item for item in sorted_by_cell(raw["items"]) if (item["x"], item["y"]) in cells]


def sorted_by_cell(things: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(things, key=lambda thing: (thing["x"], thing["y"]))


def test_noisy_layout_needs_a_player_at_a_station() -> None:
    raw = {**problem(), "players": [{"name": "robot", "x": 4, "y": 4, "direction": [0, 1]}]}
    with pytest.raises(FileError, match="No player stands beside a station"):
        generate_layout(raw, 42, noisy=True)


def test_held_items() -> None:
    raw = problem(items=1)
    raw["items"].append({"name": "egg", "x": 0, "y": 0, "stack-level": 0})
    found = generate_layout(raw, 42, noisy=True).problem
    assert [item["name"] for item in found["items"]][:2] == ["lettuce", "egg"]
    (player,), egg = found["players"], found["items"][1]
    cells = [(station["x"], station["y"]) for station in found["stations"]]
    assert (egg["x"], egg["y"]) not in cells
    assert (player["x"], player["y"]) not in cells


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 0}, "width: expected a number from 1 to 20, found 0"),
        ({"stations": []}, "stations: a problem without stations has no layouts"),
        ({"players": []}, "players: a problem without players has no layouts"),
        ({"items": [{"name": "egg"}]}, r"items\[0\]: expected an object with x and y"),
        ({"items": 3}, "items: expected a list of objects"),
    ],
)
def test_invalid_problems(change: dict[str, Any], words: str) -> None:
    with pytest.raises(FileError, match=words):
        generate_layout({**problem(), **change}, 42)


@pytest.mark.slow
@pytest.mark.parametrize("noisy", [False, True])
def test_too_small_grid_is_an_error(noisy: bool) -> None:
    """The published generator would never stop."""
    with pytest.raises(FileError, match="no layout for the seed"):
        generate_layout(problem(2, 1, stations=2), 42, noisy=noisy)


TASKS = ("asynchronous/01_cheese_chicken_sandwich", "asynchronous/06_potato_soup")


@cache
def packs() -> tuple[Pack, Pack]:
    own = build_own_pack()
    seen: list[tuple[int, int]] = []
    chosen = [i for i in own.instances if i.task in TASKS and i.kind == "default"]
    free = delay_free(own, chosen, lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]
    return own, free


def test_same_kitchens_with_shorter_plans() -> None:
    own, free = packs()
    assert free.digest != own.digest
    assert free.name == "ours-delay-free"
    assert [task.name for task in free.tasks] == list(TASKS)
    for instance in free.instances:
        before, after = World(own.load(instance.id)), World(free.load(instance))
        assert after.initial.fact_names() == before.initial.fact_names()
        assert after.task.goal_description == before.task.goal_description
        best, known = instance.best(), own.instance(instance.id).best()
        assert best is not None and known is not None and best.proven
        assert best.steps < known.steps
        assert replay(free.plan(instance, after), after).ok
        assert free.budget(instance, "own").optimal == best.steps


def test_plans_without_waiting() -> None:
    _, free = packs()
    for instance in free.instances:
        world = World(free.load(instance))
        state = world.initial
        for joint in free.plan(instance, world):
            state = state.step(list(joint)).state
            assert not [row for row in state.progress() if row.timed and row.running]


def test_delay_free_pack_is_stored(tmp_path: Path) -> None:
    _, free = packs()
    write_pack(free, tmp_path / "pack")
    assert read_pack(tmp_path / "pack", digest=free.digest) == free


@pytest.mark.slow
@NEEDED
def test_published_pack_without_delays() -> None:
    pack = read_checkout(CHECKOUT, seeds=()).pack
    chosen = [i for i in pack.instances if i.task == "asynchronous/0_cheese_chicken_sandwich"]
    (instance,) = delay_free(pack, chosen, lambda *_: None).instances
    best = instance.best()
    assert best is not None and best.proven
    assert any("cook" in line for line in best.plan) and "-" not in best.plan
