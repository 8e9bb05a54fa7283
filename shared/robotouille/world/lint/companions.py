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
from robotouille.domain.rendering import RENDERING_FILES, RenderingFile
from robotouille.domain.schema import DomainFile, InputFile
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, did_you_mean

__all__ = ["lint_companions", "lint_facts", "lint_input", "lint_look", "lint_pictures"]


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


def lint_pictures(rendering: RenderingFile, beside: Path | None) -> list[Fault]:
    """Pictures that a rendering names and that are not there, each with the nearest that is."""
    folders = rendering.folders(beside)
    where = " or ".join(f"{folder.parent.name}/{folder.name}" for folder in folders)
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


def lint_facts(
    rendering: RenderingFile, domain: DomainFile, kinds: Iterable[str] = ()
) -> list[Fault]:
    """Predicates and actions that pictures depend on and their domain does not have, and kinds
    that were meant to be others.

    `kinds` are those of a problem. What a rendering says of other kinds than these and the
    domain's is not looked at, since it may be taken from a larger one.
    """
    needed = {*kinds, *created_kinds(domain), *(k for ks in domain.kinds.values() for k in ks)}
    known = {
        "predicate": {predicate.name for predicate in domain.predicate_defs},
        "action": {action.name for action in domain.action_defs},
    }
    faults = []
    for kind, place, art in rendering.arts():
        named = [("predicate", trait.name) for trait in art.predicates]
        for what, name in [*named, *(("action", action) for action in art.during)]:
            if kind in needed and name not in known[what]:
                near = did_you_mean(name, known[what])
                faults.append(
                    Fault(place, f"{domain.name} has no {what} {name!r}{near}", "warning")
                )
    without = {kind for kind in needed if not rendering.shows(kind)}
    for kind, place, _ in rendering.arts():
        near = did_you_mean(kind, without) if place.endswith(".assets") else ""
        if near and kind not in needed:
            faults.append(Fault(place, f"nothing is of the kind {kind!r}{near}", "warning"))
    return faults


def lint_look(task: Task) -> list[Fault]:
    """What is wrong with how a task looks: what a window had better tell before it opens.

    Without a fault every picture is there. With one, what is missing is drawn as a tile with its
    name, or left out.
    """
    path = rendering_path(task.domain, task.folder)
    try:
        rendering = read_extending(path, RENDERING_FILES)
    except FileError as error:
        return list(error.faults)
    own = _is_own(task.domain, path)
    return [
        *lint_pictures(rendering, task.folder),
        *(lint_facts(rendering, task.domain, _kinds(task)) if own else ()),
    ]


def _kinds(task: Task) -> set[str]:
    return {each.name for things in task.problem.objects.values() for each in things}


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
    yield from _in(path, lint_facts(rendering, domain, kinds))
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
