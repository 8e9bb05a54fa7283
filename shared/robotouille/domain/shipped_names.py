"""The names of the tasks that are shipped, and of their generated instances."""

from __future__ import annotations

import re
from functools import cache

from robotouille.resources import data_folder

__all__ = ["GENERATED", "instance_names", "shipped_names"]

GENERATED = "generated/"
NOT_TASKS = (".certificate.json", "manifest.json")


@cache
def shipped_names() -> tuple[str, ...]:
    """Every shipped task and generated instance, in order."""
    root = data_folder("problems")
    files = (p.relative_to(root).as_posix() for p in root.rglob("*.json"))
    names = (f.removesuffix(".json") for f in files if not f.endswith(NOT_TASKS))
    return tuple(sorted(names))


def instance_names(name: str) -> tuple[str, ...]:
    """The generated instances of a shipped task, by their seeds."""
    pattern = re.compile(re.escape(f"{GENERATED}{name}_s") + "([0-9]+)")
    found = [match for each in shipped_names() if (match := pattern.fullmatch(each))]
    return tuple(match[0] for match in sorted(found, key=lambda match: int(match[1])))
