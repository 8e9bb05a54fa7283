"""What is said of a rendering that names what is not there: alone, beside a problem, chosen."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from robotouille import FileError, load_task
from robotouille.resources import data_folder
from robotouille.world.lint.looks import lint_look, lint_rendering
from robotouille_client.cli.main import lint_file
from robotouille_client.cli.play import play
from robotouille_client.window.cli import command as client
from tests.support.broken_files import DOMAIN, PROBLEM, write
from tests.support.own_renderings import own_renderings

WRONG: dict[str, Any] = {
    "version": "2.0",
    "extends": "robotouille",
    "assets": "chlk",
    "redraws": ["dinner"],
    "item": {
        "entities": {
            "lettuse": {"assets": "lettuce.svg"},
            "lettuce": {
                "assets": {
                    "default": "lettuce.svgg",
                    "cut": {"asset": "lettuce_cut.svg", "predicates": ["iscutt"]},
                    "now": {"asset": "lettuce_cut.svg", "during": ["cutt"]},
                }
            },
        }
    },
    "container": {
        "entities": {"pot": {"assets": {"default": "pot.svg", "watre": {"a": "pot.svg"}}}}
    },
    "player": {"robbot": dict.fromkeys(("front", "back", "left", "right"), "robot1_front.svg")},
    "progress": {"cokk": "icon_flame.svg"},
    "during": {"fryy": "sizzle"},
    "language": {
        "kinds": {"tomatoe": "Tomate", "bread": {"name": "Toast", "when": "iscookedd"}},
        "actions": {"moove": "gehen", "cut": "{i11} schneiden"},
        "predicates": {"lok": {"needed": "da"}},
    },
}  # fmt: skip
SAID = {
    "assets: there is no folder of pictures 'chlk'; did you mean 'chalk'?",
    "redraws[0]: there is no rendering 'dinner'; did you mean 'diner'?",
    "item.entities.lettuse.assets: nothing is of the kind 'lettuse'; did you mean 'lettuce'?",
    "item.entities.lettuce.assets.cut: there is no predicate 'iscutt'; did you mean 'iscut'?",
    "item.entities.lettuce.assets.now: there is no action 'cutt'; did you mean 'cut'?",
    "container.entities.pot.assets.watre: nothing is of the kind 'watre'; did you mean 'water'?",
    "player.robbot: nothing is of the kind 'robbot'; did you mean 'robot'?",
    "progress.cokk: there is no action 'cokk'; did you mean 'cook'?",
    "during.fryy: there is no action 'fryy'; did you mean 'fry'?",
    "language.kinds.tomatoe: nothing is of the kind 'tomatoe'; did you mean 'tomato'?",
    "language.kinds.bread: there is no predicate 'iscookedd'; did you mean 'iscooked'?",
    "language.actions.moove: there is no action 'moove'; did you mean 'move'?",
    "language.actions.cut: cut has no parameter 'i11'; did you mean 'i1'?",
    "language.predicates.lok: there is no predicate 'lok'; did you mean 'loc'?",
}


@pytest.fixture
def renderings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return own_renderings(tmp_path, monkeypatch)


def told(errors: list[FileError]) -> set[str]:
    return {str(fault) for error in errors for fault in error.faults}


@pytest.mark.parametrize("name", ["robotouille", "diner", "workshop", "chalk"])
def test_nothing_is_wrong_with_those_that_are_shipped(name: str) -> None:
    assert lint_look(None, name) == []
    assert lint_file(str(data_folder("renderings") / f"{name}.json")) == []


def test_each_wrong_name_of_a_chosen_look_is_told_with_the_nearest(renderings: Path) -> None:
    path = write(renderings, "mine.json", WRONG)
    (error,) = lint_look(load_task("multi_agent/01"), "mine")
    assert error.file == path
    (picture,) = told([error]) - SAID
    assert "there is no picture 'lettuce.svgg' in" in picture
    assert "did you mean 'lettuce.svg'?" in picture
    assert told([error]) >= SAID
    assert {str(fault) for fault in lint_file(path)} == told([error])


def test_a_look_may_speak_of_every_domain_that_it_redraws(renderings: Path) -> None:
    gear = {"part": {"assets": "gear.svg"}}
    look = {
        "extends": "robotouille",
        "assets": "workshop",
        "progress": {"bake": "icon_flame.svg"},
        "item": {"entities": {"pancake": {"assets": "gear.svg"}, **gear}},
    }
    write(renderings, "mine.json", {**look, "redraws": ["diner", "workshop"]})
    assert told(lint_look(load_task("multi_agent/01"), "mine")) == set()
    write(renderings, "mine.json", look)
    said = told(lint_look(load_task("multi_agent/01"), "mine"))
    assert len(said) == 3
    assert any("no action 'bake'" in words for words in said)


def test_what_is_wrong_in_an_extended_look_is_told_of_that(renderings: Path) -> None:
    write(renderings, "base.json", {"extends": "robotouille", "progress": {"cokk": "icon_fry.svg"}})
    write(renderings, "mine.json", {"extends": "base"})
    (said,) = told(lint_look(None, "mine"))
    assert said.endswith("did you mean 'cook'? (in base.json, extended here)")


def test_the_same_is_told_of_a_rendering_beside_a_problem(tmp_path: Path) -> None:
    write(tmp_path, "mine.json", {"name": "mine", "extends": "robotouille"})
    shipped = data_folder("problems") / "synchronous/01_cheese_sandwich.json"
    problem = {**json.loads(shipped.read_text()), "domain": "mine"}
    path = write(tmp_path, "mine.rendering.json", WRONG)
    (error,) = lint_look(load_task(write(tmp_path, "problem.json", problem)))
    assert error.file == path
    said = {words.replace("mine has", "there is") for words in told([error])}
    assert said >= SAID
    assert len(said) == len(SAID) + 1
    assert {str(f).replace("mine has", "there is") for f in lint_file(path)} == said


def test_a_wrong_kind_beside_the_real_one_is_told(tmp_path: Path) -> None:
    """And one that is like none; not what another problem of the folder has."""
    write(tmp_path, "small.json", DOMAIN)
    task = load_task(write(tmp_path, "problem.json", {**PROBLEM, "domain": "small"}))
    write(tmp_path, "other.json", {**PROBLEM, "objects": {"item": [{"name": "cress"}]}})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/leek.svg").write_text("<svg/>")
    kinds = ("leek", "leeek", "cress", "xylophone")
    entities = {kind: {"assets": "leek.svg"} for kind in kinds}
    write(tmp_path, "small.rendering.json", {"assets": "mine", "item": {"entities": entities}})
    assert told(lint_look(task)) == {
        "item.entities.leeek.assets: nothing is of the kind 'leeek'; did you mean 'leek'?",
        "item.entities.xylophone.assets: nothing is of the kind 'xylophone'",
    }


def test_what_is_taken_over_from_the_kitchen_is_not_judged(tmp_path: Path) -> None:
    write(tmp_path, "small.json", DOMAIN)
    path = Path(write(tmp_path, "small.rendering.json", {"extends": "robotouille"}))
    assert lint_rendering(path, load_small(tmp_path), tmp_path) == []


def load_small(folder: Path) -> Any:
    return load_task(write(folder, "problem.json", {**PROBLEM, "domain": "small"})).domain


# In a command


def played(*words: str, command: Callable[..., None] = play) -> Any:
    pytest.importorskip("pygame")
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, list(words))


def test_a_chosen_look_is_told_a_line_for_each_fault_or_drawn(
    renderings: Path, tmp_path: Path
) -> None:
    path = write(renderings, "mine.json", WRONG)
    picture = tmp_path / "picture.png"
    words = ("synchronous/01", "--rendering", "mine", "--screenshot", str(picture))
    done = played(*words)
    assert done.exit_code == 1
    assert "\N{REPLACEMENT CHARACTER}" not in done.output
    *faults, hint = done.output.splitlines()
    assert len(faults) == len(SAID) + 1
    assert all(line.startswith(f"{path}: ") for line in faults)
    assert hint.startswith("--lenient draws tiles")
    assert not picture.exists()
    for task in ("synchronous/01", "examples/pancakes"):
        picture.unlink(missing_ok=True)
        done = played(task, *words[1:], "--lenient")
        assert done.exit_code == 0, done.output
        assert picture.exists()


def test_a_chosen_look_is_told_before_a_server_is_asked(renderings: Path) -> None:
    write(renderings, "mine.json", {"extends": "robotouille", "progress": {"cokk": "icon_fry.svg"}})
    done = played("--headless", "--rendering", "mine", command=client)
    assert done.exit_code == 1
    assert "there is no action 'cokk'; did you mean 'cook'?" in done.output


def test_a_rendering_that_cannot_be_used_is_told_of_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "small.json", DOMAIN)
    write(tmp_path, "problem.json", {**PROBLEM, "domain": "small"})
    wrong = {"extends": "robotouille", "during": {"cut": "sizle"}}
    write(tmp_path, "small.rendering.json", wrong)
    for options in ((), ("--lenient",)):
        done = played("problem.json", "--screenshot", "picture.png", *options)
        assert done.exit_code == 1
        assert done.output.splitlines() == [
            "small.rendering.json: during.cut: there is no effect 'sizle'; did you mean 'sizzle'?"
        ]


def test_the_folder_of_pictures_is_told_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    write(tmp_path, "small.json", DOMAIN)
    write(tmp_path, "problem.json", {**PROBLEM, "domain": "small"})
    looks = {"assets": "mine", "icons": {"app": "no.svg"}}
    write(tmp_path, "small.rendering.json", looks)
    done = played("problem.json", "--screenshot", "picture.png")
    said = f"small.rendering.json: icons.app: there is no picture 'no.svg' in {tmp_path.name}/mine"
    assert said in done.output
