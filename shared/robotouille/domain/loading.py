"""The tasks that are shipped, and any problem file, by name."""

from __future__ import annotations

import re
from difflib import get_close_matches
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from robotouille.domain.files import is_file, read_json, validate
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.shipped_names import GENERATED, names_meant, shipped_names
from robotouille.domain.task import Task, Timing, build_task, read_domain
from robotouille.errors import Fault, FileError, UnknownTaskError, WrongArgumentError
from robotouille.resources import data_folder

__all__ = ["load_task", "task_names"]

PROBLEM_KEYS = {"width", "height", "objects", "goal"}
OTHER_KEYS = {
    "a domain": {"name", "object_types", "predicate_defs", "action_defs"},
    "an input file": {"mouse_click_actions", "keyboard_actions"},
    "a rendering": {"assets", "floor", "item", "station", "container", "progress", "icons"},
}
"""Fields by which files are told apart."""
MAX_LOOKED_AT = 1_000
"""Files of a folder among which the nearest name is looked for."""


@cache
def task_names(*, generated: bool = False) -> tuple[str, ...]:
    """Every shipped task, e.g. `synchronous/01_cheese_sandwich`, in order.

    Args:
        generated: Their generated instances are listed, too: `generated/synchronous/…_s42`.
            They are tasks like all others; `Task.instances` gives those of one task.
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
    """A shipped task by its name (or an unambiguous start of it), or a problem file by its path.

    Args:
        name: A path ends in `.json`. `@N` at the end is for N seats, whatever `seats` says.
        seats: The number of players; the problem's usual one if None.
        domain: A domain, its name or its path, in place of the problem's own.
        seed: Decides the kinds of objects that the problem leaves open.
        files: Whether paths are read; without it, only shipped tasks are found.

    Raises:
        UnknownTaskError: No task and no file goes by that name.
        FileError: A file is wrong, and the error has all its faults; the name is the start of
            several tasks; or the task is not for so many seats, or there is no such timing.
        WrongArgumentError: `name`, `domain` or `seed` is of another type than these.
    """
    if not isinstance(name, str):
        raise WrongArgumentError(f"expected the name of a task or a path, found {name!r}")
    if domain is not None and not isinstance(domain, DomainFile | str):
        raise WrongArgumentError(f"expected a domain, its name or a path, found {domain!r}")
    if not isinstance(seed, int):
        raise WrongArgumentError(f"expected a whole number as seed, found {seed!r}")
    base, at, count = name.rpartition("@")
    if at and re.fullmatch("[0-9]{1,3}", count):
        name, seats = base, int(count)
    if not files and name.endswith(".json"):
        raise UnknownTaskError(name, task_names())
    path = _find(name, files=files)
    raw = read_json(path)
    _refuse_others(raw, path)
    problem = validate(raw, ProblemFile, str(path))
    if not isinstance(domain, DomainFile):
        domain = read_domain(domain or problem.domain or "robotouille", path.parent)
    if timing not in list(Timing):
        valid = ", ".join(Timing)
        raise FileError(name, [Fault("timing", f"unknown profile {timing!r}; possible: {valid}")])
    title = path.stem if name.endswith(".json") else _title(path)
    return build_task(
        title, domain, problem, seats=seats, timing=Timing(timing), seed=seed, source=str(path)
    )


def _title(path: Path) -> str:
    return path.relative_to(data_folder("problems")).with_suffix("").as_posix()


def _refuse_others(raw: Any, path: Path) -> None:
    """Say what a file is that is no problem, rather than all that is wrong with it as one."""
    keys = raw.keys() if isinstance(raw, dict) else set()
    if keys & PROBLEM_KEYS:
        return
    for what, own in OTHER_KEYS.items():
        if keys & own:
            raise FileError(str(path), [Fault("", f"this is {what}, not a problem")])


def _find(name: str, *, files: bool) -> Path:
    if name.endswith(".json"):
        if not is_file(Path(name)):
            raise UnknownTaskError(name, task_names(), _file_near(name))
        return Path(name)
    names = shipped_names() if name.startswith(GENERATED) else task_names()
    matches = names_meant(name, names)
    if len(matches) != 1:
        if matches:
            listed = ", ".join(matches[:4]) + (", …" if len(matches) > 4 else "")
            raise FileError(name, [Fault("", f"is not one task but {len(matches)}: {listed}")])
        raise UnknownTaskError(name, names, _file_near(name) if files else None)
    return data_folder("problems") / f"{matches[0]}.json"


def _file_near(name: str) -> str | None:
    """The file in the folder that a path names whose name is nearest, whatever it ends in."""
    try:
        found = islice(Path(name).parent.glob("*.json"), MAX_LOOKED_AT)
        paths = {path.stem: path for path in sorted(found)}
    except OSError:
        return None
    near = get_close_matches(Path(name).stem, paths, n=1)
    return str(paths[near[0]]) if near else None
