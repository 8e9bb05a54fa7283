"""Tasks by name and by file; kinds left open; files of the published dialect."""

import re
from pathlib import Path
from typing import Any

import pytest

from robotouille import FileError, Task, UnknownTaskError, World, load_task, task_names
from robotouille.installation import data_folder
from tests.support.broken_files import PROBLEM, published_domain, write
from tests.support.samples import quick_sample_per_folder


@pytest.mark.parametrize("name", task_names())
def test_every_shipped_task_loads(name: str) -> None:
    task = load_task(name)
    assert task.name == name
    assert task.goal_description
    for seats in task.problem.seats or ():
        world = World(load_task(f"{name}@{seats}"))
        assert len(world.players) == seats
        assert not world.initial.goal_reached
        assert all(world.initial.actions(player) for player in world.players)


@pytest.mark.parametrize("name", quick_sample_per_folder(task_names()))
def test_task_survives_conversion_to_json(name: str) -> None:
    task = load_task(name, timing="people")
    twin = Task.from_json(task.to_json())
    assert twin == task
    assert twin.digest == task.digest
    assert len(task.digest) == 32


@pytest.mark.parametrize(
    ("name", "full"),
    [
        ("synchronous/01_cheese_sandwich", "synchronous/01_cheese_sandwich"),
        ("synchronous/01", "synchronous/01_cheese_sandwich"),
        ("synchronous/1", "synchronous/01_cheese_sandwich"),
        (
            "synchronous/10",
            "synchronous/10_onion_cheese_burger_and_lettuce_tomato_chicken_sandwich",
        ),
        ("synchronous/cheese_s", "synchronous/01_cheese_sandwich"),
        ("workshop/02", "workshop/02_two_workers"),
        ("painted", "workshop/01_painted_gear"),
        ("potato_soup", "asynchronous/06_potato_soup"),
    ],
)
def test_names_can_be_abbreviated(name: str, full: str) -> None:
    assert load_task(name).name == full


@pytest.mark.parametrize("name", ["01", "synchronous/lettuce", "1", "s", "sync", "train"])
def test_ambiguous_names_raise_with_candidates(name: str) -> None:
    with pytest.raises(FileError, match=rf"{name}: is ambiguous: \d+ tasks match: \w+/\d+_"):
        load_task(name)


@pytest.mark.parametrize(
    "name",
    [
        "synchronous/1_cheese_sandwihc",
        "",
        "/",
        "synchronous/",
        "synchronous/11",
        "cooking/01",
        "../domains/robotouille",
        "nothing.json",
        "²",
        "synchronous/²",
        "synchronous/01@²",
        "synchronous/01@",
        "\0.json",
        "x" * 5000 + ".json",
        "9" * 5000,
        "synchronous/01@" + "9" * 5000,
    ],
)
def test_unknown_names(name: str) -> None:
    with pytest.raises(UnknownTaskError) as error:
        load_task(name)
    assert "`robotouille tasks` lists the tasks" in str(error.value)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("synchronous/1_cheese_sandwihc", "synchronous/01_cheese_sandwich"),
        ("asynchronus/01", "asynchronous/01"),
        ("asynchronus/1", "asynchronous/1"),
        ("asynchronus/10", "asynchronous/10"),
        ("synchronus/03", "synchronous/03"),
        ("multiagent/02", "multi_agent/02"),
    ],
)
def test_similar_name_is_suggested(name: str, meant: str) -> None:
    """A misspelt folder does not lead to another dish."""
    with pytest.raises(UnknownTaskError, match=f"did you mean '{meant}'") as error:
        load_task(name)
    assert error.value.name == name
    load_task(meant)


def test_seats() -> None:
    assert load_task("multi_agent/01").seats == 2
    assert load_task("multi_agent/01@3").seats == 3
    assert load_task("multi_agent/01", seats=4).seats == 4
    assert load_task("multi_agent/01@3").digest != load_task("multi_agent/01@4").digest
    for seats in (0, 1, 5):
        with pytest.raises(
            FileError,
            match="^multi_agent/01_lettuce_burger: seats: the task does not support "
            f"{seats} seats; possible: 2, 3, 4$",
        ):
            load_task(f"multi_agent/01@{seats}")


def test_unknown_timing() -> None:
    with pytest.raises(FileError, match="unknown profile 'fast'; possible: benchmark, people"):
        load_task("synchronous/01", timing="fast")


# Kinds left open


def open_problem(folder: Path) -> str:
    problem = {
        "width": 6,
        "height": 3,
        "stations": [
            {"name": "station", "x": 0, "y": 0},
            *({"name": "table", "x": x, "y": 0} for x in range(1, 6)),
        ],
        "items": [{"name": "item", "x": x, "y": 0} for x in range(1, 6)],
        "players": [{"name": "player", "x": 0, "y": 1, "direction": [0, -1]}],
        "goal": [{"predicate": "clear", "args": ["item"], "ids": [1]}],
    }
    return write(folder, "open.json", problem)


def kinds(task: Task) -> list[str]:
    return [o.name for o in (*task.problem.objects["item"], *task.problem.objects["station"])]


def test_seed_chooses_open_kinds(tmp_path: Path) -> None:
    name = open_problem(tmp_path)
    first = load_task(name, seed=7)
    assert kinds(first) == kinds(load_task(name, seed=7))
    assert first.digest == load_task(name, seed=7).digest
    several = {tuple(kinds(load_task(name, seed=seed))) for seed in range(20)}
    assert len(several) > 10
    assert not {kind for found in several for kind in found} & {"item", "station"}
    assert World(first).players == ("robot1",)


def test_choices_of_a_seed_never_change(tmp_path: Path) -> None:
    """Recordings and benchmarks refer to tasks by seed."""
    assert kinds(load_task(open_problem(tmp_path), seed=42))[:5] == [
        "bottombun",
        "lettuce",
        "chicken",
        "chicken",
        "cheese",
    ]


# The published dialect


def published_problem() -> dict[str, Any]:
    return {
        "version": "1.0.0",
        "width": 4,
        "height": 3,
        "config": {"cook_time": {"patty": 1, "default": 4}},
        "flooring": {"tiles": [[0] * 4] * 3},
        "furniture": None,
        "stations": [{"name": "stove", "x": 0, "y": 0}, {"name": "table", "x": 3, "y": 0}],
        "items": [
            {"name": "patty", "x": 0, "y": 0, "stack-level": 0, "predicates": []},
            {"name": "patty", "x": 3, "y": 0, "stack-level": 1, "meal_id": 1},
            {"name": "patty", "x": 3, "y": 0, "stack-level": 0},
        ],
        "containers": [],
        "meals": [],
        "players": [{"name": "robot", "x": 0, "y": 1, "direction": [0, -1]}],
        "goal_description": "Cook a patty.",
        "goal": [{"predicate": "iscooked", "args": ["patty"], "ids": ["1"]}],
    }


def published(folder: Path, **changes: Any) -> World:
    domain = write(folder, "domain.json", published_domain())
    problem = {**published_problem(), "goal": [], **changes}
    return World(load_task(write(folder, "problem.json", problem), domain=domain))


def test_marks_of_the_published_generator_are_dropped(tmp_path: Path) -> None:
    """The generator's raw output has marks; without them, the task is the same."""
    marked = published_problem()
    for thing in (*marked["stations"], *marked["items"]):
        thing.update(force_add=True, frozen=False)
    raw = published(tmp_path, stations=marked["stations"], items=marked["items"])
    assert raw.task.digest == published(tmp_path).task.digest


def test_published_files_get_defaults(tmp_path: Path) -> None:
    world = published(tmp_path)
    assert set(world.initial.fact_names()) >= {
        "loc(robot1, stove1)",
        "item_on(patty1, stove1)",
        "item_on(patty3, table1)",
        "item_at(patty2, table1)",
        "atop(patty2, patty3)",
        "clear(patty2)",
        "clear(patty1)",
        "vacant(table1)",
        "nothing(robot1)",
    }
    assert "station_empty(table1)" not in world.initial.fact_names()
    cook = world.parse(world.initial, "robot1", "Cook patty1 on stove1 using robot1")
    state = world.initial.step(cook).state
    assert not state.holds("iscooked", "patty1")
    assert state.step([]).state.holds("iscooked", "patty1")


@pytest.mark.parametrize(
    ("version", "upper"), [("1.0.0", "patty2"), ("1.2", "patty2"), ("2.0", "patty3")]
)
def test_objects_of_published_problems_are_numbered_as_listed(
    version: str, upper: str, tmp_path: Path
) -> None:
    """On one tile, the published simulator numbers in the file's order."""
    world = published(tmp_path, version=version)
    assert f"clear({upper})" in world.initial.fact_names()


def test_published_numbers_count_each_kind_and_type_by_place(tmp_path: Path) -> None:
    items = [
        {"name": "patty", "x": 3, "y": 0, "stack-level": 2},
        {"name": "bun", "x": 3, "y": 0, "stack-level": 1},
        {"name": "patty", "x": 0, "y": 0},
        {"name": "patty", "x": 3, "y": 0, "stack-level": 0},
        {"name": "bun", "x": 1, "y": 1},
    ]
    world = published(tmp_path, items=items)
    assert [o.name for o in world.placed if o.type == "item"] == [
        "patty1", "bun1", "patty2", "bun2", "patty3",
    ]  # fmt: skip
    assert {f for f in world.initial.fact_names() if f.startswith("atop")} == {
        "atop(bun2, patty3)",
        "atop(patty2, bun2)",
    }


def test_published_goals_can_have_string_ids(tmp_path: Path) -> None:
    items = [{"name": "patty", "x": 0, "y": 0, "id": "1"}]
    goal = published_problem()["goal"]
    world = published(tmp_path, items=items, goal=goal)
    cook = world.parse(world.initial, "robot1", "Cook patty1 on stove1 using robot1")
    assert world.initial.step(cook).state.step([]).goal_reached
    with pytest.raises(FileError, match="no object has the id '1'"):
        published(tmp_path, goal=goal)


@pytest.mark.parametrize("name", ["synchronous/01", "asynchronous/10", "multi_agent/01@3"])
def test_task_lists_its_instances_by_seed(name: str) -> None:
    task = load_task(name)
    instances = task.instances()
    assert set(instances) <= set(task_names(generated=True))
    seeds = [int(instance.rpartition("_s")[2]) for instance in instances]
    assert seeds == sorted(seeds)
    assert len(set(seeds)) >= 10
    assert load_task(instances[0], seats=task.seats).problem.goal == task.problem.goal
    assert load_task(instances[0]).instances() == ()


def test_every_generated_instance_belongs_to_a_task() -> None:
    known = {name for task in task_names() for name in load_task(task).instances()}
    assert known == set(task_names(generated=True)) - set(task_names())


@pytest.mark.parametrize("name", ["wafle", "waffle", "waffle.jsn", "Waffle.JSON", "wafle.json"])
def test_similar_file_in_the_folder_is_suggested(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for file in ("waffle.json", "brunch.json"):
        write(tmp_path, file, PROBLEM)
    with pytest.raises(UnknownTaskError, match=r"; did you mean 'waffle\.json'\?"):
        load_task(name)
    with pytest.raises(UnknownTaskError, match=re.escape(f"{tmp_path}/waffle.json'?")):
        load_task(str(tmp_path / name))
    with pytest.raises(UnknownTaskError) as found:
        load_task(name, files=False)
    assert "waffle.json'?" not in str(found.value), "a server's folder is nobody's business"


@pytest.mark.parametrize(
    ("what", "file"),
    [
        ("a domain", "domains/diner.json"),
        ("a domain", "domains/robotouille.json"),
        ("an input file", "domains/diner.input.json"),
        ("a rendering", "renderings/diner.json"),
    ],
)
def test_other_kind_of_file_is_reported_in_one_line(what: str, file: str) -> None:
    folder, _, name = file.partition("/")
    with pytest.raises(FileError) as found:
        load_task(str(data_folder(folder) / name))
    (fault,) = found.value.faults
    assert str(fault) == f"this is {what}, not a problem"
