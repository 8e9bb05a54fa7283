"""What is wrong with the files that belong to a domain: keys, looks and pictures.

A kitchen can be played without any of them, so most of this is a warning (a file or a picture that
is named and not there) or a note (what the window makes up).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from robotouille.domain.checks.derived import created_kinds
from robotouille.domain.checks.input_checks import check_input
from robotouille.domain.companions import input_path, rendering_path
from robotouille.domain.extends import read_extending
from robotouille.domain.input_bindings import INPUT_FILES, made_up_keys
from robotouille.domain.rendering import RENDERING_FILES
from robotouille.domain.schema import DomainFile, InputFile
from robotouille.errors import Fault, FileError
from robotouille.resources import data_folder
from robotouille.world.lint.looks import lint_names, lint_pictures

__all__ = ["lint_companions", "lint_input"]


def lint_companions(
    domain: DomainFile, beside: Path | None, kinds: Iterable[str] = ()
) -> list[Fault]:
    """Findings on the input file and the rendering that a domain has beside a file, or shipped.

    `kinds` are those of a problem's objects.
    """
    return [*_inputs(domain, beside), *_rendering(domain, beside, kinds)]


def lint_input(inputs: InputFile, domain: DomainFile, name: str) -> list[Fault]:
    """Names that the domain does not have, and actions that the file does not name."""
    faults = check_input(inputs, domain)
    for action, key in made_up_keys(inputs, domain).items():
        made_up = f"{action!r} has no click and no key in {name}; {key.upper()} is made up"
        message = f"{made_up}: to choose, name it in {domain.name}.input.json"
        faults.append(Fault("keyboard_actions", message, "note"))
    return faults


def _is_own(domain: DomainFile, path: Path) -> bool:
    """Whether a rendering is a domain's own, and not that of the kitchen in its place."""
    named = Path(domain.rendering_json or "").name
    return path.name in (named, f"{domain.name}.json", f"{domain.name}.rendering.json")


def _inputs(domain: DomainFile, beside: Path | None) -> Iterator[Fault]:
    path = input_path(domain, beside)
    if path is None:
        if domain.input_json is not None:
            yield _missing("input_json", domain.input_json, "all keys are made up")
        return
    try:
        faults = lint_input(read_extending(path, INPUT_FILES), domain, path.name)
    except FileError as error:
        faults = list(error.faults)
    yield from _in(path, faults)


def _rendering(domain: DomainFile, beside: Path | None, kinds: Iterable[str]) -> Iterator[Fault]:
    path = rendering_path(domain, beside)
    own = _is_own(domain, path)
    if not own and domain.rendering_json is not None:
        yield _missing("rendering_json", domain.rendering_json, "it looks like the kitchen")
    try:
        rendering = read_extending(path, RENDERING_FILES)
    except FileError as error:
        yield from _in(path, error.faults)
        return
    yield from _in(path, lint_pictures(rendering, beside))
    if not own:
        return
    if path.parent != data_folder("renderings"):
        yield from _in(path, lint_names(path, rendering, domain, beside, kinds))
    # One that is shipped, or of what the domain extends, is not to be changed.
    file = path.name if path.parent == beside else f"{domain.name}.rendering.json"
    needed = dict.fromkeys((*kinds, *created_kinds(domain)))
    for kind in needed:
        if not rendering.shows(kind):
            words = f"{kind!r} has no picture; a tile with its name is drawn: "
            yield Fault("", f"{words}give it one in {file}", "note")


def _missing(field: str, name: str, meanwhile: str) -> Fault:
    message = f"there is no file {Path(name).name!r} beside it or among those shipped; {meanwhile}"
    return Fault(field, f"{message}: write it, or leave the field out", "warning")


def _in(path: Path, faults: Iterable[Fault]) -> Iterator[Fault]:
    """Findings in another file than the one that is looked at."""
    for fault in faults:
        file = f"{path.resolve().parent.name}/{path.name}"
        place = f"{file}: {fault.path}" if fault.path else file
        yield Fault(place, fault.message, fault.severity)
