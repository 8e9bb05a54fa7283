"""Tasks by name and by file; kinds left open; files of the published dialect."""

import re
from pathlib import Path
from typing import Any

import pytest

from robotouille import FileError, Task, UnknownTaskError, World, load_task, task_names
from robotouille.resources import data_folder
from robotouille.world.lint import lint_task
from tests.support.broken_files import PROBLEM, published_domain, write
from tests.support.samples import first_of_each_folder_quickly

SHIPPED = {
    "synchronous": 10,
    "asynchronous": 10,
    "multi_agent": 10,
    "training": 3,
    "workshop": 2,
    "examples": 1,
}


def test_the_shipped_tasks() -> None:
    folders = [name.split("/")[0] for name in task_names()]
    assert {folder: folders.count(folder) for folder in folders} == SHIPPED
    assert list(task_names()) == sorted(task_names())


@pytest.mark.parametrize("name", first_of_each_folder_quickly(task_names()))
def test_no_shipped_task_has_a_fault(name: str) -> None:
    assert lint_task(load_task(name)) == []


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


@pytest.mark.parametrize("name", task_names())
def test_a_task_is_the_same_after_a_journey_as_json(name: str) -> None:
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
def test_names_may_be_short(name: str, full: str) -> None:
    assert load_task(name).name == full


@pytest.mark.parametrize("name", ["01", "synchronous/lettuce", "1"])
def test_ambiguous_names_are_refused_with_some_of_the_meant(name: str) -> None:
    with pytest.raises(FileError, match=rf"{name}: is not one task but \d+: \w+/\d+_"):
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


def test_the_nearest_name_is_suggested() -> None:
    with pytest.raises(UnknownTaskError, match="did you mean 'synchronous/01_cheese_sandwich'"):
        load_task("synchronous/1_cheese_sandwihc")


def test_seats() -> None:
    assert load_task("multi_agent/01").seats == 2
    assert load_task("multi_agent/01@3").seats == 3
    assert load_task("multi_agent/01", seats=4).seats == 4
    assert load_task("multi_agent/01@3").digest != load_task("multi_agent/01@4").digest
    for seats in (0, 1, 5):
        with pytest.raises(FileError, match=f"seats: {seats} seats asked for; possible: 2, 3, 4"):
            load_task(f"multi_agent/01@{seats}")


def test_players_without_a_seat_are_not_in_the_kitchen() -> None:
    world = World(load_task("multi_agent/01@2"))
    assert world.players == ("robot1", "robot2")
    assert "robot3" not in world.initial.text()


def test_unknown_timing() -> None:
    with pytest.raises(FileError, match="unknown profile 'fast'; possible: benchmark, people"):
        load_task("synchronous/01", timing="fast")


def test_a_domain_name_that_is_no_file_name(tmp_path: Path) -> None:
    name = write(tmp_path, "problem.json", {**PROBLEM, "domain": "x" * 5000})
    with pytest.raises(FileError, match="there is no domain"):
        load_task(name)


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


def test_a_seed_decides_the_kinds_left_open(tmp_path: Path) -> None:
    name = open_problem(tmp_path)
    first = load_task(name, seed=7)
    assert kinds(first) == kinds(load_task(name, seed=7))
    assert first.digest == load_task(name, seed=7).digest
    several = {tuple(kinds(load_task(name, seed=seed))) for seed in range(20)}
    assert len(several) > 10
    assert not {kind for found in several for kind in found} & {"item", "station"}
    assert World(first).players == ("robot1",)


def test_what_a_seed_decides_is_fixed_for_ever(tmp_path: Path) -> None:
    """Recordings and benchmarks name a seed."""
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


def test_marks_of_the_published_generator_are_left_out(tmp_path: Path) -> None:
    """Its raw output has them; a file that was tidied up is the same task."""
    marked = published_problem()
    for thing in (*marked["stations"], *marked["items"]):
        thing.update(force_add=True, frozen=False)
    raw = published(tmp_path, stations=marked["stations"], items=marked["items"])
    assert raw.task.digest == published(tmp_path).task.digest


def test_published_files_get_what_they_leave_unsaid(tmp_path: Path) -> None:
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
    """On one tile the published simulator counts in the file's order, which ours does not."""
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


def test_published_walks_have_a_length_for_people(tmp_path: Path) -> None:
    task = published(tmp_path).task
    world = World(Task(task.name, task.domain, task.problem, 1, type(task.timing)("people")))
    move = world.action("move", "robot1", "stove1", "table1")
    assert world.initial.step(move).state.busy_steps("robot1") == 2


def test_published_goals_may_name_objects_by_a_string(tmp_path: Path) -> None:
    items = [{"name": "patty", "x": 0, "y": 0, "id": "1"}]
    goal = published_problem()["goal"]
    world = published(tmp_path, items=items, goal=goal)
    cook = world.parse(world.initial, "robot1", "Cook patty1 on stove1 using robot1")
    assert world.initial.step(cook).state.step([]).goal_reached
    with pytest.raises(FileError, match="no object has the id '1'"):
        published(tmp_path, goal=goal)


def test_lists_and_objects_that_contradict_each_other(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="objects: input should be a valid dictionary"):
        published(tmp_path, objects=5)


def test_generated_instances_are_listed_when_asked_for() -> None:
    names = task_names(generated=True)
    assert set(task_names()) < set(names)
    generated = [name for name in names if name.startswith("generated/")]
    assert len(names) == len(task_names()) + len(generated)
    assert load_task(generated[0]).name == generated[0]


@pytest.mark.parametrize("name", ["synchronous/01", "asynchronous/10", "multi_agent/01@3"])
def test_a_task_knows_its_instances_by_their_seeds(name: str) -> None:
    task = load_task(name)
    instances = task.instances()
    assert set(instances) <= set(task_names(generated=True))
    seeds = [int(instance.rpartition("_s")[2]) for instance in instances]
    assert seeds == sorted(seeds)
    assert len(set(seeds)) >= 10
    assert load_task(instances[0], seats=task.seats).problem.goal == task.problem.goal
    assert load_task(instances[0]).instances() == ()


def test_every_generated_instance_is_some_tasks() -> None:
    known = {name for task in task_names() for name in load_task(task).instances()}
    assert known == set(task_names(generated=True)) - set(task_names())


@pytest.mark.parametrize("name", ["wafle", "waffle", "waffle.jsn", "Waffle.JSON", "wafle.json"])
def test_a_file_of_the_folder_that_is_meant(
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
def test_another_kind_of_file_is_told_in_one_line(what: str, file: str) -> None:
    folder, _, name = file.partition("/")
    with pytest.raises(FileError) as found:
        load_task(str(data_folder(folder) / name))
    (fault,) = found.value.faults
    assert str(fault) == f"this is {what}, not a problem"


def test_a_field_is_never_meant_by_its_own_name(tmp_path: Path) -> None:
    with pytest.raises(FileError) as found:
        load_task(write(tmp_path, "problem.json", {**PROBLEM, "name": "mine"}))
    assert [str(fault) for fault in found.value.faults] == ["name: unknown field 'name'"]
