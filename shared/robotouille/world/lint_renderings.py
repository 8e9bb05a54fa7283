"""Checks of renderings: pictures, folders and names that do not exist.

Only what a rendering says itself is checked, not what it takes from a shipped one. A rendering may
serve several domains, or a larger kitchen than this one: a name is wrong if none of them has it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from typing import Any, Literal

from robotouille.domain.art import Art
from robotouille.domain.derived import created_kinds, domain_kinds, parameter_types
from robotouille.domain.json_files import read_json
from robotouille.domain.pictures import picture_fault
from robotouille.domain.related_files import (
    KITCHEN_RENDERING,
    chain_of,
    companion_folder,
    read_extending,
    rendering_path,
    shipped_rendering,
)
from robotouille.domain.rendering import RENDERING_FILES, Language, RenderingFile
from robotouille.domain.schema import DomainFile
from robotouille.domain.task import Task, read_domain
from robotouille.errors import Fault, FileError, bounded, did_you_mean, most_similar, suggestion
from robotouille.files.reading import is_file
from robotouille.installation import data_folder
from robotouille.world.lint_wording import lint_wording


@dataclass(frozen=True, slots=True)
class DomainName:
    """Name that a rendering takes from its domain.

    Attributes:
        place: Where the name stands in the file.
        definition: Fields that lead to its definition.
        about: Kind of a picture, or action of a parameter.
    """

    what: Literal["kind", "predicate", "action", "parameter"]
    name: str
    place: str
    definition: tuple[str, ...]
    about: str = ""


def domain_names(rendering: RenderingFile) -> Iterator[DomainName]:
    """Yield every name that a rendering takes from its domain."""
    for field in ("progress", "during"):
        for action in getattr(rendering, field):
            yield DomainName("action", action, f"{field}.{action}", (field, action))
    for kind in rendering.player:
        yield DomainName("kind", kind, f"player.{kind}", ("player", kind))
    for role in ("item", "station", "container"):
        for kind, entity in getattr(rendering, role).entities.items():
            definition = (role, "entities", kind)
            place = ".".join((*definition, "assets"))
            yield DomainName("kind", kind, place, definition)
            for where, art in entity.assets.parts(place):
                yield from _of_picture(art, where, definition, kind)
            for name, art in entity.assets.named.items():
                if art.named:  # Pictures of a container while it holds this kind.
                    yield DomainName("kind", name, f"{place}.{name}", definition)
    yield from _of_language(rendering.language)


def _of_picture(
    art: Art, place: str, definition: tuple[str, ...], kind: str
) -> Iterator[DomainName]:
    for trait in art.predicates:
        yield DomainName("predicate", trait.name, place, definition, kind)
        for param in filter(None, trait.params):
            yield DomainName("kind", param, place, definition)
    for action in art.during:
        yield DomainName("action", action, place, definition, kind)


def _of_language(language: Language) -> Iterator[DomainName]:
    for kind, names in language.kinds.items():
        definition = ("language", "kinds", kind)
        place = ".".join(definition)
        yield DomainName("kind", kind, place, definition)
        for each in names:
            if each.when is not None:
                yield DomainName("predicate", each.when, place, definition)
    for action, words in language.actions.items():
        definition = ("language", "actions", action)
        place = ".".join(definition)
        yield DomainName("action", action, place, definition)
        for name in _in_braces(words.do) | _in_braces(words.how):
            yield DomainName("parameter", name, place, definition, action)
    for predicate in language.predicates:
        definition = ("language", "predicates", predicate)
        yield DomainName("predicate", predicate, ".".join(definition), definition)


def _in_braces(template: str) -> set[str]:
    try:
        return {name for _, name, _, _ in Formatter().parse(template) if name}
    except ValueError:
        return set()


def lint_look(task: Task | None, look: str = "") -> list[FileError]:
    """Check how tasks will look in a rendering, so that a window can warn before it opens.

    Without a task, only the named rendering is checked. Missing pictures are drawn as tiles with a
    name, or left out.

    Raises:
        RobotouilleError: There is no such rendering, or it cannot be used at all.
    """
    domain, beside, kinds = (task.domain, task.folder, _kinds(task)) if task else (None, None, ())
    paths = [rendering_path(task.domain, task.folder)] if task else []
    # Shipped renderings are checked before a release.
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
    """Report everything that a rendering names and that does not exist.

    Args:
        domain: Domain that the rendering belongs to, or is chosen for.
        beside: Folder of pictures and problems. Their kinds count as known.
        kinds: Kinds of a problem.

    Raises:
        FileError: The rendering cannot be used at all.
    """
    rendering = read_extending(path, RENDERING_FILES)
    return [*lint_pictures(rendering, beside), *lint_names(path, rendering, domain, beside, kinds)]


@bounded
def lint_pictures(rendering: RenderingFile, beside: Path | None) -> list[Fault]:
    """Report pictures that do not exist, each with the nearest name that does, or are unusable."""
    folders = [folder for folder in rendering.folders(beside) if folder.is_dir()]
    where = " or ".join(
        f"{folder.resolve().parent.name}/{folder.name}" for folder in rendering.folders(beside)
    )
    # The first folder that has a picture provides it.
    known = {path.name: path for folder in reversed(folders) for path in folder.iterdir()}
    faults = []
    for place, file in rendering.pictures():
        if file not in known:
            words = f"there is no picture {file!r} in {where}: draw it, or name another"
            faults.append(Fault(place, words + _picture_near(file, known), "warning"))
        elif why := picture_fault(known[file]):
            faults.append(Fault(place, f"the picture {file!r} cannot be drawn: {why}", "warning"))
    return faults


def _picture_near(file: str, known: Iterable[str]) -> str:
    """Return a suggestion by the names alone: most pictures share their ending."""
    pictures = {Path(name).stem: name for name in known}
    return suggestion([pictures[stem] for stem in most_similar(Path(file).stem, pictures)])


@bounded
def lint_names(
    path: Path,
    rendering: RenderingFile,
    domain: DomainFile | None,
    beside: Path | None,
    kinds: Iterable[str] = (),
) -> list[Fault]:
    """Report folders, renderings, kinds, predicates and actions that do not exist.

    Invisible characters are reported, too.

    Arguments are as for `lint_rendering`. Conditions of pictures must fit the domain of the kind.
    """
    own = _own_files(path)
    faults = [f for raw in own.values() for f in (*_folders(raw, beside), *lint_wording(raw))]
    known = _Known(path, rendering, domain, beside, kinds)
    for said in dict.fromkeys(domain_names(rendering)):
        where = next((file for file, raw in own.items() if _says(raw, said.definition)), None)
        words = known.fault(said) if where is not None else ""
        if words and where is not None:
            extended = f" (in {where.name})" if where != path else ""
            faults.append(Fault(said.place, words + extended, "warning"))
    return faults


class _Known:
    """Names that a rendering may use."""

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
        # A shipped rendering may show the same kind for several domains.
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
        """Return what is wrong with a name; empty if the name is known."""
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
        # Reading the folder's problems is slow, so that it waits until a name is unknown.
        if said.what == "kind" and said.name not in names and self._beside is not None:
            names |= _kinds_beside(self._beside)
            self._beside = None
        if said.name in names:
            return ""
        return f"there is no {said.what} {said.name!r}{did_you_mean(said.name, names)}"


def _own_files(path: Path) -> dict[Path, Any]:
    """Return the raw rendering and those it extends, except shipped domains' own."""
    first, *others = chain_of(path, RENDERING_FILES)
    return {p: read_json(p) for p in (first, *(p for p in others if _domain_file(p) is None))}


def _domain_file(rendering: Path) -> Path | None:
    """Return the shipped domain that a shipped rendering belongs to."""
    path = data_folder("domains") / rendering.name
    return path if _is_shipped(rendering) and is_file(path) else None


def _is_shipped(rendering: Path) -> bool:
    return rendering.resolve().parent == data_folder("renderings").resolve()


def _shipped_domains(path: Path, rendering: RenderingFile) -> Iterator[DomainFile]:
    """Yield the domains that a rendering serves, and the kitchen, on which most are based."""
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
    """Report missing picture folders and unknown names in `redraws`."""
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
