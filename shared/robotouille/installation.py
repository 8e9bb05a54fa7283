"""Shipped data: its folders, and the names of shipped tasks and generated instances."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


@cache
def data_folder(name: str) -> Path:
    """Return the folder `name` (assets, domains, problems or renderings) of this installation."""
    # Wheels contain the folders as package data; in a checkout they are next to the packages.
    packaged = _PACKAGE / "_data" / name
    return packaged if packaged.is_dir() else _PACKAGE.parents[1] / name


VERSION = version("robotouille")
RELEASE = f"robotouille {VERSION}"


GENERATED = "generated/"
NOT_TASKS = (".certificate.json", "manifest.json")


@cache
def shipped_names() -> tuple[str, ...]:
    """Return the names of all shipped tasks and generated instances, sorted."""
    names: list[str] = []
    root = data_folder("problems")
    for folder, _, files in os.walk(root):
        above = Path(folder).relative_to(root)
        tasks = (f for f in files if f.endswith(".json") and not f.endswith(NOT_TASKS))
        names += ((above / f).as_posix().removesuffix(".json") for f in tasks)
    return tuple(sorted(names))


def matching_names(text: str, names: Iterable[str]) -> list[str]:
    """Return the task named `text`, or all tasks that it abbreviates.

    An abbreviation is a task's number (`synchronous/1`), or the beginning of its file or dish name
    (`synchronous/cheese_s`), with or without the data set. A text without a slash also abbreviates
    all tasks of a data set that begins with it, so `sync` is ambiguous and not the one dish that
    begins with it.
    """
    names = list(names)
    return [text] if text in names else [name for name in names if _abbreviates(text, name)]


def _abbreviates(text: str, name: str) -> bool:
    folder, _, file = name.rpartition("/")
    wanted_folder, _, start = text.rpartition("/")
    if wanted_folder and folder != wanted_folder:
        return False
    if start and not wanted_folder and folder.startswith(start):
        return True
    number, _, dish = file.partition("_")
    if re.fullmatch("[0-9]+", start):
        return number.lstrip("0") == start.lstrip("0")
    return bool(start) and (file.startswith(start) or dish.startswith(start))


def instance_names(name: str) -> tuple[str, ...]:
    """Return the names of a shipped task's generated instances, sorted by seed."""
    pattern = re.compile(re.escape(f"{GENERATED}{name}_s") + "([0-9]+)")
    found = [match for each in shipped_names() if (match := pattern.fullmatch(each))]
    return tuple(match[0] for match in sorted(found, key=lambda match: int(match[1])))
