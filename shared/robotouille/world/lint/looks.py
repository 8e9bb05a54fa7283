"""What is wrong with how things look: pictures, folders and names that are not there.

A rendering is judged by what it says itself, and not by what it takes over from a shipped one. It
may speak of a larger kitchen than the one at hand, or of several: a name is wrong if none of the
domains that it is for has it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from robotouille.domain.checks.derived import created_kinds, domain_kinds, parameter_types
from robotouille.domain.companions import (
    KITCHEN_RENDERING,
    companion_folder,
    rendering_path,
    shipped_rendering,
)
from robotouille.domain.extends import chain_of, read_extending
from robotouille.domain.files import is_file, read_json
from robotouille.domain.rendering import RENDERING_FILES, RenderingFile
from robotouille.domain.rendering.names import DomainName, domain_names
from robotouille.domain.schema import DomainFile
from robotouille.domain.task import Task, read_domain
from robotouille.errors import Fault, FileError, did_you_mean
from robotouille.resources import data_folder

__all__ = ["lint_look", "lint_names", "lint_pictures", "lint_rendering"]


def lint_look(task: Task | None, look: str = "") -> list[FileError]:
    """What is wrong with how a task will look, or other tasks, in the look of that name: what a
    window had better tell before it opens.

    Without any every picture is there. With some, what is missing is drawn as a tile with its name,
    or left out.

    Raises:
        RobotouilleError: There is no such look, or a rendering cannot be used at all.
    """
    domain, beside, kinds = (task.domain, task.folder, _kinds(task)) if task else (None, None, ())
    paths = [rendering_path(task.domain, task.folder)] if task else []
    # Those that are shipped have been looked at.
    paths = [path for path in paths if not _is_shipped(path)]
    if look:
        paths.append(shipped_rendering(look))
    errors = []
    for path in paths:
        faults = lint_rendering(path, domain, beside, kinds)
        if faults:
            errors.append(FileError(str(path), faults))
    return errors


def lint_rendering(
    path: Path, domain: DomainFile | None, beside: Path | None, kinds: Iterable[str] = ()
) -> list[Fault]:
    """All that a rendering names and that is not there; FileError where it cannot be used at all.

    Args:
        domain: The one whose own rendering it is, or which it is chosen for.
        beside: A folder of pictures and problems, whose kinds are known.
        kinds: Those of a problem.
    """
    rendering = read_extending(path, RENDERING_FILES)
    return [*lint_pictures(rendering, beside), *lint_names(path, rendering, domain, beside, kinds)]


def lint_pictures(rendering: RenderingFile, beside: Path | None) -> list[Fault]:
    """Pictures that a rendering names and that are not there, each with the nearest that is."""
    folders = rendering.folders(beside)
    where = " or ".join(f"{folder.resolve().parent.name}/{folder.name}" for folder in folders)
    known = {path.name for folder in folders if folder.is_dir() for path in folder.iterdir()}
    return [
        Fault(
            place,
            f"there is no picture {file!r} in {where}: draw it, or name another"
            f"{did_you_mean(file, known)}",
            "warning",
        )
        for place, file in rendering.pictures()
        if file not in known
    ]


def lint_names(
    path: Path,
    rendering: RenderingFile,
    domain: DomainFile | None,
    beside: Path | None,
    kinds: Iterable[str] = (),
) -> list[Fault]:
    """Folders, renderings, kinds, predicates and actions that a rendering says and that are
    nowhere, each with the nearest that is; see `lint_rendering`.

    Pictures of what the domain or the problem has depend on what that domain has.
    """
    own = _own_files(path)
    faults = [fault for raw in own.values() for fault in _folders(raw, beside)]
    known = _Known(path, rendering, domain, beside, kinds)
    for said in dict.fromkeys(domain_names(rendering)):
        where = next((file for file, raw in own.items() if _says(raw, said.definition)), None)
        words = known.fault(said) if where is not None else ""
        if words and where is not None:
            extended = f" (in {where.name}, extended here)" if where != path else ""
            faults.append(Fault(said.place, words + extended, "warning"))
    return faults


class _Known:
    """What there is to be named in a rendering."""

    def __init__(
        self,
        path: Path,
        rendering: RenderingFile,
        domain: DomainFile | None,
        beside: Path | None,
        kinds: Iterable[str],
    ) -> None:
        kinds = set(kinds)
        domains = [domain] if domain is not None else []
        domains += _shipped_domains(path, rendering)
        self._names: dict[str, set[str]] = {
            "kind": {*kinds, *(kind for each in domains for kind in _kinds_of(each))},
            "predicate": {each.name for d in domains for each in d.predicate_defs},
            "action": {each.name for d in domains for each in d.action_defs},
        }
        self._parameters: dict[str, set[str]] = {}
        for each in domains:
            predicates = {predicate.name: predicate for predicate in each.predicate_defs}
            for action in each.action_defs:
                names = self._parameters.setdefault(action.name, set())
                names.update(parameter_types(action, predicates))
        # A chosen one may show the same kinds of several domains.
        self._domain = domain = None if _is_shipped(path) else domain
        self._beside = beside
        self._own: dict[str, set[str]] = {}
        if domain is not None:
            self._own = {
                "predicate": {each.name for each in domain.predicate_defs},
                "action": {each.name for each in domain.action_defs},
            }
            listed = (kind for each in domain.kinds.values() for kind in each)
            self._needed = {*kinds, *created_kinds(domain), *listed}

    def fault(self, said: DomainName) -> str:
        """What is wrong with a name, in words; nothing if it is known."""
        if said.what == "parameter":
            names = self._parameters.get(said.about, {said.name})
            near = did_you_mean(said.name, names)
            return (
                "" if said.name in names else f"{said.about} has no {said.what} {said.name!r}{near}"
            )
        if self._domain is not None and said.about in self._needed:
            names = self._own[said.what]
            near = did_you_mean(said.name, names)
            whose = f"{self._domain.name} has no {said.what} {said.name!r}{near}"
            return "" if said.name in names else whose
        names = self._names[said.what]
        if said.what == "kind" and said.name not in names and self._beside is not None:
            names |= _kinds_beside(self._beside)
            self._beside = None
        if said.name in names:
            return ""
        words = "nothing is of the kind" if said.what == "kind" else f"there is no {said.what}"
        return f"{words} {said.name!r}{did_you_mean(said.name, names)}"


def _own_files(path: Path) -> dict[Path, Any]:
    """A rendering and those that it extends, without the ones that are a shipped domain's own."""
    first, *others = chain_of(path, RENDERING_FILES)
    return {p: read_json(p) for p in (first, *(p for p in others if _domain_file(p) is None))}


def _domain_file(rendering: Path) -> Path | None:
    """The shipped domain that looks like a shipped rendering."""
    path = data_folder("domains") / rendering.name
    return path if _is_shipped(rendering) and is_file(path) else None


def _is_shipped(rendering: Path) -> bool:
    return rendering.resolve().parent == data_folder("renderings").resolve()


def _shipped_domains(path: Path, rendering: RenderingFile) -> Iterator[DomainFile]:
    """Those that a rendering is for, and the kitchen, from which much is taken."""
    folder = data_folder("renderings")
    chain = chain_of(path, RENDERING_FILES)
    also = [folder / KITCHEN_RENDERING, *(folder / f"{name}.json" for name in rendering.redraws)]
    for each in dict.fromkeys(path.resolve() for path in (*chain, *also)):
        if _domain_file(each) is not None:
            yield read_domain(each.stem)


def _kinds(task: Task) -> set[str]:
    return {each.name for things in task.problem.objects.values() for each in things}


def _kinds_of(domain: DomainFile) -> Iterator[str]:
    yield from domain_kinds(domain)
    for kinds in domain.kinds.values():
        yield from kinds


def _kinds_beside(folder: Path) -> set[str]:
    """The kinds of things in all problems of a folder."""
    found = set()
    for path in folder.glob("*.json"):
        try:
            raw = read_json(path)
        except FileError:
            continue
        objects = raw.get("objects") if isinstance(raw, dict) else None
        lists = objects.values() if isinstance(objects, dict) else ()
        things = [thing for things in lists if isinstance(things, list) for thing in things]
        names = (thing.get("name") for thing in things if isinstance(thing, dict))
        found |= {name for name in names if isinstance(name, str)}
    return found


def _says(raw: Any, definition: tuple[str, ...]) -> bool:
    for field in definition:
        if not isinstance(raw, dict) or field not in raw:
            return False
        raw = raw[field]
    return True


def _folders(raw: Any, beside: Path | None) -> Iterator[Fault]:
    """Folders of pictures and redrawn renderings that a file names and that are not there."""
    inherited = enumerate(raw.get("inherited_assets", ()))
    named = [("assets", raw["assets"])] if "assets" in raw else []
    for place, name in [*named, *((f"inherited_assets[{i}]", name) for i, name in inherited)]:
        if not companion_folder("assets", name, beside).is_dir():
            places = [data_folder("assets"), *([beside] if beside is not None else [])]
            known = {path.name for folder in places for path in folder.iterdir() if path.is_dir()}
            near = did_you_mean(name, known)
            yield Fault(place, f"there is no folder of pictures {name!r}{near}", "warning")
    known = {path.stem for path in data_folder("renderings").glob("*.json")}
    for i, name in enumerate(raw.get("redraws", ())):
        if name not in known:
            near = did_you_mean(name, known)
            yield Fault(f"redraws[{i}]", f"there is no rendering {name!r}{near}", "warning")
