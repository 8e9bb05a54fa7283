"""Findings about renderings with unknown names: alone, next to a problem, or chosen."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from robotouille import FileError, load_task
from robotouille.installation import data_folder
from robotouille.world.lint_renderings import lint_look
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
    "item.entities.lettuse.assets: there is no kind 'lettuse'; did you mean 'lettuce'?",
    "item.entities.lettuce.assets.cut: there is no predicate 'iscutt'; did you mean 'iscut'?",
    "item.entities.lettuce.assets.now: there is no action 'cutt'; did you mean 'cut'?",
    "container.entities.pot.assets.watre: there is no kind 'watre'; did you mean 'water'?",
    "player.robbot: there is no kind 'robbot'; did you mean 'robot'?",
    "progress.cokk: there is no action 'cokk'; did you mean 'cook'?",
    "during.fryy: there is no action 'fryy'; did you mean 'fry'?",
    "language.kinds.tomatoe: there is no kind 'tomatoe'; did you mean 'tomato'?",
    "language.kinds.bread: there is no predicate 'iscookedd'; did you mean 'iscooked'?",
    "language.actions.moove: there is no action 'moove'; did you mean 'move'?",
    "language.actions.cut: cut has no parameter 'i11'; did you mean 'i1'?",
    "language.predicates.lok: there is no predicate 'lok'; did you mean 'loc'?",
}


@pytest.fixture
def renderings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return own_renderings(tmp_path, monkeypatch)


def received(errors: list[FileError]) -> set[str]:
    return {str(fault) for error in errors for fault in error.faults}


@pytest.mark.parametrize("name", ["robotouille", "diner", "workshop", "chalk"])
def test_shipped_renderings_have_no_faults(name: str) -> None:
    assert lint_look(None, name) == []
    assert lint_file(str(data_folder("renderings") / f"{name}.json")) == []


def test_wrong_names_suggest_the_nearest(renderings: Path) -> None:
    path = write(renderings, "mine.json", WRONG)
    (error,) = lint_look(load_task("multi_agent/01"), "mine")
    assert error.file == path
    (picture,) = received([error]) - SAID
    assert "there is no picture 'lettuce.svgg' in" in picture
    assert "did you mean 'lettuce.svg'?" in picture
    assert received([error]) >= SAID
    assert {str(fault) for fault in lint_file(path)} == received([error])


def test_suggestions_of_pictures_compare_their_names_alone(renderings: Path) -> None:
    bread = {"entities": {"bread": {"assets": "dough.svg"}}}
    look = {"extends": "robotouille", "item": bread}
    (fault,) = lint_file(write(renderings, "mine.json", look))
    assert "did you mean" not in str(fault), "topbun.svg has many of its letters"
    (fault,) = lint_file(write(renderings, "mine.json", {**look, "assets": "assets/mine"}))
    assert str(fault).startswith("assets:")
    assert str(fault).endswith("did you mean 'mine'?")


@pytest.mark.parametrize("field", ["redraws", "inherited_assets"])
def test_a_rendering_names_few_folders(renderings: Path, field: str) -> None:
    """Each name is searched on disk, which took 5 seconds for 60,000 of them."""
    path = write(renderings, "mine.json", {"extends": "robotouille", field: ["chalk"] * 51})
    (fault,) = lint_file(path)
    assert str(fault).startswith(f"{field}: ")
    assert "at most 50 items" in str(fault)


def test_a_rendering_may_name_everything_it_redraws(renderings: Path) -> None:
    gear = {"part": {"assets": "gear.svg"}}
    look = {
        "extends": "robotouille",
        "assets": "workshop",
        "progress": {"bake": "icon_flame.svg"},
        "item": {"entities": {"pancake": {"assets": "gear.svg"}, **gear}},
    }
    write(renderings, "mine.json", {**look, "redraws": ["diner", "workshop"]})
    assert received(lint_look(load_task("multi_agent/01"), "mine")) == set()
    write(renderings, "mine.json", look)
    said = received(lint_look(load_task("multi_agent/01"), "mine"))
    assert len(said) == 3
    assert any("no action 'bake'" in words for words in said)


def test_faults_of_an_extended_rendering_name_its_file(renderings: Path) -> None:
    write(renderings, "base.json", {"extends": "robotouille", "progress": {"cokk": "icon_fry.svg"}})
    write(renderings, "mine.json", {"extends": "base"})
    (said,) = received(lint_look(None, "mine"))
    assert said.endswith("did you mean 'cook'? (in base.json)")


def test_unknown_kinds_are_reported(tmp_path: Path) -> None:
    """A kind like no other is reported too; those of other problems in the folder are known."""
    write(tmp_path, "small.json", DOMAIN)
    task = load_task(write(tmp_path, "problem.json", {**PROBLEM, "domain": "small"}))
    write(tmp_path, "other.json", {**PROBLEM, "objects": {"item": [{"name": "cress"}]}})
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/leek.svg").write_text('<svg viewBox="0 0 9 9"/>')
    kinds = ("leek", "leeek", "cress", "xylophone")
    entities = {kind: {"assets": "leek.svg"} for kind in kinds}
    write(tmp_path, "small.rendering.json", {"assets": "mine", "item": {"entities": entities}})
    assert received(lint_look(task)) == {
        "item.entities.leeek.assets: there is no kind 'leeek'; did you mean 'leek'?",
        "item.entities.xylophone.assets: there is no kind 'xylophone'",
    }


# In a command


def played(*words: str, command: Callable[..., None] = play) -> Any:
    pytest.importorskip("pygame")
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, list(words))


@pytest.mark.slow
def test_faults_of_a_chosen_look_are_listed(renderings: Path, tmp_path: Path) -> None:
    path = write(renderings, "mine.json", WRONG)
    picture = tmp_path / "picture.png"
    words = ("synchronous/01", "--rendering", "mine", "--screenshot", str(picture))
    done = played(*words)
    assert done.exit_code == 1
    assert "\N{REPLACEMENT CHARACTER}" not in done.output
    *faults, hint = done.output.splitlines()
    assert len(faults) == len(SAID) + 1
    assert all(line.startswith(f"{path}: ") for line in faults)
    assert hint.startswith("Use --lenient to draw tiles")
    assert not picture.exists()
    for task in ("synchronous/01", "examples/pancakes"):
        picture.unlink(missing_ok=True)
        done = played(task, *words[1:], "--lenient")
        assert done.exit_code == 0, done.output
        assert picture.exists()


def test_a_chosen_look_is_checked_before_connecting(renderings: Path) -> None:
    write(renderings, "mine.json", {"extends": "robotouille", "progress": {"cokk": "icon_fry.svg"}})
    done = played("--headless", "--rendering", "mine", command=client)
    assert done.exit_code == 1
    assert "there is no action 'cokk'; did you mean 'cook'?" in done.output


def test_an_unusable_rendering_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
