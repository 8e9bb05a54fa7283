"""Input files, renderings and pictures of a problem, and lint findings about them."""

import json
import struct
from pathlib import Path
from typing import Any

from robotouille import Task, load_task
from robotouille.domain.input_bindings import bindings_of, made_up_keys
from robotouille.domain.rendering import rendering_of
from robotouille.domain.schema import DomainFile, InputFile
from robotouille.domain.task import read_domain
from robotouille.installation import data_folder
from robotouille.world.lint import lint_task
from robotouille_client.cli.main import lint_file
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


def test_order_of_renderings(tmp_path: Path) -> None:
    task = task_in(tmp_path)
    kitchen = rendering_of(task)
    assert kitchen.icons["app"] == "app_icon.svg"
    task = task_in(tmp_path, rendering_json="folder/looks.json")
    assert rendering_of(task) == kitchen
    write(tmp_path, "looks.json", looks("named.svg"))
    assert rendering_of(task).icons["app"] == "named.svg"
    write(tmp_path, "small.rendering.json", looks("own.svg"))
    assert rendering_of(task).icons["app"] == "own.svg"


def test_a_copied_domain_is_not_taken_for_a_rendering(tmp_path: Path) -> None:
    """A copied or extended domain names `robotouille.json` as its rendering."""
    shipped = (data_folder("domains") / "robotouille.json").read_text()
    (tmp_path / "robotouille.json").write_text(shipped)
    write(tmp_path, "mine.json", {"name": "mine", "extends": "robotouille"})
    source = json.loads(
        (data_folder("problems") / "synchronous/01_cheese_sandwich.json").read_text()
    )
    task = load_task(write(tmp_path, "problem.json", {**source, "domain": "mine"}))
    assert rendering_of(task).icons["app"] == "app_icon.svg"
    assert lint_task(task) == []


def test_order_of_input_files(tmp_path: Path) -> None:
    def cut_key(task: Task) -> str:
        (binding,) = bindings_of(task).keyboard_actions
        return binding.input_instructions.key

    task = task_in(tmp_path, input_json="folder/keys.json")
    assert cut_key(task) == "e"
    write(tmp_path, "keys.json", keys(key("cut", "n")))
    assert cut_key(task) == "n"
    write(tmp_path, "small.input.json", keys(key("cut", "o")))
    assert cut_key(task) == "o"


# Automatic keys


def several(*names: str) -> DomainFile:
    actions = [{**DOMAIN["action_defs"][0], "name": name} for name in names]
    return DomainFile.model_validate({**DOMAIN, "action_defs": actions})


def test_each_action_without_a_key_gets_a_free_one() -> None:
    """The key is the first free letter of the name, else of the alphabet, else a digit.

    The window uses some letters itself, such as A.
    """
    domain = several("cut", "cute", "tc", "t")
    inputs = InputFile.model_validate(keys(key("cut", "C")))
    assert made_up_keys(inputs, domain) == {"cute": "u", "tc": "b", "t": "f"}
    assert made_up_keys(inputs, domain) == made_up_keys(inputs, domain)


def test_walks_default_to_a_click(tmp_path: Path) -> None:
    write(tmp_path, "robots.input.json", keys(key("cook", "k", "s1")))
    write(tmp_path, "robots.json", {"name": "robots", "extends": "robotouille"})
    domain = read_domain("robots", tmp_path)
    task = Task("t", domain, load_task("synchronous/01").problem, 1, source=str(tmp_path / "x"))
    (tmp_path / "x").write_text("")
    bindings = bindings_of(task)
    (click,) = bindings.mouse_click_actions
    assert (click.name, click.input_instructions.click_on) == ("move", "s2")
    found = {b.name: b.input_instructions for b in bindings.keyboard_actions}
    assert (found["cook"].key, found["wait"].key, found["wait"].at) == ("k", "q", None)
    assert (found["cut"].key, found["cut"].at) == ("b", "s1")
    assert len({how.key for how in found.values()}) == len(found)


# Lint


def findings(task: Task) -> list[str]:
    return [f"{f.severity}: {f}" for f in lint_task(task)]


def test_actions_without_a_key(tmp_path: Path) -> None:
    write(tmp_path, "small.input.json", keys())
    (finding,) = findings(task_in(tmp_path))
    assert finding == (
        f"note: {tmp_path.name}/small.input.json: keyboard_actions: 'cut' has no click and no key "
        "in small.input.json: C is used; to choose another, add it to small.input.json"
    )
    assert [str(f) for f in lint_file(str(tmp_path / "small.input.json"))] == [
        finding.partition("json: ")[2]
    ]


def test_missing_files(tmp_path: Path) -> None:
    task = task_in(tmp_path, input_json="no.input.json", rendering_json="folder/no.json")
    assert findings(task) == [
        "warning: input_json: there is no file 'no.input.json' next to it or shipped, so "
        "all keys are chosen automatically: write the file or remove the field",
        "warning: rendering_json: there is no file 'no.json' next to it or shipped, so "
        "it looks like the kitchen: write the file or remove the field",
    ]
    assert [f"{f.severity}: {f}" for f in lint_file(str(tmp_path / "small.json"))] == findings(task)


def test_missing_pictures(tmp_path: Path) -> None:
    own = {
        "extends": "robotouille",
        "assets": "mine",
        "item": {"entities": {"leek": {"assets": {"default": "leek.svg", "cut": "rings.svg"}}}},
    }
    write(tmp_path, "small.rendering.json", own)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/leek.svg").write_text('<svg viewBox="0 0 9 9"/>')
    place = "item.entities.leek.assets.cut"
    said = "there is no picture 'rings.svg' in "
    (about_looks, about_peel) = findings(task_in(tmp_path))
    assert about_looks.startswith(
        f"warning: {tmp_path.name}/small.rendering.json: {place}: {said}{tmp_path.name}/mine or "
    )
    assert about_peel == (
        "note: 'peel' has no picture, so a tile with its name is drawn: "
        "add one to small.rendering.json"
    )
    (fault,) = lint_file(str(tmp_path / "small.rendering.json"))
    assert str(fault).startswith(f"{place}: {said}")


def test_pictures_that_cannot_be_drawn(tmp_path: Path) -> None:
    own = {
        "extends": "robotouille",
        "assets": "mine",
        "item": {"entities": {"leek": {"assets": {"default": "huge.png", "cut": "text.png"}}}},
    }
    write(tmp_path, "small.rendering.json", own)
    (tmp_path / "mine").mkdir()
    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 6, 0, 0, 0)
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(head)) + b"IHDR" + head + bytes(4)
    (tmp_path / "mine/huge.png").write_bytes(png)
    (tmp_path / "mine/text.png").write_text("not a picture")
    # 60,000 pixels a side would take 14 GB.
    assert [words.partition("assets.")[2] for words in findings(task_in(tmp_path))[:2]] == [
        "default: the picture 'huge.png' cannot be drawn: it has 60000 × 60000 pixels; at most "
        "4096 × 4096 are drawn",
        "cut: the picture 'text.png' cannot be drawn: it is neither SVG nor PNG",
    ]


def test_pictures_that_a_server_would_refuse_are_not_drawn_from_a_folder_either(
    tmp_path: Path,
) -> None:
    picture = {"extends": "robotouille", "assets": "mine", "floor": {"wall": "bomb.svg"}}
    write(tmp_path, "small.rendering.json", picture)
    (tmp_path / "mine").mkdir()
    bomb = '<!DOCTYPE svg [<!ENTITY a "aaaa">]><svg viewBox="0 0 9 9">&a;</svg>'
    (tmp_path / "mine/bomb.svg").write_text(bomb)
    words = "it declares a document type, which pictures may not do"
    assert findings(task_in(tmp_path))[0].endswith(
        f"floor.wall: the picture 'bomb.svg' cannot be drawn: {words}"
    )


def test_faults_of_all_files_are_reported_at_once(tmp_path: Path) -> None:
    write(tmp_path, "small.input.json", keys(key("cutt", "e")))
    write(tmp_path, "small.rendering.json", {"extends": "robotouille", "flor": {}})
    found = findings(task_in(tmp_path))
    folder = tmp_path.name
    assert found[0] == (
        f"error: {folder}/small.input.json: keyboard_actions[0].name: unknown action 'cutt'; "
        "did you mean 'cut'?"
    )
    assert f"error: {folder}/small.rendering.json: flor: unknown field 'flor'" in found[2]


def test_invisible_objects(tmp_path: Path) -> None:
    """A world of blocks without a layout rule about their places is invisible."""
    layout = [{"predicate": "loc", "when": "faces"}]
    task = task_in(tmp_path, layout=layout)
    assert (
        "warning: objects.item[0]: leek1 cannot be seen: no fact puts it on a station, on a player "
        "or into something; give the domain a layout rule 'shares_tile' about its type"
    ) in findings(task)
    domain = changed({**DOMAIN, "layout": layout}, "layout", 1, to=DOMAIN["layout"][0])
    assert not any("cannot be seen" in f for f in findings(task_in(tmp_path, **domain)))
