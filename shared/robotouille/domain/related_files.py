"""Files that belong to a domain, and files that extend another file.

A file with `extends` has only its differences from the extended file. The extended file must be
in the same folder or shipped. Reading gives a complete file without the field, which recordings
and messages contain. See docs/file_formats.md, "Extending files", and
docs/decisions/0026-extends.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Generic, TypeVar

from robotouille.domain.json_files import read_json, validate
from robotouille.domain.schema import DomainFile, Schema
from robotouille.errors import Fault, FileError, RobotouilleError, did_you_mean
from robotouille.files.reading import is_file
from robotouille.installation import data_folder

KITCHEN_RENDERING = "robotouille.json"
"""Rendering of domains without a rendering of their own."""


def input_path(domain: DomainFile, beside: Path | None) -> Path | None:
    """Return a domain's input file: NAME.input.json in its folder, the file it names, or None."""
    own = f"{domain.name}.input.json"
    named = Path(domain.input_json or own).name
    candidates = [beside / own, beside / named] if beside is not None else []
    return next(filter(is_file, [*candidates, data_folder("domains") / named]), None)


def rendering_path(domain: DomainFile, beside: Path | None) -> Path:
    """Return a domain's rendering.

    It is NAME.rendering.json in the domain's folder, the file that the domain names, or the
    kitchen's rendering.
    """
    shipped = data_folder("renderings")
    named = Path(domain.rendering_json or f"{domain.name}.json").name
    candidates = [shipped / named]
    if beside is not None:
        candidates = [beside / f"{domain.name}.rendering.json", beside / named, *candidates]
    # The domain itself can be NAME.json, which is also the default name of its rendering.
    found = (path for path in candidates if is_file(path) and not _is_domain(path))
    return next(found, shipped / KITCHEN_RENDERING)


def shipped_rendering(name: str) -> Path:
    """Return the path of a shipped rendering.

    Raises:
        RobotouilleError: There is no such rendering; the message lists all.
    """
    known = _names("renderings")
    if name not in known:
        listed = ", ".join(sorted(known))
        raise RobotouilleError(
            f"unknown rendering {name!r}{did_you_mean(name, known)} (available: {listed})"
        )
    return data_folder("renderings") / f"{name}.json"


def other_renderings() -> list[str]:
    """Return the shipped renderings that no domain uses by default."""
    return sorted(_names("renderings") - _names("domains"))


def _names(folder: str) -> set[str]:
    return {path.stem for path in data_folder(folder).glob("*.json")}


def companion_folder(folder: str, name: str, beside: Path | None) -> Path:
    """Return a folder next to a problem, or else the shipped folder of this name."""
    name = Path(name).name
    if beside is not None and (beside / name).is_dir():
        return beside / name
    return data_folder(folder) / name


def _is_domain(path: Path) -> bool:
    """Return whether a file is a domain: unlike renderings, domains have a name."""
    try:
        raw = read_json(path)
    except FileError:
        return False  # Reading it as a rendering reports the fault.
    return isinstance(raw, dict) and "name" in raw


MAX_EXTENDS = 8
"""Largest number of files that extend each other in a chain."""

S = TypeVar("S", bound=Schema)
Json = dict[str, Any]
Merge = Callable[[Any, Any], Any]
"""Function that merges the JSON value of an extended file with that of the extending file."""


def _later(base: Any, own: Any) -> Any:
    return own


def by(key: str) -> Merge:
    """Return a merge of lists of definitions, in which a definition replaces its namesake."""

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
    """Merge lists of names, with new names last."""
    if not isinstance(base, list) or not isinstance(own, list):
        return own
    return base + [name for name in own if name not in base]


def each(*, fields: Merge = _later, **special: Merge) -> Merge:
    """Return a merge of JSON objects field by field, with a rule for each `special` field."""

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
    """A kind of file that can be extended.

    Attributes:
        folder: Folder of the shipped files.
        shipped: End of a shipped file's name, after the domain's name.
        beside: End of the name of a file next to a problem.
        merge: Function that merges an extended and an extending file.
        keys: Pairs of a list and the field that identifies its definitions.
        complete: Function that adds defaults to an extended file.
        check: Function that finds faults that the schema cannot express.
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
    """Read a file and merge it with the files that it extends.

    Raises:
        FileError: A file is invalid; the error lists all its faults.
    """
    return _read(path, kind, ())


def chain_of(path: Path, kind: FileKind[S]) -> tuple[Path, ...]:
    """Return a file and all files that it extends, itself first.

    Raises:
        FileError: A file is missing or cannot be read.
    """
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
        file = validate(raw, kind.model, str(path))
        faults = kind.check(file)
        if any(fault.severity == "error" for fault in faults):
            raise FileError(str(path), faults)
        return file
    own = {name: value for name, value in raw.items() if name != "extends"}
    extended = _find(raw["extends"], path, kind, (*chain, path))
    base = kind.complete(_read(extended, kind, (*chain, path)))
    merged = kind.merge(_as_json(base, own), own)
    try:
        result = validate(merged, kind.model, str(path))
    except FileError as error:
        raise FileError(
            str(path), faults_in_extending_file(error.faults, raw, merged, kind)
        ) from None
    faults = kind.check(result)
    if any(fault.severity == "error" for fault in faults):
        raise FileError(str(path), faults_in_extending_file(faults, raw, merged, kind))
    return result


def _as_json(base: Schema, own: Json) -> Json:
    """Return an extended file as JSON for merging, without its name.

    A list that the extending file has and the extended file omits gets its default, so that names
    are added to the default instead of replacing it.
    """
    raw = base.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude={"schema_uri"})
    for name, field in type(base).model_fields.items():
        if name in own and name not in raw and isinstance(field.default, tuple):
            raw[name] = list(field.default)
    return {name: value for name, value in raw.items() if name != "name"}


def check_is_inside(name: str, path: Path, field: str) -> None:
    """Check that a name in a field of a file does not lead out of the file's folder.

    Raises:
        FileError: It does, such as an absolute path.
    """
    parts = PurePosixPath(name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts or ":" in name:
        message = f"{name!r} is outside the folder; expected a file in it, or a shipped file"
        raise FileError(str(path), [Fault(field, message)])


def files_within(candidates: Iterable[Path], folders: Iterable[Path]) -> list[Path]:
    """Return the candidates that are files in the folders.

    Resolving follows links: a link in a folder must not lead to a file elsewhere.
    """
    allowed = [folder.resolve() for folder in folders]
    files = (path for path in candidates if is_file(path))
    return [f for f in files if any(f.resolve().is_relative_to(folder) for folder in allowed)]


def _find(name: Any, path: Path, kind: FileKind[Any], chain: tuple[Path, ...]) -> Path:
    if not isinstance(name, str) or not name:
        raise FileError(str(path), [Fault("extends", f"expected a name, found {name!r}")])
    check_is_inside(name, path, "extends")
    shipped = data_folder(kind.folder)
    if name.endswith(".json"):
        candidates = [path.parent / name, shipped / name]
    else:
        candidates = [path.parent / f"{name}{kind.beside}", shipped / f"{name}{kind.shipped}"]
    found = files_within(candidates, (path.parent, shipped))
    others = [c for c in found if c.resolve() != path.resolve()]
    if not found:
        known = [p.name.removesuffix(kind.shipped) for p in shipped.glob(f"*{kind.shipped}")]
        message = f"no file {candidates[0].name!r} in its folder or among the shipped files"
        raise FileError(str(path), [Fault("extends", message + did_you_mean(name, known))])
    target = (others or found)[0]
    if target.resolve() in [p.resolve() for p in chain]:
        circle = " → ".join(p.name for p in (*chain, target))
        raise FileError(
            str(path), [Fault("extends", f"files extend each other in a circle: {circle}")]
        )
    if len(chain) >= MAX_EXTENDS:
        names = " → ".join(p.name for p in (*chain, target))
        message = f"more than {MAX_EXTENDS} files extend each other: {names}"
        raise FileError(str(path), [Fault("extends", message)])
    return target


def _name(definition: Any, key: str) -> Any:
    """Return a definition's name; without one, an id that equals no other name."""
    name = definition.get(key) if isinstance(definition, dict) else None
    return name if isinstance(name, str) else id(definition)


_PLACE = re.compile(r"(\w+)\[(\d+)\](.*)", re.DOTALL)


def faults_in_extending_file(
    faults: Iterable[Fault], own: Json, merged: Json, kind: FileKind[Any]
) -> list[Fault]:
    """Return faults of the merged file with their places in the extending file."""
    return [_fault_in_extending_file(fault, own, merged, dict(kind.keys)) for fault in faults]


def _fault_in_extending_file(fault: Fault, own: Json, merged: Json, keys: dict[str, str]) -> Fault:
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
    words = f"{fault.message} ({_name(definition, key)!r} comes from {own['extends']!r})"
    return Fault(f"{field}{place[3]}", words, fault.severity)
