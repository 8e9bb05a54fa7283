"""Faults of domains and problems: place, message and suggestion."""

import difflib
import json
import pickle
import re
from pathlib import Path
from typing import Any

import pytest

from robotouille import FileError, World, errors, load_task
from robotouille.domain.json_files import validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.errors import Fault
from tests.support.broken_files import DOMAIN, PROBLEM, build, changed, faults_of, write

CUT = ("action_defs", 0)
REPEAT = (*CUT, "sfx", 0)
CREATE = (*CUT, "sfx", 1)


EMPTY = {"type": "conditional", "param": "i", "conditions": [], "fx": [], "sfx": []}
DOMAINS: list[tuple[tuple[Any, ...], Any, str]] = [
    (("name",), ..., "name: Field required"),
    (("name",), 7, "name: input should be a valid string, found 7"),
    (("naem",), "x", "naem: unknown field 'naem'; did you mean 'name'?"),
    (("object_types",), [], "object_types: tuple should have at least 1 item"),
    (("object_types",), ["station"] * 2, "object_types: 'station' is defined 2 times"),
    (("player_types",), ["palyer"], "player_types[0]: unknown object type 'palyer'; did you mean"),
    (("station_types",), ["table"], "station_types[0]: unknown object type 'table'"),
    (("predicate_defs", 0, "param_types", 0), "statoin", "did you mean 'station'?"),
    (("predicate_defs", 0, "param_types"), ["item"] * 5, "at most 4 items"),
    (("predicate_defs", 1, "name"), "istable", "predicate_defs: 'istable' is defined 2 times"),
    (("predicate_defs", 1, "name"), "is table", "predicate_defs[1].name: string should match"),
    (("predicate_defs", 2, "language_descriptors"), {"1": "x"}, "'iscut' has no argument 1"),
    (
        ("predicate_defs", 2, "language_descriptors"),
        {"0": "{3} is cut"},
        "predicate_defs[2].language_descriptors.0: unknown argument '3'",
    ),
    (("predicate_defs", 2, "language_descriptors"), {"0": "{0"}, "the braces do not match"),
    (("predicate_defs", 2, "language_descriptors"), {"0": "{0}" * 17}, "17 names in braces"),
    (
        ("predicate_defs", 2, "language_descriptors"),
        {"0": "{0:>9999}"},
        "unknown argument '0:>9999'",
    ),
    ((*CUT, "precons", 0, "predicate"), "lok", "unknown predicate 'lok'; did you mean 'loc'?"),
    (
        (*CUT, "precons", 0, "params"),
        ["p"],
        "action_defs[0].precons[0].params: 'loc' takes 2, found 1",
    ),
    ((*CUT, "precons", 1, "params", 0), "p", "'p' is a player elsewhere in this action"),
    (
        (*CUT, "precons", 0, "is_true"),
        "perhaps",
        "action_defs[0].precons[0].is_true: input should be",
    ),
    ((*CUT, "immediate_fx", 0), {"predicate": "at"}, "immediate_fx[0].params: Field required"),
    ((*REPEAT, "param"), "j", "action_defs[0].sfx[0].param: unknown parameter 'j'"),
    ((*REPEAT, "type"), "repetition", "'repetitive'"),
    ((*REPEAT, "default"), 0, "sfx[0].default: input should be greater than or equal to 1"),
    (
        (*REPEAT, "fx", 0, "predicate"),
        "iscutt",
        "unknown predicate 'iscutt'; did you mean 'iscut'?",
    ),
    ((*REPEAT, "fx", 0, "params"), ["n"], "'n' is created by this action"),
    ((*REPEAT, "param"), "n", "'n' is created by this action"),
    ((*CREATE, "created_obj", "type"), "itme", "unknown object type 'itme'; did you mean 'item'?"),
    ((*CREATE, "created_obj", "name"), "soup1", "'soup1' must not end in a digit"),
    ((*CREATE, "created_obj"), ..., "created_obj: Field required"),
    ((*CREATE, "created_obj", "param"), "i", "'i' is created by this action"),
    ((*CUT, "sfx"), [{**EMPTY, "sfx": [EMPTY] * 64}] * 4, "260 effects; at most 200"),
    ((*CUT, "travel"), ["s", "n"], "action_defs[0].travel: unknown parameter 'n'"),
    ((*CUT, "language_description"), "Cut {x}", "unknown parameter 'x'"),
    ((*CUT, "language_description"), "Cut {n}", "unknown parameter 'n'"),
    ((*CUT, "language_description"), "Cut {}", "unknown parameter ''"),
    ((*CUT, "language_description"), "Cut {i!r}", "unknown parameter 'i!r'"),
    ((*CUT, "language_description"), "Cut {i.__class__}", "unknown parameter 'i.__class__'"),
    ((*CUT, "language_description"), "100 % {", "the braces do not match"),
    ((*CUT, "language_description"), "} done", "the braces do not match"),
    (("layout", 0, "predicate"), "att", "layout[0].predicate: unknown predicate 'att'; did you"),
    (("layout", 0, "predicate"), "iscut", "'shares_tile' needs a predicate of 2"),
    (("layout", 0, "when"), "near", "layout[0].when: input should be"),
    (("layout", 0, "unless"), ["at"], "needs exactly one of 'when' and 'unless'"),
    (("layout", 0), {"predicate": "at", "unless": ["loc"]}, "'unless' needs a predicate of 1"),
    (("layout", 0), {"predicate": "iscut", "unless": ["lok"]}, "did you mean 'loc'?"),
    (("action_defs", 1), DOMAIN["action_defs"][0], "action_defs: 'cut' is defined 2 times"),
]


@pytest.mark.parametrize(("path", "value", "message"), DOMAINS, ids=[d[2][:50] for d in DOMAINS])
def test_faults_of_domains(path: tuple[Any, ...], value: Any, message: str) -> None:
    faults = faults_of(domain=changed(DOMAIN, *path, to=value))
    assert any(message in fault for fault in faults), faults


PLAYER = ("objects", "player", 0)
ITEM = ("objects", "item", 0)
PROBLEMS: list[tuple[tuple[Any, ...], Any, str]] = [
    (("width",), ..., "width: Field required"),
    (("width",), 0, "width: input should be greater than or equal to 1, found 0"),
    (("width",), 10**9, "width: input should be less than or equal to 100"),
    (("height",), "high", "height: input should be a valid integer"),
    (("heigth",), 3, "heigth: unknown field 'heigth'; did you mean 'height'?"),
    (("goal",), ..., "needs a 'goal', or a 'shift' with orders"),
    (("goal",), {}, "goal: input should be a valid tuple"),
    (("objects",), [], "objects: input should be a valid dictionary"),
    (("objects", "itme"), [], "unknown object type 'itme'; did you mean 'item'?"),
    ((*ITEM, "x"), 5, "objects.item[0]: (5, 0) is off the 3 by 3 grid"),
    ((*ITEM, "x"), -1, "greater than or equal to 0, found -1"),
    ((*ITEM, "name"), "two words", "string should match pattern"),
    ((*ITEM, "predicates"), ["iscutt"], "item[0].predicates[0]: unknown predicate 'iscutt'; did"),
    ((*ITEM, "predicates"), ["istable"], "'istable' does not describe a single item"),
    ((*ITEM, "stak-level"), 1, "unknown field 'stak-level'; did you mean 'stack-level'?"),
    ((*ITEM, "stack-level"), 10**6, "less than or equal to 1000"),
    (("objects", "item", 1), {**PROBLEM["objects"]["item"][0], "x": 1}, "'first' is used twice"),
    (("objects", "item", 1), {"name": "table", "x": 1, "y": 1}, "both have an object table1"),
    ((*PLAYER, "direction"), [1, 1], "direction must be one of"),
    ((*PLAYER, "direction"), [0, 0], "direction must be one of"),
    ((*PLAYER, "direction"), "up", "direction: input should be a valid tuple"),
    (("objects", "player"), [], "has no player"),
    (("goal", 0, "predicate"), "iscutt", "unknown predicate 'iscutt'; did you mean 'iscut'?"),
    (("goal", 0, "args"), ["leak"], "goal[0].args[0]: unknown kind of object 'leak'; did you mean"),
    (("goal", 0, "args"), ["table"], "'table' is a station, 'iscut' needs an item"),
    (("goal", 0, "ids"), [1, 2], "1 args but 2 ids"),
    (("goal", 0), {"predicate": "at", "args": ["leek"], "ids": [1]}, "'at' takes 2, found 1"),
    (("goal", 0, "ids"), ["frist"], "no object has the id 'frist'; did you mean 'first'?"),
    (("config", "cut"), {}, "config.cut: unknown configuration key 'cut'; did you mean 'cuts'?"),
    (("config", "cuts"), {"default": -1}, "config.cuts.default: input should be greater"),
    (("config", "cuts"), 3, "config.cuts: input should be a valid dictionary"),
    (("ground",), ["CCC", "CCC"], "ground: 2 rows on a grid 3 high"),
    (("ground",), ["CCC", "CC", "CCC"], "ground[1]: 2 letters on a grid 3 wide"),
    (("seats",), [2], "seats[0]: 2 seats, but the problem lists 1 players"),
    (("seats",), [0], "seats[0]: input should be greater than or equal to 1"),
]


@pytest.mark.parametrize(("path", "value", "message"), PROBLEMS, ids=[p[2][:50] for p in PROBLEMS])
def test_faults_of_problems(path: tuple[Any, ...], value: Any, message: str) -> None:
    faults = faults_of(problem=changed(PROBLEM, *path, to=value))
    assert any(message in fault for fault in faults), faults


def test_all_faults_of_a_problem_are_reported() -> None:
    problem = changed(PROBLEM, *ITEM, "x", to=9)
    problem = changed(problem, "goal", 0, "predicate", to="iscutt")
    problem = changed(problem, "config", "cost", to={})
    problem = changed(problem, "ground", to=["C"])
    paths = [fault.split(":")[0] for fault in faults_of(problem=problem)]
    assert paths == ["objects.item[0]", "goal[0].predicate", "config.cost", "ground", "ground[0]"]


def test_one_wrong_predicate_blames_no_right_ones() -> None:
    wrong = {"predicate": "istable", "params": ["i"]}
    conditions = [wrong, *DOMAIN["action_defs"][0]["precons"]]
    (fault,) = faults_of(domain=changed(DOMAIN, "action_defs", 0, "precons", to=conditions))
    assert fault.startswith("action_defs[0].precons[0].params[0]: 'i' is an item elsewhere")


def test_faults_use_the_names_of_the_file() -> None:
    """Published problems list `items`, not `objects.item`."""
    published = {key: value for key, value in PROBLEM.items() if key != "objects"}
    published |= {f"{kind}s": list(objects) for kind, objects in PROBLEM["objects"].items()}
    assert build(problem=published).problem.objects == build().problem.objects
    (fault,) = faults_of(problem=changed(published, "items", 0, "stak-level", to=1))
    assert fault == "items[0].stak-level: unknown field 'stak-level'; did you mean 'stack-level'?"


def test_too_many_objects() -> None:
    many = [{"name": "leek", "x": 0, "y": 0}] * 1001
    (fault,) = faults_of(problem=changed(PROBLEM, "objects", "item", to=many))
    assert "1003 objects; at most 1000 are allowed" in fault


def test_kinds_with_colliding_numbered_names() -> None:
    """The eleventh `leek` and the first `leek1` would both be called leek11."""
    items = [{"name": "leek", "x": 0, "y": 0}] * 11 + [{"name": "leek1", "x": 0, "y": 0}]
    problem = changed(PROBLEM, "objects", "item", to=items)
    assert "'leek1' and the item 'leek' both have an object leek11" in faults_of(problem=problem)[0]


def test_domain_next_to_a_problem_is_found(tmp_path: Path) -> None:
    write(tmp_path, "small.json", DOMAIN)
    name = write(tmp_path, "problem.json", {**PROBLEM, "domain": "small"})
    task = load_task(name)
    assert task.domain.name == "small"
    assert World(task).initial.actions("robot1")[0].sentence == "Cut leek1 with robot1"
    assert load_task(name, domain=str(tmp_path / "small.json")).digest == task.digest


def test_missing_domain_has_a_suggestion(tmp_path: Path) -> None:
    name = write(tmp_path, "problem.json", {**PROBLEM, "domain": "workshoop"})
    with pytest.raises(FileError, match="unknown domain 'workshoop'; did you mean 'workshop'"):
        load_task(name)


def test_a_problem_names_no_domain_outside_its_folder(tmp_path: Path) -> None:
    secret = write(tmp_path, "secret.json", DOMAIN)
    (tmp_path / "kitchens").mkdir()
    (tmp_path / "kitchens/link.json").symlink_to(secret)
    for domain in ("../secret.json", secret, "..\\secret.json", "link"):
        name = write(tmp_path / "kitchens", "problem.json", {**PROBLEM, "domain": domain})
        why = "unknown domain" if domain == "link" else "is outside the folder"
        with pytest.raises(FileError, match=f"domain: .*{why}"):
            load_task(name)
        assert load_task(name, domain=secret).domain.name == "small"


def test_a_problem_does_not_name_files_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kitchens").mkdir()
    write(tmp_path, "secret.json", DOMAIN)
    name = write(tmp_path / "kitchens", "problem.json", {**PROBLEM, "domain": "secret.json"})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError, match="unknown domain"):
        load_task(name)


def test_errors_can_be_pickled() -> None:
    with pytest.raises(FileError) as error:
        build(problem=changed(PROBLEM, "width", to=...))
    twin = pickle.loads(pickle.dumps(error.value))
    assert (twin.file, twin.faults, str(twin)) == (
        error.value.file,
        error.value.faults,
        str(error.value),
    )
    assert json.dumps(str(twin))


def test_message_lists_at_most_a_hundred_faults() -> None:
    error = FileError("k.json", [Fault(f"at.{i}", "is wrong") for i in range(2345)])
    lines = str(error).splitlines()
    assert len(error.faults) == 2345
    assert (len(lines), lines[-1]) == (101, "k.json: and 2,245 more faults")


UNKNOWN = [f"iscutt{number}" for number in range(5_000)]


@pytest.mark.parametrize(
    "problem",
    [
        {**PROBLEM, **dict.fromkeys(UNKNOWN, 1)},
        changed(PROBLEM, "objects", "item", 0, "predicates", to=UNKNOWN),
    ],
)
def test_thousands_of_unknown_names_get_few_suggestions(
    monkeypatch: pytest.MonkeyPatch, problem: dict[str, Any]
) -> None:
    compared = 0
    find = difflib.get_close_matches

    def counted(name: str, names: list[str], **options: Any) -> list[str]:
        nonlocal compared
        compared += len(names)
        return find(name, names, **options)

    monkeypatch.setattr(errors, "MAX_COMPARED", 1_000)
    monkeypatch.setattr(difflib, "get_close_matches", counted)
    with pytest.raises(FileError) as error:
        build(problem=problem)
    assert 0 < compared <= 1_000
    assert "unknown" in str(error.value.faults[0])
    assert str(error.value.faults[-1]) == "and 4,000 more faults"


def test_small_file_cannot_ask_for_millions_of_initial_facts() -> None:
    near = {"name": "near", "param_types": ["item", "item"]}
    rule = {"predicate": "near", "when": "shares_tile"}
    domain = changed(DOMAIN, "predicate_defs", to=[*DOMAIN["predicate_defs"], near])
    domain["layout"] = [*domain.get("layout", ()), rule]
    leeks = [{"name": "leek", "x": 0, "y": 0, "stack-level": n} for n in range(145)]
    problem = changed(PROBLEM, "objects", "item", to=[{**leeks[0], "id": "first"}, *leeks[1:]])
    (fault,) = faults_of(domain, problem)
    assert re.fullmatch(
        r"too many objects: the domain's layout implies 21,\d+ initial facts; "
        r"at most 20,000 are allowed",
        fault,
    )


def test_small_file_cannot_ask_for_millions_of_actions() -> None:
    cut = {**DOMAIN["action_defs"][0], "sfx": []}
    many = [{**cut, "name": f"cut{n}"} for n in range(200)]
    items = [{"name": "leek", "x": n % 3, "y": n // 3 % 3} for n in range(900)]
    problem = changed(PROBLEM, "objects", "item", to=[{**items[0], "id": "first"}, *items[1:]])
    problem["objects"]["station"] = [{"name": "table", "x": x, "y": 0} for x in range(3)]
    problem["config"] = {}
    (fault,) = faults_of(changed(DOMAIN, "action_defs", to=many), problem)
    assert "the actions have" in fault
    assert fault.endswith("at most 500,000 are allowed")


def test_conditions_of_actions_are_limited() -> None:
    cut = {**DOMAIN["action_defs"][0], "sfx": []}
    long = {**cut, "precons": cut["precons"] * 65}
    (fault,) = faults_of(changed(DOMAIN, "action_defs", to=[long]), PROBLEM)
    assert "precons" in fault
    assert "at most 64 items" in fault
    conditions = len(cut["precons"]) + len(cut["immediate_fx"])
    often = {**cut, "precons": cut["precons"] * (64 // len(cut["precons"]))}
    items = [{"name": "leek", "x": n % 3, "y": n // 3 % 3} for n in range(900)]
    problem = changed(PROBLEM, "objects", "item", to=[{**items[0], "id": "first"}, *items[1:]])
    problem["objects"]["station"] = [{"name": "table", "x": x, "y": 0} for x in range(3)]
    problem["config"] = {}
    many = [{**often, "name": f"cut{n}"} for n in range(100)]
    assert conditions > 0
    (fault,) = faults_of(changed(DOMAIN, "action_defs", to=many), problem)
    assert re.search(r"the actions have [\d,]+ conditions; at most 6,000,000 are allowed", fault)


@pytest.mark.parametrize("effects", [0, 2])
def test_small_file_cannot_ask_for_gigabytes_of_masks(effects: int) -> None:
    """Masks of 17,000 facts take 2 kB, and each of 135,000 actions has some."""
    near = {"name": "near", "param_types": ["item", "item"]}
    apart = {"predicate": "near", "params": ["i", "j"], "is_true": False}
    met = {**apart, "is_true": True}
    effect = {"type": "conditional", "param": "i", "conditions": [apart], "fx": [met], "sfx": []}
    wave = {"precons": [apart], "immediate_fx": [met], "language_description": "Wave {i} at {j}"}
    wave["sfx"] = [effect] * effects
    many = [{**wave, "name": f"wave{n}"} for n in range(8 if effects else 28)]
    domain = changed(DOMAIN, "predicate_defs", to=[*DOMAIN["predicate_defs"], near])
    domain["action_defs"] = many
    items = [{"name": "leek", "x": n % 3, "y": n // 3 % 3} for n in range(130)]
    problem = changed(PROBLEM, "objects", "item", to=[{**items[0], "id": "first"}, *items[1:]])
    problem["config"] = {}
    (fault,) = faults_of(domain, problem)
    assert re.fullmatch(
        r"too many objects: the actions can take [\d,]+ MiB; at most 768 MiB are allowed", fault
    )


@pytest.mark.parametrize("field", ["objects", "kinds"])
def test_large_files_report_the_first_fault_of_a_list(field: str) -> None:
    """A hundred thousand errors would take half a gigabyte."""
    if field == "objects":
        raw, model = {**PROBLEM, "objects": {"item": [{}] * 100_000}}, ProblemFile
    else:
        raw, model = {**DOMAIN, "kinds": {"item": [0] * 100_000}}, DomainFile
    with pytest.raises(FileError) as caught:
        validate(raw, model, "x.json")
    assert 1 <= len(caught.value.faults) <= 5
    assert "[0]" in str(caught.value)
