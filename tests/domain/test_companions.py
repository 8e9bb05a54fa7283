"""Which input file, rendering and pictures belong to a problem, and what lint says of them."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from robotouille import Task, load_task
from robotouille.domain.input_bindings import WINDOW_KEYS, bindings_of, made_up_keys
from robotouille.domain.rendering import rendering_of
from robotouille.domain.schema import DomainFile, InputFile
from robotouille.domain.task import read_domain
from robotouille.resources import data_folder
from robotouille.world.lint import lint_task
from robotouille.world.lint.looks import lint_look
from robotouille_client.cli.main import lint_file
from robotouille_client.cli.play import play
from tests.support.broken_files import DOMAIN, PROBLEM, changed, write


def task_in(folder: Path, **own: Any) -> Task:
    write(folder, "small.json", {**DOMAIN, **own})
    return load_task(write(folder, "problem.json", {**PROBLEM, "domain": "small"}))


def key(name: str, key: str, at: str | None = "s") -> dict[str, Any]:
    return {"name": name, "input_instructions": {"key": key, "at": at}}


def keys(*bindings: dict[str, Any]) -> dict[str, Any]:
    return {"keyboard_actions": list(bindings)}


def looks(icon: str) -> dict[str, Any]:
    return {"extends": "robotouille", "icons": {"app": icon}}


def test_renderings_and_their_order(tmp_path: Path) -> None:
    task = task_in(tmp_path)
    kitchen = rendering_of(task)
    assert kitchen.icons["app"] == "app_icon.svg"
    task = task_in(tmp_path, rendering_json="folder/looks.json")
    assert rendering_of(task) == kitchen
    write(tmp_path, "looks.json", looks("named.svg"))
    assert rendering_of(task).icons["app"] == "named.svg"
    write(tmp_path, "small.rendering.json", looks("own.svg"))
    assert rendering_of(task).icons["app"] == "own.svg"


@pytest.mark.parametrize("named", [{}, {"rendering_json": "small.json"}])
def test_a_domain_beside_its_problem_is_no_rendering(named: dict[str, str], tmp_path: Path) -> None:
    task = task_in(tmp_path, **named)
    assert rendering_of(task).icons["app"] == "app_icon.svg"


def test_a_copied_domain_is_no_rendering_either(tmp_path: Path) -> None:
    """A domain that was copied, or is extended, names `robotouille.json` as its rendering."""
    shipped = (data_folder("domains") / "robotouille.json").read_text()
    (tmp_path / "robotouille.json").write_text(shipped)
    write(tmp_path, "mine.json", {"name": "mine", "extends": "robotouille"})
    source = json.loads(
        (data_folder("problems") / "synchronous/01_cheese_sandwich.json").read_text()
    )
    task = load_task(write(tmp_path, "problem.json", {**source, "domain": "mine"}))
    assert rendering_of(task).icons["app"] == "app_icon.svg"
    assert lint_task(task) == []


def test_input_files_and_their_order(tmp_path: Path) -> None:
    def cut_key(task: Task) -> str:
        (binding,) = bindings_of(task).keyboard_actions
        return binding.input_instructions.key

    task = task_in(tmp_path, input_json="folder/keys.json")
    assert cut_key(task) == "e"
    write(tmp_path, "keys.json", keys(key("cut", "n")))
    assert cut_key(task) == "n"
    write(tmp_path, "small.input.json", keys(key("cut", "o")))
    assert cut_key(task) == "o"


# Keys that are made up


def several(*names: str) -> DomainFile:
    actions = [{**DOMAIN["action_defs"][0], "name": name} for name in names]
    return DomainFile.model_validate({**DOMAIN, "action_defs": actions})


def test_each_action_without_a_key_gets_a_free_one() -> None:
    """The first free letter of its name, else of the alphabet, else a digit."""
    domain = several("cut", "cute", "tc", "t")
    inputs = InputFile.model_validate(keys(key("cut", "C")))
    assert made_up_keys(inputs, domain) == {"cute": "u", "tc": "a", "t": "b"}
    assert made_up_keys(inputs, domain) == made_up_keys(inputs, domain)


def test_when_no_key_is_left_one_is_shared() -> None:
    domain = several(*(f"act{i}" for i in range(60)))
    found = list(made_up_keys(InputFile(), domain).values())
    assert len(set(found[:34])) == 34
    assert set(found[34:]) == {"e"}
    assert not WINDOW_KEYS & set(found)


def test_a_walk_that_no_input_file_names_is_a_click(tmp_path: Path) -> None:
    write(tmp_path, "robots.input.json", keys(key("cook", "k", "s1")))
    write(tmp_path, "robots.json", {"name": "robots", "extends": "robotouille"})
    domain = read_domain("robots", tmp_path)
    task = Task("t", domain, load_task("synchronous/01").problem, 1, source=str(tmp_path / "x"))
    (tmp_path / "x").write_text("")
    bindings = bindings_of(task)
    (click,) = bindings.mouse_click_actions
    assert (click.name, click.input_instructions.click_on) == ("move", "s2")
    found = {b.name: b.input_instructions for b in bindings.keyboard_actions}
    assert (found["cook"].key, found["wait"].key, found["wait"].at) == ("k", "e", None)
    assert (found["cut"].key, found["cut"].at) == ("c", "s1")
    assert len({how.key for how in found.values()}) == len(found)


# Lint


def findings(task: Task) -> list[str]:
    return [f"{f.severity}: {f}" for f in lint_task(task)]


def test_actions_without_a_key(tmp_path: Path) -> None:
    write(tmp_path, "small.input.json", keys())
    (finding,) = findings(task_in(tmp_path))
    assert finding == (
        f"note: {tmp_path.name}/small.input.json: keyboard_actions: 'cut' has no click and no key "
        "in small.input.json; C is made up: to choose, name it in small.input.json"
    )
    assert [str(f) for f in lint_file(str(tmp_path / "small.input.json"))] == [
        finding.partition("json: ")[2]
    ]


def test_a_misspelt_predicate_is_told_of_the_rendering_alone(tmp_path: Path) -> None:
    art = {"default": "bread.svg", "cut": {"asset": "bread.svg", "predicates": ["iscutt"]}}
    entities = {"bread": {"assets": art}}
    write(tmp_path, "mine.json", {"name": "mine", "extends": "robotouille"})
    own = {"version": "2.0", "extends": "robotouille", "item": {"entities": entities}}
    (fault,) = lint_file(write(tmp_path, "mine.rendering.json", own))
    place = "item.entities.bread.assets.cut"
    assert str(fault) == f"{place}: mine has no predicate 'iscutt'; did you mean 'iscut'?"
    assert fault.severity == "warning"


def test_files_that_are_named_and_not_there(tmp_path: Path) -> None:
    task = task_in(tmp_path, input_json="no.input.json", rendering_json="folder/no.json")
    assert findings(task) == [
        "warning: input_json: there is no file 'no.input.json' beside it or among those shipped; "
        "all keys are made up: write it, or leave the field out",
        "warning: rendering_json: there is no file 'no.json' beside it or among those shipped; "
        "it looks like the kitchen: write it, or leave the field out",
    ]
    assert [f"{f.severity}: {f}" for f in lint_file(str(tmp_path / "small.json"))] == findings(task)


def test_pictures_that_are_not_there(tmp_path: Path) -> None:
    own = {
        "extends": "robotouille",
        "assets": "mine",
        "item": {"entities": {"leek": {"assets": {"default": "leek.svg", "cut": "rings.svg"}}}},
    }
    write(tmp_path, "small.rendering.json", own)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/leek.svg").write_text("<svg/>")
    place = "item.entities.leek.assets.cut"
    said = "there is no picture 'rings.svg' in "
    (about_looks, about_peel) = findings(task_in(tmp_path))
    assert about_looks.startswith(
        f"warning: {tmp_path.name}/small.rendering.json: {place}: {said}{tmp_path.name}/mine or "
    )
    assert about_peel == (
        "note: 'peel' has no picture; a tile with its name is drawn: "
        "give it one in small.rendering.json"
    )
    (fault,) = lint_file(str(tmp_path / "small.rendering.json"))
    assert str(fault).startswith(f"{place}: {said}")


def test_what_a_rendering_names_by_mistake_is_told_with_the_nearest_name(tmp_path: Path) -> None:
    leek = {
        "default": "leek.svg",
        "cut": {"asset": "leek_cut.svg", "predicates": ["is_cut"]},
        "now": {"asset": "leek.svg", "during": ["ct"]},
    }
    entities = {"leek": {"assets": leek}, "peeel": {"assets": "p.svg"}}
    own = {"assets": "mine", "item": {"entities": entities}}
    write(tmp_path, "small.rendering.json", own)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/leek.svg").write_text("<svg/>")
    (tmp_path / "mine/p.svg").write_text("<svg/>")
    task = task_in(tmp_path)
    said = [str(fault) for fault in lint_look(task)]
    assert any("no picture 'leek_cut.svg'" in line and "'leek.svg'?" in line for line in said)
    assert any("small has no predicate 'is_cut'; did you mean 'iscut'?" in line for line in said)
    assert any("small has no action 'ct'; did you mean 'cut'?" in line for line in said)
    assert any("nothing is of the kind 'peeel'; did you mean 'peel'?" in line for line in said)


def test_a_window_opens_on_looks_without_faults_or_leniently(tmp_path: Path) -> None:
    pytest.importorskip("pygame")
    app = typer.Typer()
    app.command()(play)
    task_in(tmp_path)
    write(tmp_path, "small.rendering.json", looks("app_icn.svg"))
    picture = tmp_path / "picture.png"
    words = [str(tmp_path / "problem.json"), "--screenshot", str(picture)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 1
    assert "there is no picture 'app_icn.svg'" in done.output
    assert "did you mean 'app_icon.svg'?" in done.output
    assert "--lenient draws tiles" in done.output
    assert not picture.exists()
    done = CliRunner().invoke(app, [*words, "--lenient"])
    assert done.exit_code == 0, done.output
    assert picture.exists()


def test_pictures_are_wanted_in_the_domains_own_rendering(tmp_path: Path) -> None:
    """Not in that of the domain that it extends, which may be a shipped one."""
    write(tmp_path, "brunch.json", {"name": "brunch", "extends": "diner"})
    problem = {
        "domain": "brunch",
        "width": 2,
        "height": 2,
        "objects": {
            "station": [{"name": "urn", "x": 0, "y": 0, "predicates": ["istable"]}],
            "player": [{"name": "robot", "x": 0, "y": 1, "direction": [0, -1]}],
        },
        "goal": [],
    }
    task = load_task(write(tmp_path, "problem.json", problem))
    assert findings(task)[-1] == (
        "note: 'urn' has no picture; a tile with its name is drawn: "
        "give it one in brunch.rendering.json"
    )


def test_companions_that_are_broken(tmp_path: Path) -> None:
    """All faults at once: those of the problem's own file and those of the others."""
    write(tmp_path, "small.input.json", keys(key("cutt", "e")))
    write(tmp_path, "small.rendering.json", {"extends": "robotouille", "flor": {}})
    found = findings(task_in(tmp_path))
    folder = tmp_path.name
    assert found[0] == (
        f"error: {folder}/small.input.json: keyboard_actions[0].name: unknown action 'cutt'; "
        "did you mean 'cut'?"
    )
    assert f"error: {folder}/small.rendering.json: flor: unknown field 'flor'" in found[2]


def test_things_that_a_window_cannot_show(tmp_path: Path) -> None:
    """A world of blocks whose places no layout rule tells is invisible."""
    layout = [{"predicate": "loc", "when": "faces"}]
    task = task_in(tmp_path, layout=layout)
    assert (
        "warning: leek1: cannot be seen: no fact puts it on a station, on a player or into "
        "something; give the domain a layout rule 'shares_tile' about its type"
    ) in findings(task)
    domain = changed({**DOMAIN, "layout": layout}, "layout", 1, to=DOMAIN["layout"][0])
    assert not any("cannot be seen" in f for f in findings(task_in(tmp_path, **domain)))
