"""Files that extend other files: results and errors."""

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import FileError, Task, World, load_task
from robotouille.domain.input_bindings import INPUT_FILES
from robotouille.domain.related_files import MAX_EXTENDS, read_extending
from robotouille.domain.rendering import RENDERING_FILES
from robotouille.domain.schema import DomainFile
from robotouille.domain.task import read_domain
from robotouille.installation import data_folder
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


def test_name_lists_are_merged_and_other_fields_replaced(tmp_path: Path) -> None:
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


def test_result_equals_a_single_file(tmp_path: Path) -> None:
    """Recordings and messages contain the complete domain, with the same hash."""
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


def test_chain_of_three_files(tmp_path: Path) -> None:
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


def test_defaults_of_the_published_dialect_are_extended(tmp_path: Path) -> None:
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
        ("smal", "extends: no file 'smal.json' in its folder or among the shipped files"),
        ("robotouile", "did you mean 'robotouille'?"),
        ("../small", "extends: '../small' is outside the folder"),
        ("..\\small.json", "is outside the folder"),
        ("/etc/passwd", "is outside the folder"),
        ("a/../../small.json", "is outside the folder"),
        ("C:small.json", "is outside the folder"),
        ("x" * 5000, "no file"),
        ("\0", "no file"),
        (7, "extends: expected a name, found 7"),
        ("", "extends: expected a name, found ''"),
        ("larger", "extends: files extend each other in a circle: larger.json → larger.json"),
    ],
)
def test_invalid_names_raise(name: Any, message: str, tmp_path: Path) -> None:
    (fault,) = refusal(tmp_path, extends=name)
    assert message in fault


def test_long_chain_is_refused(tmp_path: Path) -> None:
    write(tmp_path, "d1.json", DOMAIN)
    for number in range(2, MAX_EXTENDS + 2):
        own = {"name": "d", "extends": f"d{number - 1}"}
        write(tmp_path, f"d{number}.json", own)
    assert read_domain(f"d{MAX_EXTENDS}", tmp_path).action_defs
    with pytest.raises(FileError, match=f"more than {MAX_EXTENDS} files extend each other: d9"):
        read_domain(f"d{MAX_EXTENDS + 1}", tmp_path)


def test_faults_have_places_in_the_extending_file(tmp_path: Path) -> None:
    """The place is not the one in the merged file."""
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


def test_fault_in_an_extended_definition_names_it(tmp_path: Path) -> None:
    broken = {"name": "loc", "param_types": ["player"]}
    first, *_ = refusal(tmp_path, predicate_defs=[broken])
    assert first.startswith("action_defs.precons[0].params: 'loc' takes 1, found 2")
    assert "('cut' comes from 'small')" in first


def test_fault_in_the_extended_file_names_that_file(tmp_path: Path) -> None:
    write(tmp_path, "base.json", changed(DOMAIN, "action_defs", 0, "nme", to="x"))
    path = write(tmp_path, "own.json", {"name": "own", "extends": "base"})
    fault, *_ = lint_file(path)
    assert str(fault) == "base.json: action_defs[0].nme: unknown field 'nme'; did you mean 'name'?"


def test_domain_in_a_message_cannot_extend_files() -> None:
    raw = load_task("examples/pancakes").to_json()
    raw["domain"]["extends"] = "robotouille"
    with pytest.raises(
        FileError, match="extends: is allowed in files only; send the complete domain"
    ):
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
