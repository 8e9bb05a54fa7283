"""The names of the tasks that are shipped, and of their generated instances."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from robotouille.resources import data_folder

__all__ = ["GENERATED", "instance_names", "names_meant", "shipped_names"]

GENERATED = "generated/"
NOT_TASKS = (".certificate.json", "manifest.json")


@cache
def shipped_names() -> tuple[str, ...]:
    """Every shipped task and generated instance, in order."""
    names: list[str] = []
    root = data_folder("problems")
    for folder, _, files in os.walk(root):
        above = Path(folder).relative_to(root)
        tasks = (f for f in files if f.endswith(".json") and not f.endswith(NOT_TASKS))
        names += ((above / f).as_posix().removesuffix(".json") for f in tasks)
    return tuple(sorted(names))


def names_meant(said: str, names: Iterable[str]) -> list[str]:
    """The tasks that somebody may mean: the one of that name, or all whose number (`synchronous/1`)
    or dish begins so, with its data set or without."""
    names = list(names)
    return [said] if said in names else [name for name in names if _begins(name, said)]


def _begins(name: str, said: str) -> bool:
    folder, _, file = name.rpartition("/")
    said_folder, _, start = said.rpartition("/")
    if said_folder and folder != said_folder:
        return False
    number, _, dish = file.partition("_")
    if re.fullmatch("[0-9]+", start):
        return number.lstrip("0") == start.lstrip("0")
    return bool(start) and (file.startswith(start) or dish.startswith(start))


def instance_names(name: str) -> tuple[str, ...]:
    """The generated instances of a shipped task, by their seeds."""
    pattern = re.compile(re.escape(f"{GENERATED}{name}_s") + "([0-9]+)")
    found = [match for each in shipped_names() if (match := pattern.fullmatch(each))]
    return tuple(match[0] for match in sorted(found, key=lambda match: int(match[1])))
