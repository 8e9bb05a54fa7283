"""Files that extend others: what comes of it, and what is refused."""

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import FileError, Task, World, load_task
from robotouille.domain.extends import MAX_EXTENDS, read_extending
from robotouille.domain.input_bindings import INPUT_FILES
from robotouille.domain.rendering import RENDERING_FILES
from robotouille.domain.schema import DomainFile
from robotouille.domain.task import DOMAIN_FILES, read_domain
from robotouille.resources import data_folder
from robotouille_client.cli.main import lint_file
from tests.support.broken_files import DOMAIN, PROBLEM, changed, published_domain, write

Json = dict[str, Any]


def peel(name: str = "peel", predicate: str = "ispeeled") -> Json:
    return {
        "name": name,
        "precons": [
            {"predicate": "loc", "params": ["p", "s"]},
            {"predicate": "at", "params": ["i", "s"]},
        ],
        "immediate_fx": [{"predicate": predicate, "params": ["i"]}],
        "language_description": "Peel {i} with {p}",
    }


PEELED = {"name": "ispeeled", "param_types": ["item"]}


def extended(folder: Path, **own: Any) -> DomainFile:
    write(folder, "small.json", DOMAIN)
    write(folder, "larger.json", {"name": "larger", "extends": "small", **own})
    return read_domain("larger", folder)


def test_definitions_are_merged_by_name(tmp_path: Path) -> None:
    cut = changed(DOMAIN["action_defs"][0], "language_description", to="Slice {i} with {p}")
    domain = extended(
        tmp_path,
        predicate_defs=[PEELED],
        action_defs=[peel(), cut],
        layout=[{"predicate": "loc", "when": "shares_tile"}],
    )
    assert domain.name == "larger"
    assert domain.extends is None
    names = [p["name"] for p in DOMAIN["predicate_defs"]]
    assert [p.name for p in domain.predicate_defs] == [*names, "ispeeled"]
    assert [a.name for a in domain.action_defs] == ["cut", "peel"]
    assert domain.action_defs[0].language_description == "Slice {i} with {p}"
    assert [(r.predicate, r.when) for r in domain.layout or ()] == [
        ("at", "shares_tile"),
        ("loc", "shares_tile"),
    ]


def test_names_are_united_and_the_rest_is_replaced(tmp_path: Path) -> None:
    domain = extended(
        tmp_path,
        object_types=["tool", "item"],
        station_types=["tool"],
        kinds={"tool": ["knife"]},
        version="2.1",
    )
    assert domain.object_types == ("station", "item", "player", "tool")
    assert domain.station_types == ("station", "tool")
    assert domain.player_types == ("player",)
    assert domain.kinds == {"tool": ("knife",)}
    assert domain.version == "2.1"


def test_the_result_is_as_if_written_in_one_file(tmp_path: Path) -> None:
    """So recordings and messages carry a whole domain, and the same hash."""
    extended(tmp_path, predicate_defs=[PEELED], action_defs=[peel()])
    whole = {
        **DOMAIN,
        "name": "larger",
        "predicate_defs": [*DOMAIN["predicate_defs"], PEELED],
        "action_defs": [*DOMAIN["action_defs"], peel()],
    }
    write(tmp_path, "whole.json", whole)
    task = load_task(write(tmp_path, "a.json", {**PROBLEM, "domain": "larger"}))
    plain = load_task(write(tmp_path, "b.json", {**PROBLEM, "domain": "whole"}))
    assert task.domain == plain.domain
    assert task.to_json()["domain"] == plain.to_json()["domain"]
    assert Task.from_json(json.loads(json.dumps(task.to_json()))).digest == task.digest
    assert {a.name for a in World(task).initial.actions("robot1")} == {"cut", "peel"}


def test_a_chain(tmp_path: Path) -> None:
    extended(tmp_path, predicate_defs=[PEELED], action_defs=[peel()])
    (tmp_path / "parts").mkdir()
    write(tmp_path / "parts", "last.json", {"name": "last", "extends": "middle"})
    write(tmp_path / "parts", "middle.json", {"name": "middle", "extends": "robotouille"})
    write(tmp_path, "largest.json", {"name": "largest", "extends": "larger", "version": "2.5"})
    assert [a.name for a in read_domain("largest", tmp_path).action_defs] == ["cut", "peel"]
    write(tmp_path, "below.json", {"name": "below", "extends": "parts/last.json"})
    below = read_domain("below", tmp_path)
    kitchen = read_domain("robotouille")
    assert below.model_copy(update={"name": "robotouille"}) == kitchen


def test_a_file_of_the_same_name_can_extend_the_shipped_one(tmp_path: Path) -> None:
    own = {"name": "mine", "extends": "robotouille", "kinds": {"station": ["bar"]}}
    write(tmp_path, "robotouille.json", own)
    assert read_domain("robotouille", tmp_path).kinds["station"][-1] == "bar"


def test_what_the_published_dialect_leaves_unsaid_is_extended_too(tmp_path: Path) -> None:
    write(tmp_path, "old.json", published_domain())
    own = {
        "name": "new",
        "extends": "old",
        "predicate_defs": [{"name": "near", "param_types": ["item", "station"]}],
        "layout": [{"predicate": "near", "when": "shares_tile"}],
    }
    write(tmp_path, "new.json", own)
    domain = read_domain("new", tmp_path)
    assert {"loc", "clear", "near"} <= {rule.predicate for rule in domain.layout or ()}
    move, cook = domain.action_defs
    assert move.travel == ("s1", "s2")
    assert cook.sfx[0].config == "cook_time"  # type: ignore[union-attr]


# What is refused


def refusal(folder: Path, **own: Any) -> list[str]:
    with pytest.raises(FileError) as error:
        extended(folder, **own)
    assert Path(error.value.file).name == "larger.json"
    return [str(fault) for fault in error.value.faults]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("smal", "extends: there is no file 'smal.json' beside it, and none is shipped"),
        ("robotouile", "did you mean 'robotouille'?"),
        ("../small", "extends: '../small' leaves the folder"),
        ("..\\small.json", "leaves the folder"),
        ("/etc/passwd", "leaves the folder"),
        ("a/../../small.json", "leaves the folder"),
        ("C:small.json", "leaves the folder"),
        ("x" * 5000, "there is no file"),
        ("\0", "there is no file"),
        (7, "extends: should be a name, found 7"),
        ("", "extends: should be a name, found ''"),
        ("larger", "extends: goes round in a circle: larger.json → larger.json"),
    ],
)
def test_names_that_are_refused(name: Any, message: str, tmp_path: Path) -> None:
    (fault,) = refusal(tmp_path, extends=name)
    assert message in fault


def test_a_circle_is_named(tmp_path: Path) -> None:
    for name, other in [("a", "b"), ("b", "c"), ("c", "a")]:
        write(tmp_path, f"{name}.json", {"name": name, "extends": other})
    with pytest.raises(FileError, match=r"a\.json → b\.json → c\.json → a\.json"):
        read_domain("a", tmp_path)


def test_a_chain_has_an_end(tmp_path: Path) -> None:
    write(tmp_path, "d1.json", DOMAIN)
    for number in range(2, MAX_EXTENDS + 2):
        own = {"name": "d", "extends": f"d{number - 1}"}
        write(tmp_path, f"d{number}.json", own)
    assert read_domain(f"d{MAX_EXTENDS}", tmp_path).action_defs
    with pytest.raises(FileError, match=f"more than {MAX_EXTENDS} files extend one another: d9"):
        read_domain(f"d{MAX_EXTENDS + 1}", tmp_path)


def test_faults_are_named_where_they_are(tmp_path: Path) -> None:
    """At their place in the file that extends, not in the result."""
    assert refusal(tmp_path, action_defs=[peel(predicate="ispeeld")], predicate_defs=[PEELED]) == [
        "action_defs[0].immediate_fx[0].predicate: unknown predicate 'ispeeld'; "
        "did you mean 'ispeeled'?"
    ]
    assert refusal(tmp_path, action_defs=[{**peel(), "precon": []}]) == [
        "action_defs[0].precon: unknown field 'precon'; did you mean 'precons'?"
    ]
    assert refusal(tmp_path, action_defs=[peel(), peel()], predicate_defs=[PEELED]) == [
        "action_defs: 'peel' is defined 2 times"
    ]


def test_what_breaks_the_extended_is_named_there(tmp_path: Path) -> None:
    broken = {"name": "loc", "param_types": ["player"]}
    first, *_ = refusal(tmp_path, predicate_defs=[broken])
    assert first.startswith("action_defs.precons[0].params: 'loc' takes 1, found 2")
    assert "('cut' is in 'small', extended here)" in first


def test_a_fault_in_the_extended_file_is_that_files(tmp_path: Path) -> None:
    write(tmp_path, "base.json", changed(DOMAIN, "action_defs", 0, "nme", to="x"))
    path = write(tmp_path, "own.json", {"name": "own", "extends": "base"})
    fault, *_ = lint_file(path)
    assert str(fault) == "base.json: action_defs[0].nme: unknown field 'nme'; did you mean 'name'?"


def test_a_domain_without_a_name(tmp_path: Path) -> None:
    write(tmp_path, "own.json", {"extends": "robotouille"})
    with pytest.raises(FileError, match="name: Field required"):
        read_extending(tmp_path / "own.json", DOMAIN_FILES)


def test_a_domain_in_a_message_sends_for_no_files() -> None:
    raw = load_task("examples/pancakes").to_json()
    raw["domain"]["extends"] = "robotouille"
    with pytest.raises(FileError, match="extends: is for files: here the domain has to be whole"):
        Task.from_json(raw)


# Input files and renderings


def test_keys_are_added_and_replaced(tmp_path: Path) -> None:
    own = {
        "extends": "robotouille",
        "keyboard_actions": [
            {"name": "cook", "input_instructions": {"key": "c", "at": "s1"}},
            {"name": "toast", "input_instructions": {"key": "e", "at": "s1"}},
        ],
    }
    write(tmp_path, "own.input.json", own)
    inputs = read_extending(tmp_path / "own.input.json", INPUT_FILES)
    keys = {k.name: k.input_instructions.key for k in inputs.keyboard_actions}
    assert (keys["cook"], keys["toast"], keys["cut"]) == ("c", "e", "e")
    assert [k.name for k in inputs.keyboard_actions].index("cook") == 1
    assert len(inputs.mouse_click_actions) == 7


def test_looks_are_added_and_replaced(tmp_path: Path) -> None:
    write(tmp_path, "a.rendering.json", {
        "extends": "robotouille",
        "assets": "first",
        "item": {"constants": {"SCALE": 0.5}, "entities": {"bread": {"assets": "loaf.svg"}}},
    })  # fmt: skip
    write(tmp_path, "b.rendering.json", {
        "extends": "a",
        "assets": "second",
        "floor": {"tiles": {"X": "carpet.svg"}},
        "player": {"robot": dict.fromkeys(("front", "back", "left", "right"), "r.svg")},
        "progress": {"cook": "pan.svg"},
    })  # fmt: skip
    rendering = read_extending(tmp_path / "b.rendering.json", RENDERING_FILES)
    kitchen = read_extending(data_folder("renderings") / "robotouille.json", RENDERING_FILES)
    assert (rendering.assets, rendering.inherited_assets) == ("second", ("first", "kitchen"))
    assert rendering.item.entities["bread"].assets.asset == "loaf.svg"
    assert rendering.item.entities["onion"] == kitchen.item.entities["onion"]
    assert rendering.item.constants.scale == 0.5
    assert rendering.item.constants.stack_offset == kitchen.item.constants.stack_offset
    assert set(rendering.floor.tiles) == {"C", "W", "T", "X"}
    assert rendering.floor.wall == "wall.svg"
    assert len(rendering.player["robot"]) == 1
    assert (rendering.progress["cook"], rendering.progress["cut"]) == ("pan.svg", "icon_knife.svg")
    assert rendering.container == kitchen.container
