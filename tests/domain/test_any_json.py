"""Whatever JSON a domain or problem is made of, it is refused with a FileError or it plays."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import FileError, World
from robotouille.domain.input_bindings import INPUT_FILES
from robotouille.domain.json_files import validate
from robotouille.domain.related_files import FileKind, read_extending
from robotouille.domain.rendering import RENDERING_FILES
from robotouille.domain.schema import DomainFile, InputFile, ProblemFile
from robotouille.domain.task import DOMAIN_FILES, Task, build_task
from robotouille.world.lint import lint_task
from tests.support.broken_files import DOMAIN, PROBLEM, changed
from tests.support.thorough import thorough

NAMES = sorted(
    {*DOMAIN, *PROBLEM, "stations", "items", "type", "sfx", "param", "default", "x", "y", "id"}
)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-2, 5)
    | st.integers()
    | st.floats(allow_nan=False)
    | st.sampled_from(
        ["", "p", "i", "s", "n", "iscut", "at", "station", "creation", "{", "{0}", "~"]
    )
    | st.text(max_size=5)
)
JSON = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(NAMES) | st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)
often = thorough(100)


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all parts of a JSON value."""
    inside: Any = ()
    if isinstance(value, dict):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    found = [p for key, inner in inside for p in places(inner, (*path, key))]
    return [path, *found] if path else found


@often
@given(value=JSON)
def test_any_value_is_accepted_or_refused(value: Any) -> None:
    for model in (DomainFile, ProblemFile, InputFile):
        try:
            validate(value, model, "file")
        except FileError as error:
            assert error.faults
    try:
        Task.from_json(value)
    except FileError as error:
        assert error.faults


@often
@given(path=st.sampled_from(places(DOMAIN)), value=JSON | st.just(...))
def test_any_value_anywhere_in_a_domain(path: tuple[Any, ...], value: Any) -> None:
    refused_or_played(changed(DOMAIN, *path, to=value), PROBLEM)


@often
@given(path=st.sampled_from(places(PROBLEM)), value=JSON | st.just(...))
def test_any_value_anywhere_in_a_problem(path: tuple[Any, ...], value: Any) -> None:
    refused_or_played(DOMAIN, changed(PROBLEM, *path, to=value))


def refused_or_played(domain: Any, problem: Any) -> None:
    try:
        task = build_task(
            "any",
            validate(domain, DomainFile, "domain"),
            validate(problem, ProblemFile, "problem"),
        )
    except FileError as error:
        assert error.faults
        return
    world = World(task)
    state = world.initial
    for turn in range(4):
        actions = state.actions(world.players[0])
        if actions:
            state = state.step(actions[turn % len(actions)]).state
    assert state.text()
    lint_task(task)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [DOMAIN_FILES, INPUT_FILES, RENDERING_FILES], ids=lambda k: k.beside
)
@often
@given(data=st.data())
def test_any_value_in_a_file_that_extends(kind: FileKind[Any], data: st.DataObject) -> None:
    fields = sorted(kind.model.model_fields.keys() - {"extends"})
    drawn = data.draw(st.dictionaries(st.sampled_from(fields), JSON, max_size=3))
    name = data.draw(st.just("robotouille") | JSON)
    value = {"name": "any", **drawn} if kind is DOMAIN_FILES else drawn
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"any{kind.beside}"
        path.write_text(json.dumps({**value, "extends": name}))
        try:
            read_extending(path, kind)
        except FileError as error:
            assert error.faults
