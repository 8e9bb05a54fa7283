"""What the pages show, done."""

import json
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotouille import Task, World, load_task
from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import InputFile
from robotouille.planning.plan import Plan, read_plan
from robotouille.planning.search_result import Limits
from robotouille.planning.solvers import solve
from robotouille.planning.validation import replay
from robotouille.resources import data_folder
from robotouille_client import connect
from robotouille_client.cli.main import app
from robotouille_server import ServerSettings, serve
from tests.support.pages import blocks, read, titled
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
    names = run_blocks("recordings.md")
    assert names["recording"].verify().ok
    assert names["recording"].outcome["steps"] == 3


def test_packs_examples() -> None:
    names = run_blocks("packs.md")
    assert names["world"].task.name == names["instance"].id


def test_batch_example() -> None:
    assert run_blocks("batch.md")["vectors"].shape[0] == 64


def test_api_examples() -> None:
    """The page's own assertions hold, and its bots play a game on a real server."""
    names = run_blocks("api.md")

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


@pytest.mark.parametrize("mode", ["turn", "lockstep", "realtime"])
@pytest.mark.parametrize("seats", [1, 2])
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


NEW_DISH = ("diner.json", "pancakes.json", "diner.input.json", "diner.rendering.json")


@pytest.fixture
def diner(tmp_path: Path) -> Path:
    """The first two files of the page's new dish, made as it says."""
    for name in NEW_DISH[:2]:
        (tmp_path / name).write_text(titled("formats.md", name), encoding="utf-8")
    return tmp_path


@pytest.fixture
def whole_diner(diner: Path) -> Path:
    """The same with its keys and pictures."""
    for name in NEW_DISH[2:]:
        (diner / name).write_text(titled("formats.md", name), encoding="utf-8")
    shutil.copytree(data_folder("assets") / "diner", diner / "diner")
    return diner


def lint_lines(folder: Path, *names: str) -> list[str]:
    """What `robotouille lint` prints in a folder."""
    result = CliRunner().invoke(app, ["lint", *(str(folder / name) for name in names)])
    assert result.exit_code == 0
    return result.stdout.replace(f"{folder}/", "").splitlines()


def test_lint_says_of_the_new_dish_what_the_page_says(diner: Path) -> None:
    lines = lint_lines(diner, *NEW_DISH[:2])
    shown = read("formats.md").split("$ robotouille lint diner.json pancakes.json\n")[1]
    assert lines[:3] == shown.splitlines()[:3]
    assert all(": note: " in line for line in lines)
    without = {line.split("'")[1] for line in lines if "has no picture" in line}
    assert without == {"griddle", "batter", "syrup", "pancake"}


def test_the_new_dish_has_no_faults(whole_diner: Path) -> None:
    lines = lint_lines(whole_diner, *NEW_DISH)
    assert lines == [f"{name}: no faults" for name in NEW_DISH]
    assert "\n".join(lines) in read("formats.md")


def test_the_new_dish_can_be_cooked(diner: Path) -> None:
    world = World(load_task(str(diner / "pancakes.json")))
    plan = read_plan(titled("formats.md", "pancakes.plan"), world)
    report = replay(plan, world)
    assert report.ok, report
    assert f"in {len(plan)} steps" in read("formats.md")


def test_the_new_dish_is_shipped_as_it_is_shown() -> None:
    """But for the names of its files, which lie in other folders."""
    shipped = {
        "diner.json": data_folder("domains") / "diner.json",
        "diner.input.json": data_folder("domains") / "diner.input.json",
        "diner.rendering.json": data_folder("renderings") / "diner.json",
        "pancakes.json": data_folder("problems") / "examples/pancakes.json",
    }
    for name, path in shipped.items():
        value = json.loads(path.read_text(encoding="utf-8"))
        names = {key: value.pop(key, None) for key in ("input_json", "rendering_json")}
        assert value == json.loads(titled("formats.md", name)), name
        if name == "diner.json":
            assert names == {"input_json": "diner.input.json", "rendering_json": "diner.json"}


def test_the_new_dish_travels(diner: Path) -> None:
    """A task of one's own is complete in itself, as clients get it."""
    task = load_task(str(diner / "pancakes.json"))
    sent = task.to_json()
    assert "extends" not in sent["domain"]
    assert Task.from_json(json.loads(json.dumps(sent))).digest == task.digest


def test_plan_example() -> None:
    names = run_blocks("formats.md")
    assert f"{names['report'].ok} {names['report']}" in read("formats.md")


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


def test_certificate_example() -> None:
    """The page's own assertions hold."""
    assert run_blocks("certificates.md")["certificate"].optimal


def test_generation_example() -> None:
    assert run_blocks("generation.md")["instance"].name == "01_lettuce_burger_s42"


def test_pddl_example() -> None:
    assert len(run_blocks("pddl.md")["plan"]) == 1


def test_planner_examples() -> None:
    planner, world = run_blocks("planners.md")["WAITING"], World("synchronous/01")
    end = replay(solve(world).plan or Plan(()), world).final
    assert planner.solve(world, end, Limits(), None).optimal
    assert planner.anytime(world, end) is None


def test_parts_of_files_are_valid() -> None:
    RenderingFile.model_validate(json.loads(titled("formats.md", "part of a rendering")))
    InputFile.model_validate(json.loads(titled("formats.md", "part of an input file")))
