"""Valid certificates, the faults that check reports, and certificates by task name."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import robotouille
from robotouille import (
    FileError,
    RobotouilleError,
    State,
    UnknownTaskError,
    World,
    load_certificate,
    load_task,
)
from robotouille.certification.certificate import (
    Certificate,
    Deadline,
    ExpansionBudget,
    certify,
    check,
    json_text,
    prove_again,
    read_certificate,
    write_certificate,
)
from robotouille.planning.plan import Limits, Plan, Proof, SearchResult
from tests.support.solvers import answering, proving

FIELDS = tuple(Certificate.model_fields)
TASK = load_task("synchronous/01")


@cache
def certificate() -> Certificate:
    return certify(TASK, proving, Limits(expansions=100, states=200))


def changed(**fields: Any) -> Certificate:
    """Return the certificate with other values and a matching digest."""
    row = certificate().model_dump(mode="json") | fields
    draft = Certificate.model_validate(row)
    return draft.model_copy(update={"digest": draft.content})


def test_certificate_contains_the_result() -> None:
    found = certificate()
    assert (found.length, found.bound, found.optimal, found.gap) == (8, 8, True, 0)
    assert (found.task, found.seats, found.instance) == (TASK.name, 1, TASK.digest)
    assert found.limits == ExpansionBudget(expansions=100, states=200)
    assert found.plan is not None
    assert found.plan[0] == "move(robot1, table3, table1)"
    assert check(found, TASK) == []


def test_certificates_are_reproducible(tmp_path: Path) -> None:
    path = tmp_path / "one.certificate.json"
    write_certificate(certificate(), path)
    again = read_certificate(path)
    assert again == certificate()
    assert json_text(again).encode() == path.read_bytes()
    assert tuple(json.loads(path.read_text())) == FIELDS
    assert path.read_text().startswith('{\n  "format": "robotouille-certificate/1",\n')
    assert path.read_text().endswith("}\n")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


OTHER_VALUES: dict[str, st.SearchStrategy[Any]] = {
    "format": st.just("robotouille-certificate/2"),
    "task": st.text("ab/", max_size=9),
    "seats": st.integers(0, 9),
    "timing": st.just("people"),
    "instance": st.text("0123456789abcdef", min_size=32, max_size=32),
    "start": st.just("0" * 32),
    "length": st.none() | st.integers(0, 99),
    "bound": st.integers(0, 99),
    "optimal": st.booleans(),
    "proof": st.sampled_from([proof.value for proof in Proof]),
    "unsolvable": st.booleans(),
    "planner": st.text("ab ", max_size=9),
    "expansions": st.integers(0, 99),
    "limits": st.builds(lambda n: {"expansions": n, "states": n, "seconds": None}, st.integers(0)),
    "plan": st.none()
    | st.lists(st.sampled_from(["-", "move(robot1, table3, table1)"]), max_size=9),
    "digest": st.text("0123456789abcdef", min_size=32, max_size=32),
}


@given(st.data())
def test_changes_are_detected(data: st.DataObject) -> None:
    field = data.draw(st.sampled_from(FIELDS))
    row = certificate().model_dump(mode="json")
    value = data.draw(OTHER_VALUES[field].filter(lambda v: v != row[field]))
    try:
        found = Certificate.model_validate(row | {field: value})
    except ValueError:
        return
    assert check(found, TASK)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"task": "other"}, "instance: expected"),
        ({"seats": 2}, "seats: expected 1, found 2"),
        ({"timing": "people"}, "timing: expected benchmark, found people"),
        ({"instance": "0" * 32}, f"instance: expected {TASK.digest}"),
        ({"start": "0" * 32}, "start: expected null"),
        ({"length": 7}, "length: 7, but the plan has 8 steps"),
        ({"length": None}, "length: null, but the plan has 8 steps"),
        ({"plan": None}, "length: 8, but the plan has null steps"),
        ({"bound": 9}, "bound: 9 is greater than the length 8"),
        ({"bound": 7}, "optimal: the length is 8 and the bound 7"),
        ({"optimal": False}, "optimal: the length is 8 and the bound 8"),
        ({"proof": "none"}, "proof: none, but the bound is 8"),
        ({"unsolvable": True}, "unsolvable: true, but there is a plan"),
    ],
)
def test_contradictory_claims_are_reported(fields: dict[str, Any], words: str) -> None:
    assert words in "\n".join(check(changed(**fields), TASK))


@pytest.mark.parametrize(
    ("number", "line", "words"),
    [
        (0, "-", "plan: step 2"),
        (7, "-", "the goal is not reached"),
        (2, "dance(robot1)", "plan: line 3: no action 'dance'"),
        (2, "# nothing", "plan: expected one string for each step"),
        (2, "-\n-", "plan: expected one string for each step"),
        (2, "move(robot1,table1,table2)", "plan: expected one string for each step"),
    ],
)
def test_failing_plan_is_reported(number: int, line: str, words: str) -> None:
    plan = list(certificate().plan or ())
    plan[number] = line
    assert words in "\n".join(check(changed(plan=plan), TASK))


def test_steps_after_the_goal_are_reported() -> None:
    late = changed(plan=[*(certificate().plan or ()), "-"], length=9, bound=9)
    assert check(late, TASK) == ["plan: the goal is reached in step 8 of 9"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plan": Plan(((), ()))}, "plan: the goal is not reached in 2 steps"),
        ({"bound": 9}, "bound: 9 is greater than the length 8"),
        ({"proof": Proof.NONE}, "proof: none"),
        ({"unsolvable": True}, "unsolvable: true, but there is a plan"),
    ],
)
def test_wrong_result_is_not_certified(changes: Any, words: str) -> None:
    with pytest.raises(RobotouilleError, match=words) as error:
        certify(TASK, answering(**changes))
    assert "synchronous/01_cheese_sandwich@1: wrong result of proving 1.0" in str(error.value)


def test_certificate_without_plan() -> None:
    for changes in ({"bound": 3}, {"bound": 3, "unsolvable": True}):
        found = certify(TASK, answering(plan=None, **changes))
        assert (found.length, found.gap, found.optimal) == (None, None, False)
        assert check(found, TASK) == []


def test_certificate_from_a_later_state() -> None:
    world = World(TASK)
    start = world.step(world.initial, [world.action("move", "robot1", "table3", "table1")]).state
    found = certify(TASK, proving, start=start)
    assert (found.start, found.length) == (start.digest, 7)
    assert check(found, TASK, start) == []
    assert check(found, TASK) == [f"start: expected null, found {start.digest}"]


@pytest.mark.parametrize(
    ("claimed", "answered", "proven"),
    [
        ({}, {}, True),
        ({}, {"bound": 7}, False),
        ({}, {"plan": None}, False),
        ({"bound": 5}, {}, True),
        ({"bound": 5}, {"bound": 4}, False),
        ({"bound": 5}, {"plan": None, "bound": 5}, True),
        ({"bound": 5}, {"plan": None, "bound": 9}, False),
        ({"bound": 5}, {"plan": None, "bound": 5, "unsolvable": True}, False),
        ({"plan": None, "unsolvable": True}, {"plan": None, "unsolvable": True}, True),
        ({"plan": None, "unsolvable": True}, {}, False),
    ],
)
def test_prove_again(claimed: Any, answered: Any, proven: bool) -> None:
    found = certify(TASK, answering(**claimed))
    assert prove_again(found, TASK, answering(**answered)) is proven


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"bound": -1}, "bound: input should be greater than or equal to 0, found -1"),
        ({"bound": "8"}, "bound: input should be a valid integer, found '8'"),
        ({"proof": "hearsay"}, "proof: input should be"),
        ({"format": "robotouille-certificate/2"}, "format: input should be"),
        ({"lenght": 8}, "lenght: unknown field 'lenght'; did you mean 'length'?"),
    ],
)
def test_invalid_field_is_named(tmp_path: Path, fields: dict[str, Any], words: str) -> None:
    path = tmp_path / "x.certificate.json"
    path.write_text(json.dumps(certificate().model_dump(mode="json") | fields))
    with pytest.raises(FileError) as error:
        read_certificate(path)
    assert f"{path}: {words}" in str(error.value)


def test_truncated_file_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "x.certificate.json"
    path.write_text(json_text(certificate())[:-40])
    with pytest.raises(FileError, match="is not JSON"):
        read_certificate(path)


def test_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.certificate.json"
    path.write_text("before")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(FileError, match="cannot be written: No space left on device"):
        write_certificate(certificate(), path)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_seconds_are_recorded_only_if_time_ended_the_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    still = SimpleNamespace(monotonic=lambda: 1000.0)
    monkeypatch.setattr("robotouille.certification.certificate.time", still)

    def waiting(world: World, start: State | None = None, **options: Any) -> SearchResult:
        assert options["limits"].stop()
        return replace(proving(world, start), bound=1)

    cut = certify(TASK, waiting, Limits(stop=Deadline(0)))
    assert cut.limits == ExpansionBudget(seconds=0)
    deadline = Deadline(60)
    assert certify(TASK, proving, Limits(stop=deadline)).limits == ExpansionBudget()
    deadline.strike()
    assert certify(TASK, waiting, Limits(stop=deadline)).limits == ExpansionBudget(seconds=0)


@pytest.mark.parametrize(
    "name", ["synchronous/01", "multi_agent/01@3", load_task("synchronous/02").instances()[0]]
)
def test_certificate_is_found_by_task_name(name: str) -> None:
    certificate, task = load_certificate(name), load_task(name)
    assert certificate == load_certificate(task)
    assert (certificate.task, certificate.seats) == (task.name.split("/")[-1], task.seats)
    assert check(certificate, task) == []
    assert isinstance(certificate, robotouille.Certificate)


def test_missing_certificate_is_an_error() -> None:
    task = load_task("synchronous/01")
    with pytest.raises(FileError, match="timing: expected people, found benchmark"):
        load_certificate(load_task("synchronous/01", timing="people"))
    with pytest.raises(UnknownTaskError):
        load_certificate("synchronous/nothing")
    with pytest.raises(FileError, match=r"certificate\.json"):
        load_certificate(type(task).from_json(task.to_json()))
