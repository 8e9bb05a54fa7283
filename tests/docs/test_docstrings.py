"""Docstrings of the public API, and the page that lists its names."""

from __future__ import annotations

import builtins
import importlib
import importlib.util
import inspect
import re
from collections.abc import Iterator
from functools import cached_property
from types import ModuleType
from typing import Any

import pytest

import robotouille
from robotouille import Attempt, State, Step, Task, World, errors, planning, replay
from robotouille.planning import SearchResult
from robotouille.replay import Measures, SeatMeasures, Transition
from robotouille.world.arrays.encoding import Encoding
from tests.support.pages import read

PACKAGES = (
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
    """Yield the public methods and properties of a class, inherited ones included."""
    for base in thing.__mro__:
        if base.__module__.startswith("robotouille"):
            for name, member in vars(base).items():
                if not name.startswith("_") or name == "__call__":
                    yield f"{thing.__name__}.{name}", getattr(member, "__func__", member)


def public_names(module: ModuleType) -> list[str]:
    """Return the names of `__all__`, or those that a module without it defines."""
    if "__all__" in vars(module):
        return list(module.__all__)
    own = [n for n, thing in vars(module).items() if inspect.getmodule(thing) is module]
    return [name for name in own if not name.startswith("_")]


def exported() -> Iterator[tuple[str, str, Any]]:
    """Yield every public class, function, method and property with its package and name."""
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in public_names(module):
            thing = getattr(module, name)
            if inspect.isclass(thing):
                yield package, name, thing
                yield from ((package, *member) for member in members(thing))
            elif inspect.isfunction(thing):
                yield package, name, thing


DOCUMENTED = [
    (package, name, thing)
    for package, name, thing in exported()
    if isinstance(thing, type | property | cached_property) or inspect.isfunction(thing)
]


def docstring(thing: Any) -> str:
    """Return the docstring without indentation, as the reference shows it."""
    return inspect.cleandoc(thing.__doc__ or "")


def section(text: str, title: str) -> list[str]:
    """Return the names that a section of a docstring explains."""
    found = re.search(rf"^{title}:\n((?:    .*\n|\n)+)", f"{text}\n", re.MULTILINE)
    return re.findall(r"^    (\S+): ", found[1], re.MULTILINE) if found else []


def parameters(thing: Any) -> set[str]:
    """Return the names of the parameters of a function or class."""
    return set(inspect.signature(thing).parameters) - {"self", "cls"}


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_explain_real_parameters(package: str) -> None:
    """Everything that takes arguments has a docstring, which explains only real parameters."""
    wrong = []
    for name, thing in things_of(package):
        text = docstring(thing)
        explained = {argument.lstrip("*") for argument in section(text, "Args")}
        needless = inspect.isfunction(thing) and not parameters(thing)
        if not (text or needless) or (explained and not explained <= parameters(thing)):
            wrong.append(name)
    assert wrong == []


@pytest.mark.parametrize("package", PACKAGES)
def test_documented_errors_exist(package: str) -> None:
    unknown = [
        (name, error)
        for name, thing in things_of(package)
        for error in section(docstring(thing), "Raises")
        if not is_error(error, thing, package)
    ]
    assert unknown == []


def things_of(package: str) -> list[tuple[str, Any]]:
    return [(name, thing) for of, name, thing in DOCUMENTED if of == package]


def is_error(name: str, thing: Any, package: str) -> bool:
    """Return whether a documented error is one of ours, Python's or the module's."""
    own = inspect.getmodule(getattr(thing, "func", None) or getattr(thing, "fget", None) or thing)
    places = (errors, builtins, own, importlib.import_module(package))
    found = next((getattr(p, name) for p in places if hasattr(p, name)), None)
    return isinstance(found, type) and issubclass(found, Exception)


CLASSES = [
    *(State, World, Step, Attempt, Task),
    *(SearchResult, Transition, Measures, SeatMeasures, Encoding),
]


def names() -> Iterator[str]:
    for face in (robotouille, planning, replay):
        yield from face.__all__
    for each in CLASSES:
        yield from (name for name in vars(each) if not name.startswith("_"))


def test_every_name_is_on_the_page() -> None:
    page = read("api.md")
    assert [name for name in sorted(set(names())) if not re.search(rf"\b{name}\b", page)] == []
