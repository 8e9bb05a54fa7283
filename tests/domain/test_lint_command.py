"""`robotouille lint`: one line for each fault, or JSON, and an exit status."""

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from robotouille import load_task
from robotouille_client.cli.main import app
from tests.support.broken_files import DOMAIN, PROBLEM, changed, write


def lint(*arguments: str) -> tuple[int, list[str]]:
    result = CliRunner().invoke(app, ["lint", *arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result.exit_code, result.stdout.splitlines()


def test_shipped_tasks_have_no_faults() -> None:
    assert lint("synchronous/01", "workshop/02") == (
        0,
        ["synchronous/01: no faults", "workshop/02: no faults"],
    )


def test_faults_of_several_files(tmp_path: Path) -> None:
    domain = write(tmp_path, "small.json", changed(DOMAIN, "layout", 0, "predicate", to="att"))
    good = write(tmp_path, "good.json", DOMAIN)
    problem = changed({**PROBLEM, "domain": "good"}, "goal", 0, "predicate", to="iscutt")
    problem = write(tmp_path, "problem.json", changed(problem, "objects", "item", 0, "x", to=7))
    status, lines = lint(domain, good, problem)
    assert status == 1
    assert lines == [
        f"{domain}: error: layout[0].predicate: unknown predicate 'att'; did you mean 'at'?",
        f"{good}: no faults",
        f"{problem}: error: objects.item[0]: (7, 0) is off the 3 by 3 grid",
        f"{problem}: error: goal[0].predicate: unknown predicate 'iscutt'; did you mean 'iscut'?",
    ]


def test_an_unknown_field_hides_no_unknown_name(tmp_path: Path) -> None:
    write(tmp_path, "small.json", DOMAIN)
    broken = changed({**PROBLEM, "domain": "small"}, "objects", "item", 0, "stak-level", to=1)
    problem = write(tmp_path, "problem.json", changed(broken, "goal", 0, "predicate", to="iscutt"))
    broken = changed(DOMAIN, "action_defs", 0, "sfx", 0, "parm", to="i")
    broken = changed(broken, "layout", 0, "predicate", to="att")
    domain = write(tmp_path, "other.json", broken)
    assert lint(problem, domain)[1] == [
        f"{problem}: error: objects.item[0].stak-level: unknown field 'stak-level'; "
        "did you mean 'stack-level'?",
        f"{problem}: error: goal[0].predicate: unknown predicate 'iscutt'; did you mean 'iscut'?",
        f"{domain}: error: action_defs[0].sfx[0].parm: unknown field 'parm'; did you mean 'param'?",
        f"{domain}: error: layout[0].predicate: unknown predicate 'att'; did you mean 'at'?",
    ]


def test_object_with_too_many_names_is_a_fault(tmp_path: Path) -> None:
    names = {f"name{number}": 0 for number in range(10_001)}
    problem = write(tmp_path, "problem.json", {**PROBLEM, "domain": "robotouille", **names})
    status, lines = lint(problem)
    assert status == 1
    assert lines[0].endswith("names in one object; at most 10,000")


def test_faults_of_a_problem_do_not_hide_those_of_its_domain(tmp_path: Path) -> None:
    write(tmp_path, "small.json", changed(DOMAIN, "layout", 0, "predicate", to="att"))
    broken = changed({**PROBLEM, "domain": "small"}, "width", to="three")
    problem = write(tmp_path, "problem.json", broken)
    first, second = lint(problem)[1]
    assert first.startswith(f"{problem}: error: width: input should be a valid integer")
    assert "small.json: layout[0].predicate: unknown predicate 'att'" in second


def test_faults_of_a_problem_do_not_hide_those_of_other_files(tmp_path: Path) -> None:
    never = changed(DOMAIN, "action_defs", 0, "immediate_fx", to=[])
    never = changed(never, "layout", to=never["layout"][1:])
    never = changed(never, "action_defs", 0, "sfx", to=[])
    write(tmp_path, "small.json", {**never, "input_json": "none.json"})
    broken = changed({**PROBLEM, "domain": "small", "config": {}}, "goal", 0, "args", to=["leak"])
    problem = write(tmp_path, "problem.json", broken)
    lines = "\n".join(lint(problem)[1])
    assert "unknown kind of object 'leak'" in lines
    assert "'cut' can never apply: nothing makes 'at' true" in lines
    assert "input_json: there is no file 'none.json'" in lines


def test_warnings_do_not_fail(tmp_path: Path) -> None:
    write(tmp_path, "small.json", DOMAIN)
    goal = [
        {"predicate": "iscut", "args": ["leek"], "ids": [1]},
        {"predicate": "at", "args": ["item", "table"], "ids": [1, 2]},
    ]
    name = write(tmp_path, "problem.json", {**PROBLEM, "domain": "small", "goal": goal})
    status, lines = lint(name)
    assert status == 0
    assert len(lines) == 1
    assert "warning: goal[1].args[0]: the object 1 is 'leek' in an earlier term" in lines[0]


def test_notes_on_a_domain_are_not_repeated(tmp_path: Path) -> None:
    write(tmp_path, "small.rendering.json", {"extends": "robotouille", "assets": "mine"})
    (tmp_path / "mine").mkdir()
    domain = write(tmp_path, "small.json", DOMAIN)
    problem = write(tmp_path, "problem.json", {**PROBLEM, "domain": "small"})
    words = "has no picture, so a tile with its name is drawn: add one to small.rendering.json"
    assert lint(domain, problem) == (
        0,
        [f"{domain}: note: 'peel' {words}", f"{problem}: note: 'leek' {words}"],
    )
    assert len(lint(problem)[1]) == 2
    again = str(tmp_path / "again.json")
    Path(again).write_bytes(Path(domain).read_bytes())
    assert lint(domain, again)[1][1:] == [f"{again}: no other faults"]


def test_an_unused_kind(tmp_path: Path) -> None:
    kinds = {"station": ["table", "stove"], "item": ["onion"]}
    write(tmp_path, "small.json", {**DOMAIN, "kinds": kinds})
    problem = changed({**PROBLEM, "domain": "small"}, "objects", "station", 0, "name", to="tabel")
    name = write(tmp_path, "problem.json", problem)
    status, lines = lint(name)
    assert status == 1
    assert lines[:2] == [
        f"{name}: error: objects.station[0].name: unknown station kind 'tabel'; did you mean "
        "'table'?",
        f"{name}: warning: objects.item[0].name: unknown item kind 'leek'",
    ]
    load_task(name)  # Recordings may have such a kitchen.
    new = write(tmp_path, "new.json", changed(problem, "objects", "station", 0, "name", to="rack"))
    assert lint(new)[1][0].endswith("kind 'rack': add it to the domain's 'kinds.station'")
    for known in ("stove", "table", "station"):
        other = changed(problem, "objects", "station", 0, "name", to=known)
        assert "station kind" not in "".join(lint(write(tmp_path, "other.json", other))[1])
    described = changed(problem, "objects", "station", 0, "predicates", to=["istable"])
    assert "station kind" not in "".join(lint(write(tmp_path, "other.json", described))[1])
    broken = write(tmp_path, "broken.json", changed(problem, "goal", 0, "predicate", to="iscutt"))
    assert "unknown station kind 'tabel'" in lint(broken)[1][1], "it may be the cause of the other"


def test_faults_as_json(tmp_path: Path) -> None:
    write(tmp_path, "small.json", DOMAIN)
    broken = changed({**PROBLEM, "domain": "small"}, "objects", "item", 0, "stak-level", to=1)
    name = write(tmp_path, "problem.json", broken)
    status, lines = lint("--json", name, "synchronous/01")
    assert status == 1
    assert json.loads("\n".join(lines)) == [
        {
            "file": name,
            "path": "objects.item[0].stak-level",
            "severity": "error",
            "message": "unknown field 'stak-level'; did you mean 'stack-level'?",
        }
    ]
    status, lines = lint("--json", "synchronous/01")
    assert (status, json.loads("\n".join(lines))) == (0, [])


def test_missing_files_and_tasks() -> None:
    status, lines = lint("no-such-file.json", "synchronous/99")
    assert status == 1
    assert "no-such-file.json: error: cannot be read: No such file or directory" in lines
    assert any(line.startswith("synchronous/99: error: no task or file") for line in lines)


def test_another_domain(tmp_path: Path) -> None:
    domain = write(tmp_path, "small.json", DOMAIN)
    problem = write(tmp_path, "problem.json", PROBLEM)
    assert lint("--domain", domain, problem) == (0, [f"{problem}: no faults"])
    status, lines = lint(problem)
    assert status == 1
    assert f"{problem}: error: config.cuts: unknown configuration key 'cuts'; " in lines[0]


def test_object_that_occurs_once_in_an_action(tmp_path: Path) -> None:
    knead: dict[str, Any] = {
        "name": "knead",
        "language_description": "Knead {i1} at {s1} with {p1}",
        "precons": [
            {"predicate": "iscut", "params": ["i2"], "is_true": True},
            {"predicate": "loc", "params": ["p1", "s1"], "is_true": True},
            {"predicate": "item_on", "params": ["i1", "s1"], "is_true": True},
        ],
        "immediate_fx": [],
        "sfx": [],
    }
    bakery = {"version": "2.0", "name": "bakery", "extends": "robotouille", "action_defs": [knead]}
    _, lines = lint(write(tmp_path, "bakery.json", bakery))
    assert any(
        "warning: action_defs[0].precons[0].params[0]: 'i2' occurs nowhere else in 'knead', so any "
        "object will do; is another one meant?" in line
        for line in lines
    )
    knead["precons"][0]["params"] = ["i1"]
    assert "occurs nowhere else" not in "".join(lint(write(tmp_path, "b.json", bakery))[1])


def test_invisible_characters_in_words_are_errors(tmp_path: Path) -> None:
    words = {"extends": "robotouille", "language": {"purposes": {"table": "put\u200bthings down"}}}
    write(tmp_path, "small.rendering.json", words)
    domain = changed(DOMAIN, "action_defs", 0, "language_description", to="\u202eput {i}\u202c")
    write(tmp_path, "small.json", domain)
    goal = "Make a sandwich.\nTake care: \N{FAMILY} \N{MAN}\u200d\N{WOMAN} is fine."
    problem = {**PROBLEM, "domain": "small", "goal_description": goal + "\u2066"}
    name = write(tmp_path, "problem.json", problem)
    status, lines = lint(name)
    assert status == 1
    found = [line.removesuffix(": remove it").split(": ")[-2:] for line in lines]
    has = "has the invisible character"
    assert [each for each in found if has in each[1]] == [
        ["goal_description", f"{has} U+2066 LEFT-TO-RIGHT ISOLATE"],
        ["action_defs[0].language_description", f"{has} U+202E RIGHT-TO-LEFT OVERRIDE"],
        ["language.purposes.table", f"{has} U+200B ZERO WIDTH SPACE"],
    ]
