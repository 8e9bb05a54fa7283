"""What the pages show, done."""

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotouille import Task, World, load_task
from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import InputFile
from robotouille.installation import data_folder
from robotouille.planning.plan import Limits, Plan, read_plan, replay
from robotouille.planning.solvers import solve
from robotouille_client import connect
from robotouille_client.cli.main import app
from robotouille_server import ServerSettings, serve
from tests.support.pages import blocks, read, titled
from tests.support.samples import quick_sample_of_pairs
from tests.support.virtual_time import run

PUBLISHED = Path(__file__).resolve().parents[3] / "shared/compat/upstream/problems"


def run_blocks(page: str) -> dict[str, Any]:
    """Run the Python blocks of a page one after the other."""
    names: dict[str, Any] = {}
    for block in blocks(page, "python"):
        exec(compile(block, page, "exec"), names)
    return names


def settings(**changes: Any) -> ServerSettings:
    return ServerSettings(port=0, record=False, log_level="error", **changes)


def test_recordings_examples() -> None:
    names = run_blocks("recording_format.md")
    assert names["recording"].verify().ok
    assert names["recording"].outcome["steps"] == 3


@pytest.mark.slow
def test_packs_examples() -> None:
    names = run_blocks("packs.md")
    assert names["world"].task.name == names["instance"].id


@pytest.mark.slow
def test_api_examples() -> None:
    assert run_blocks("api.md")["result"].optimal


@pytest.mark.process
def test_the_states_of_the_page_travel_between_processes(tmp_path: Path) -> None:
    script = tmp_path / "in_processes.py"
    script.write_text(titled("api.md", "in_processes.py"), encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "successors" in done.stdout


def test_the_bots_of_the_guide_play() -> None:
    names = run_blocks("write_an_agent.md")
    for title in ("my_bot.py", "planner.py"):
        exec(compile(titled("write_an_agent.md", title), title, "exec"), names)
    assert names["play_alone"](names["Planner"]) == 8
    assert names["play_alone"](names["Curious"]) >= 8

    async def play() -> list[dict[str, Any]]:
        async with serve(settings()) as server:
            outcomes = await names["host"](server.url)
            async with connect(server.url, name="host") as host:
                created = await host.create("multi_agent/01", max_steps=7)
            return [*outcomes, await names["team"](server.url, created.code)]

    *outcomes, teams = run(play())
    assert teams["steps"] == 7
    assert [outcome["steps"] for outcome in outcomes] == [20, 20]
    assert sum(seat["said"] for seat in outcomes[0]["seats"]) == 2


@pytest.mark.parametrize(
    ("mode", "seats"), quick_sample_of_pairs(["turn", "lockstep", "realtime"], [1, 2])
)
def test_the_json_bot_plays(mode: str, seats: int) -> None:
    source = titled("protocol.md", "random_bot.py")
    assert "robotouille" not in source.replace("robotouille.v1.json", "")
    names: dict[str, Any] = {"__name__": "random_bot"}
    exec(compile(source, "random_bot.py", "exec"), names)
    random.seed(seats)
    task = ["synchronous/01", "multi_agent/01@2"][seats - 1]

    async def game() -> list[dict[str, Any]]:
        import asyncio

        async with serve(settings(mode=mode, max_steps=30)) as server:
            async with connect(server.url, name="host") as host:
                code = (await host.create(task)).code
            bots = (names["play"](server.url, code, f"bot {i}") for i in range(seats))
            return await asyncio.gather(*bots)

    for outcome in run(game()):
        assert outcome["reason"] == "step_limit"
        assert outcome["steps"] == 30
        assert all(seat["acted"] > 5 for seat in outcome["seats"])


GUIDE = "make_a_kitchen.md"
NEW_DISH = ("diner.json", "pancakes.json", "diner.input.json", "diner.rendering.json")


@pytest.fixture
def diner(tmp_path: Path) -> Path:
    """Folder with the guide's domain and problem of the new station."""
    for name in NEW_DISH[:2]:
        (tmp_path / name).write_text(titled(GUIDE, name), encoding="utf-8")
    return tmp_path


@pytest.fixture
def whole_diner(diner: Path) -> Path:
    """Folder with all files of the new station, keys and pictures included."""
    for name in NEW_DISH[2:]:
        (diner / name).write_text(titled(GUIDE, name), encoding="utf-8")
    shutil.copytree(data_folder("assets") / "diner", diner / "diner")
    return diner


def lint_lines(folder: Path, *names: str) -> list[str]:
    """Return the lines that `robotouille lint` prints for files in a folder."""
    result = CliRunner().invoke(app, ["lint", *(str(folder / name) for name in names)])
    assert result.exit_code == 0
    return result.stdout.replace(f"{folder}/", "").splitlines()


def lint_output(command: str) -> list[str]:
    """Return the lines that the guide shows below a command."""
    shown = read(GUIDE).split(f"$ {command}\n")[1]
    return shown.split("\n```")[0].split("\n$ ")[0].split("\n…")[0].splitlines()


def test_the_guide_shows_the_lint_output_of_its_ingredient(tmp_path: Path) -> None:
    name = "avocado_toast.json"
    (tmp_path / name).write_text(titled(GUIDE, name), encoding="utf-8")
    assert lint_lines(tmp_path, name) == lint_output(f"robotouille lint {name}")


def test_the_ingredient_of_the_guide_takes_as_many_steps_as_it_says(tmp_path: Path) -> None:
    path = tmp_path / "avocado_toast.json"
    path.write_text(titled(GUIDE, path.name), encoding="utf-8")
    result = solve(World(load_task(str(path))))
    assert result.optimal and result.plan is not None
    assert f"takes {len(result.plan)} steps" in read(GUIDE)


def test_the_guide_shows_the_lint_output_of_its_station(diner: Path) -> None:
    lines = lint_lines(diner, *NEW_DISH[:2])
    shown = lint_output("robotouille lint diner.json pancakes.json")
    assert lines[: len(shown)] == shown
    assert all(": note: " in line for line in lines)
    without = {line.split("'")[1] for line in lines if "has no picture" in line}
    assert without == {"griddle", "batter", "syrup", "pancake"}


def test_lint_finds_no_faults_in_the_complete_example(whole_diner: Path) -> None:
    lines = lint_lines(whole_diner, *NEW_DISH)
    assert lines == [f"{name}: no faults" for name in NEW_DISH]
    assert "\n".join(lines) in read(GUIDE)


def test_the_example_can_be_cooked_in_as_many_steps_as_the_guide_says() -> None:
    world = World(load_task("examples/pancakes"))
    shipped = data_folder("problems") / "examples/pancakes.plan"
    plan = read_plan(shipped.read_text(encoding="utf-8"), world)
    report = replay(plan, world)
    assert report.ok, report
    assert f"in {len(plan)} steps" in read(GUIDE)


def test_the_shipped_example_equals_the_guide() -> None:
    """The shipped domain also names its input file and rendering, which are in other folders."""
    shipped = {
        "diner.json": data_folder("domains") / "diner.json",
        "diner.input.json": data_folder("domains") / "diner.input.json",
        "diner.rendering.json": data_folder("renderings") / "diner.json",
        "pancakes.json": data_folder("problems") / "examples/pancakes.json",
    }
    for name, path in shipped.items():
        value = json.loads(path.read_text(encoding="utf-8"))
        names = {key: value.pop(key, None) for key in ("input_json", "rendering_json")}
        assert value == json.loads(titled(GUIDE, name)), name
        if name == "diner.json":
            assert names == {"input_json": "diner.input.json", "rendering_json": "diner.json"}


def test_a_task_with_an_extending_domain_is_sent_complete(diner: Path) -> None:
    """The JSON that clients receive needs no other file."""
    task = load_task(str(diner / "pancakes.json"))
    sent = task.to_json()
    assert "extends" not in sent["domain"]
    assert Task.from_json(json.loads(json.dumps(sent))).digest == task.digest


def test_plan_example() -> None:
    names = run_blocks("file_formats.md")
    assert f"{names['report'].ok} {names['report']}" in read("file_formats.md")


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="the published files are not shipped")
@pytest.mark.parametrize(
    "name",
    [
        "synchronous/0_cheese_sandwich",
        "synchronous/6_lettuce_tomato_cheeseburger",
        "synchronous/8_two_lettuce_tomato_burger",
        "asynchronous/8_onion_tomato_soup_and_two_chicken_sandwich",
    ],
)
def test_short_plans_for_published_layouts(name: str) -> None:
    world = World(load_task(str(PUBLISHED / f"{name}.json")))
    plan = read_plan(titled("plan_lengths.md", f"{name.split('/')[1]}.plan"), world)
    report = replay(plan, world)
    assert report.ok, report
    assert f"`{name}`, {len(plan)} steps:" in read("plan_lengths.md")


def test_planner_examples() -> None:
    names = run_blocks("planners.md")
    assert names["certificate"].optimal
    assert names["instance"].name == "01_lettuce_burger_s42"
    assert len(names["plan"]) == 1
    planner, world = names["WAITING"], World("synchronous/01")
    end = replay(solve(world).plan or Plan(()), world).final
    assert planner.solve(world, end, Limits(), None).optimal
    assert planner.anytime(world, end) is None


def test_parts_of_files_are_valid() -> None:
    RenderingFile.model_validate(json.loads(titled("file_formats.md", "part of a rendering")))
    InputFile.model_validate(json.loads(titled("file_formats.md", "part of an input file")))
