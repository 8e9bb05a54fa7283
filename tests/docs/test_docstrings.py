"""The docstrings of the public API, of which the reference pages are made."""

from __future__ import annotations

import builtins
import importlib
import importlib.util
import inspect
import re
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import pytest

from robotouille import errors

FACES = (
    "robotouille",
    "robotouille.episode",
    "robotouille.planning",
    "robotouille.replay",
    "robotouille.generation",
    "robotouille.certification",
    "robotouille.protocol.codec",
    "robotouille.protocol.frames",
    "robotouille.protocol.states",
    "robotouille_client",
    "robotouille_server",
    *(["robotouille.envs"] if importlib.util.find_spec("gymnasium") else []),
)


def members(thing: type) -> Iterator[tuple[str, Any]]:
    """The public methods and properties of a class, also those that it has from ours."""
    for base in thing.__mro__:
        if base.__module__.startswith("robotouille"):
            for name, member in vars(base).items():
                if not name.startswith("_") or name == "__call__":
                    yield f"{thing.__name__}.{name}", getattr(member, "__func__", member)


def exported() -> Iterator[tuple[str, str, Any]]:
    """Every class, function, method and property of the faces: the face, its name and itself."""
    for face in FACES:
        module = importlib.import_module(face)
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.isclass(thing):
                yield face, name, thing
                yield from ((face, *member) for member in members(thing))
            elif inspect.isfunction(thing):
                yield face, name, thing


DOCUMENTED = [
    (face, name, thing)
    for face, name, thing in exported()
    if isinstance(thing, type | property | cached_property) or inspect.isfunction(thing)
]


def docstring(thing: Any) -> str:
    """What the reference shows of a thing: nothing of an overridden method's."""
    return inspect.cleandoc(thing.__doc__ or "")


def section(text: str, title: str) -> list[str]:
    """The names that a section of a docstring explains."""
    found = re.search(rf"^{title}:\n((?:    .*\n|\n)+)", f"{text}\n", re.MULTILINE)
    return re.findall(r"^    (\S+): ", found[1], re.MULTILINE) if found else []


def parameters(thing: Any) -> set[str]:
    """The names of what a function, or a class, takes."""
    return set(inspect.signature(thing).parameters) - {"self", "cls"}


def test_faces_are_found() -> None:
    names = {f"{face}.{name}" for face, name, _ in DOCUMENTED}
    assert {"robotouille.World.step", "robotouille_client.Game.poll"} <= names
    assert len(names) > 300


@pytest.mark.parametrize("face", FACES)
def test_docstrings_speak_of_what_there_is(face: str) -> None:
    """Whatever takes arguments has one, and it explains no other arguments."""
    wrong = []
    for name, thing in things_of(face):
        text = docstring(thing)
        explained = {argument.lstrip("*") for argument in section(text, "Args")}
        needless = inspect.isfunction(thing) and not parameters(thing)
        if not (text or needless) or (explained and not explained <= parameters(thing)):
            wrong.append(name)
    assert wrong == []


@pytest.mark.parametrize("face", FACES)
def test_errors_of_docstrings_exist(face: str) -> None:
    unknown = [
        (name, error)
        for name, thing in things_of(face)
        for error in section(docstring(thing), "Raises")
        if not is_error(error, thing, face)
    ]
    assert unknown == []


def things_of(face: str) -> list[tuple[str, Any]]:
    return [(name, thing) for of, name, thing in DOCUMENTED if of == face]


def is_error(name: str, thing: Any, face: str) -> bool:
    """Whether a docstring's error is one that a reader finds: ours, Python's or the module's."""
    own = inspect.getmodule(getattr(thing, "func", None) or getattr(thing, "fget", None) or thing)
    places = (errors, builtins, own, importlib.import_module(face))
    found = next((getattr(p, name) for p in places if hasattr(p, name)), None)
    return isinstance(found, type) and issubclass(found, Exception)
