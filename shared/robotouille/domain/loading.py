"""Loading of shipped tasks and problem files by name."""

from __future__ import annotations

import re
from difflib import get_close_matches
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from robotouille.domain.json_files import as_in_file, read_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import Task, Timing, build_task, domain_named_in, read_domain
from robotouille.errors import (
    Fault,
    FileError,
    RobotouilleError,
    UnknownTaskError,
    WrongArgumentError,
)
from robotouille.files.reading import content_kind, is_file
from robotouille.installation import GENERATED, data_folder, matching_names, shipped_names

PROBLEM_KEYS = {"width", "height", "objects", "goal"}
OTHER_KEYS = {
    "a domain": {"name", "object_types", "predicate_defs", "action_defs"},
    "an input file": {"mouse_click_actions", "keyboard_actions"},
    "a rendering": {"assets", "floor", "item", "station", "container", "progress", "icons"},
}
"""Fields that identify the kind of a file."""
MAX_COMPARED = 1_000
"""Largest number of a folder's files that are compared with an unknown name."""


@cache
def task_names(*, generated: bool = False) -> tuple[str, ...]:
    """Return the names of all shipped tasks, e.g. `synchronous/01_cheese_sandwich`, sorted.

    Args:
        generated: Include generated instances, e.g. `generated/synchronous/…_s42`.
            `Task.instances` returns those of one task.
    """
    names = shipped_names()
    return names if generated else tuple(n for n in names if not n.startswith(GENERATED))


def load_task(
    name: str,
    *,
    seats: int | None = None,
    timing: Timing | str = Timing.BENCHMARK,
    domain: DomainFile | str | None = None,
    seed: int = 0,
    files: bool = True,
) -> Task:
    """Load a shipped task by its name or an unambiguous abbreviation, or a problem file.

    Args:
        name: Name of a task, or a path that ends in `.json`. `@N` at the end overrides `seats`.
        seats: Number of players; by default, the problem's.
        timing: Timing profile.
        domain: A domain, its name or its path, in place of the problem's domain.
        seed: Chooses the kinds of objects that the problem leaves open.
        files: Read problem files; if False, only shipped tasks can be loaded.

    Raises:
        UnknownTaskError: There is no such task or file.
        FileError: A file is invalid (the error lists all its faults), the name is ambiguous, or
            the task does not support the seats or the timing.
        WrongArgumentError: `name`, `domain` or `seed` has the wrong type.
    """
    if not isinstance(name, str):
        raise WrongArgumentError(f"expected the name of a task or a path, found {name!r}")
    if domain is not None and not isinstance(domain, DomainFile | str):
        raise WrongArgumentError(f"expected a domain, its name or a path, found {domain!r}")
    if not isinstance(seed, int):
        raise WrongArgumentError(f"expected an integer as seed, found {seed!r}")
    base, at, count = name.rpartition("@")
    if at and re.fullmatch("[0-9]{1,3}", count):
        name, seats = base, int(count)
    if not files and name.endswith(".json"):
        raise UnknownTaskError(name, task_names())
    path = _find(name, files=files)
    raw = read_json(path)
    _check_is_problem(raw, path)
    problem = validate(raw, ProblemFile, str(path))
    if not isinstance(domain, DomainFile):
        domain = (
            read_domain(domain, path.parent) if domain else domain_named_in(path, problem.domain)
        )
    if timing not in list(Timing):
        valid = ", ".join(Timing)
        raise FileError(name, [Fault("timing", f"unknown profile {timing!r}; possible: {valid}")])
    title = path.stem if name.endswith(".json") else _title(path)
    try:
        return build_task(
            title, domain, problem, seats=seats, timing=Timing(timing), seed=seed, source=str(path)
        )
    except FileError as error:
        raise FileError(error.file, as_in_file(error.faults, raw)) from None


def shipped_task(task: Task) -> Task | None:
    """Return the shipped task with a task's name and content, or None."""
    try:
        shipped = load_task(task.name, seats=task.seats, timing=task.timing, files=False)
    except (RobotouilleError, OSError):
        return None
    return shipped if shipped.digest == task.digest else None


def _title(path: Path) -> str:
    return path.relative_to(data_folder("problems")).with_suffix("").as_posix()


def _check_is_problem(raw: Any, path: Path) -> None:
    """Report another kind of file as such, instead of listing its faults as a problem."""
    keys = raw.keys() if isinstance(raw, dict) else set()
    if keys & PROBLEM_KEYS:
        return
    for what, own in OTHER_KEYS.items():
        if keys & own:
            raise FileError(str(path), [Fault("", f"this is {what}, not a problem")])


def _find(name: str, *, files: bool) -> Path:
    if name.endswith(".json"):
        if not is_file(Path(name)):
            _refuse_other_file(name)
            raise UnknownTaskError(name, task_names(), _file_near(name))
        return Path(name)
    names = shipped_names() if name.startswith(GENERATED) else task_names()
    matches = matching_names(name, names)
    if len(matches) != 1:
        if matches:
            listed = ", ".join(matches[:4]) + (", …" if len(matches) > 4 else "")
            raise FileError(
                name, [Fault("", f"is ambiguous: {len(matches)} tasks match: {listed}")]
            )
        if files:
            _refuse_other_file(name)
        raise UnknownTaskError(name, names, _file_near(name) if files else None)
    return data_folder("problems") / f"{matches[0]}.json"


def _refuse_other_file(name: str) -> None:
    """Raise FileError if the name is that of a folder or of a file that is not a problem."""
    path = Path(name)
    try:
        if path.name and path.is_dir():
            kind = "a folder"
        elif path.is_file():
            with path.open("rb") as file:
                kind = content_kind(file.read(1024))
        else:
            return
    except OSError:
        return
    expected = "expected the name of a task, or a problem file that ends in .json"
    raise FileError(name, [Fault("", f"is {kind}; {expected}")])


def _file_near(name: str) -> str | None:
    """Return the JSON file in a path's folder whose name is most similar, if any."""
    try:
        found = islice(Path(name).parent.glob("*.json"), MAX_COMPARED)
        paths = {path.stem: path for path in sorted(found)}
    except OSError:
        return None
    near = get_close_matches(Path(name).stem, paths, n=1)
    return str(paths[near[0]]) if near else None
