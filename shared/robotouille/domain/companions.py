"""Where the files lie that belong to a domain: its input file, its rendering, its pictures.

Those beside a problem come before those that are shipped. Only the last part of a name counts,
since a domain may come from a stranger.
"""

from __future__ import annotations

from pathlib import Path

from robotouille.domain.files import is_file, read_json
from robotouille.domain.schema import DomainFile
from robotouille.errors import FileError, RobotouilleError, did_you_mean
from robotouille.resources import data_folder

__all__ = [
    "KITCHEN_RENDERING",
    "companion_folder",
    "input_path",
    "other_renderings",
    "rendering_path",
    "shipped_rendering",
]

KITCHEN_RENDERING = "robotouille.json"
"""What a domain without a rendering of its own looks like."""


def input_path(domain: DomainFile, beside: Path | None) -> Path | None:
    """The input file of a domain: NAME.input.json beside it, or the one it names, or none."""
    own = f"{domain.name}.input.json"
    named = Path(domain.input_json or own).name
    candidates = [beside / own, beside / named] if beside is not None else []
    return next(filter(is_file, [*candidates, data_folder("domains") / named]), None)


def rendering_path(domain: DomainFile, beside: Path | None) -> Path:
    """The rendering of a domain: NAME.rendering.json beside it, the one it names, or the kitchen's.

    A domain's own file is NAME.json, too, and no rendering.
    """
    shipped = data_folder("renderings")
    named = Path(domain.rendering_json or f"{domain.name}.json").name
    candidates = [shipped / named]
    if beside is not None:
        candidates = [beside / f"{domain.name}.rendering.json", beside / named, *candidates]
    found = (path for path in candidates if is_file(path) and not _is_domain(path))
    return next(found, shipped / KITCHEN_RENDERING)


def shipped_rendering(name: str) -> Path:
    """A shipped rendering by its name; RobotouilleError with the nearest one if there is none."""
    known = _names("renderings")
    if name not in known:
        listed = ", ".join(sorted(known))
        raise RobotouilleError(
            f"there is no rendering {name!r}{did_you_mean(name, known)} (there are {listed})"
        )
    return data_folder("renderings") / f"{name}.json"


def other_renderings() -> list[str]:
    """The shipped renderings that no domain looks like unless one chooses them."""
    return sorted(_names("renderings") - _names("domains"))


def _names(folder: str) -> set[str]:
    return {path.stem for path in data_folder(folder).glob("*.json")}


def companion_folder(folder: str, name: str, beside: Path | None) -> Path:
    """A folder beside a problem, or a shipped one."""
    name = Path(name).name
    if beside is not None and (beside / name).is_dir():
        return beside / name
    return data_folder(folder) / name


def _is_domain(path: Path) -> bool:
    """Renderings have no name; a file that is no JSON is told of where it is read as one."""
    try:
        raw = read_json(path)
    except FileError:
        return False
    return isinstance(raw, dict) and "name" in raw
