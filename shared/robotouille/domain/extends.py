"""`extends`: a file that says only in what it differs from another one.

What is extended is looked for in the folder of the file that extends it and among the shipped
files, nowhere else. The result is a whole file without the field: that is what recordings and
messages carry. See docs/formats.md, "Extending files".
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Generic, TypeVar

from robotouille.domain.files import is_file, read_json, validate
from robotouille.domain.schema import Schema
from robotouille.errors import Fault, FileError, did_you_mean
from robotouille.resources import data_folder

__all__ = [
    "MAX_EXTENDS",
    "FileKind",
    "by",
    "chain_of",
    "each",
    "in_own_words",
    "read_extending",
    "union",
]

MAX_EXTENDS = 8
"""Files that may extend one another in a chain."""

S = TypeVar("S", bound=Schema)
Json = dict[str, Any]
Merge = Callable[[Any, Any], Any]
"""What is extended and what extends it, as JSON values, to the result."""


def _later(base: Any, own: Any) -> Any:
    return own


def by(key: str) -> Merge:
    """Lists of definitions: those that have a name of the other list take its place there."""

    def merge(base: Any, own: Any) -> Any:
        if not isinstance(base, list) or not isinstance(own, list):
            return own
        waiting: dict[Any, list[Any]] = {}
        for definition in own:
            waiting.setdefault(_name(definition, key), []).append(definition)
        mine, result = set(waiting), []
        for definition in base:
            name = _name(definition, key)
            result += waiting.pop(name, []) if name in mine else [definition]
        return result + [definition for rest in waiting.values() for definition in rest]

    return merge


def union(base: Any, own: Any) -> Any:
    """Lists of names: what is new comes last."""
    if not isinstance(base, list) or not isinstance(own, list):
        return own
    return base + [name for name in own if name not in base]


def each(*, fields: Merge = _later, **special: Merge) -> Merge:
    """Objects: field by field."""

    def merge(base: Any, own: Any) -> Any:
        if not isinstance(base, dict) or not isinstance(own, dict):
            return own
        result = dict(base)
        for name, value in own.items():
            rule = special.get(name, fields)
            result[name] = rule(base[name], value) if name in base else value
        return result

    return merge


@dataclass(frozen=True, slots=True)
class FileKind(Generic[S]):
    """One kind of file that can be extended.

    `folder` has the shipped ones, called NAME + `shipped`; those of others are called
    NAME + `beside`. `merge` puts two together, `keys` says by which field the definitions of a
    list are told apart. `complete` fills in what a file that is extended leaves unsaid; `check`
    finds what the schema does not see.
    """

    model: type[S]
    folder: str
    shipped: str
    beside: str
    merge: Merge
    keys: tuple[tuple[str, str], ...] = ()
    complete: Callable[[S], S] = lambda file: file
    check: Callable[[S], list[Fault]] = lambda file: []


def read_extending(path: Path, kind: FileKind[S]) -> S:
    """A file together with what it extends; FileError lists all its faults."""
    return _read(path, kind, ())


def chain_of(path: Path, kind: FileKind[S]) -> tuple[Path, ...]:
    """A file and all that it extends, itself first; FileError where one of them is not there."""
    chain: tuple[Path, ...] = (path,)
    while True:
        raw = read_json(chain[-1])
        name = raw.get("extends") if isinstance(raw, dict) else None
        if name is None:
            return chain
        chain += (_find(name, chain[-1], kind, chain),)


def _read(path: Path, kind: FileKind[S], chain: tuple[Path, ...]) -> S:
    raw = read_json(path)
    if not isinstance(raw, dict) or raw.get("extends") is None:
        return validate(raw, kind.model, str(path))
    own = {name: value for name, value in raw.items() if name != "extends"}
    extended = _find(raw["extends"], path, kind, (*chain, path))
    base = kind.complete(_read(extended, kind, (*chain, path)))
    merged = kind.merge(_as_json(base, own), own)
    try:
        result = validate(merged, kind.model, str(path))
    except FileError as error:
        raise FileError(str(path), in_own_words(error.faults, raw, merged, kind)) from None
    faults = kind.check(result)
    if any(fault.severity == "error" for fault in faults):
        raise FileError(str(path), in_own_words(faults, raw, merged, kind))
    return result


def _as_json(base: Schema, own: Json) -> Json:
    """What is extended, as it counts for a file: its own name is that file's matter.

    A list of names that the extended file leaves out has its default there.
    """
    raw = base.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude={"schema_uri"})
    for name, field in type(base).model_fields.items():
        if name in own and name not in raw and isinstance(field.default, tuple):
            raw[name] = list(field.default)
    return {name: value for name, value in raw.items() if name != "name"}


def _is_within(path: Path, folders: tuple[Path, ...]) -> bool:
    """Whether a file is in one of the folders, links followed."""
    return any(path.is_relative_to(folder) for folder in folders)


def _find(name: Any, path: Path, kind: FileKind[Any], chain: tuple[Path, ...]) -> Path:
    if not isinstance(name, str) or not name:
        raise FileError(str(path), [Fault("extends", f"should be a name, found {name!r}")])
    parts = PurePosixPath(name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts or ":" in name:
        message = f"{name!r} leaves the folder; name a file in it, or a shipped one"
        raise FileError(str(path), [Fault("extends", message)])
    shipped = data_folder(kind.folder)
    if name.endswith(".json"):
        candidates = [path.parent / name, shipped / name]
    else:
        candidates = [path.parent / f"{name}{kind.beside}", shipped / f"{name}{kind.shipped}"]
    allowed = (path.parent.resolve(), shipped.resolve())
    found = [c for c in candidates if is_file(c) and _is_within(c.resolve(), allowed)]
    others = [c for c in found if c.resolve() != path.resolve()]
    if not found:
        known = [p.name.removesuffix(kind.shipped) for p in shipped.glob(f"*{kind.shipped}")]
        message = f"there is no file {candidates[0].name!r} beside it, and none is shipped"
        raise FileError(str(path), [Fault("extends", message + did_you_mean(name, known))])
    target = (others or found)[0]
    if target.resolve() in [p.resolve() for p in chain]:
        circle = " → ".join(p.name for p in (*chain, target))
        raise FileError(str(path), [Fault("extends", f"goes round in a circle: {circle}")])
    if len(chain) >= MAX_EXTENDS:
        names = " → ".join(p.name for p in (*chain, target))
        message = f"more than {MAX_EXTENDS} files extend one another: {names}"
        raise FileError(str(path), [Fault("extends", message)])
    return target


def _name(definition: Any, key: str) -> Any:
    """What a definition is called; what has no name is like nothing else."""
    name = definition.get(key) if isinstance(definition, dict) else None
    return name if isinstance(name, str) else id(definition)


_PLACE = re.compile(r"(\w+)\[(\d+)\](.*)", re.DOTALL)


def in_own_words(
    faults: Iterable[Fault], own: Json, merged: Json, kind: FileKind[Any]
) -> list[Fault]:
    """Faults of the whole with their places in the file that extends, where they are in it."""
    return [_in_own_words(fault, own, merged, dict(kind.keys)) for fault in faults]


def _in_own_words(fault: Fault, own: Json, merged: Json, keys: dict[str, str]) -> Fault:
    place = _PLACE.fullmatch(fault.path)
    if place is None or place[1] not in keys:
        return fault
    field, key = place[1], keys[place[1]]
    try:
        definition = merged[field][int(place[2])]
    except (KeyError, IndexError):
        return fault
    definitions = own.get(field)
    for index, mine in enumerate(definitions if isinstance(definitions, list) else ()):
        if _name(mine, key) == _name(definition, key):
            return Fault(f"{field}[{index}]{place[3]}", fault.message, fault.severity)
    words = f"{fault.message} ({_name(definition, key)!r} is in {own['extends']!r}, extended here)"
    return Fault(f"{field}{place[3]}", words, fault.severity)
