"""Which cores of the machine this process may use."""

from __future__ import annotations

import os
import re

from robotouille.errors import RobotouilleError

__all__ = ["keep_to_cores", "parse_cores"]

_NUMBER = re.compile("[0-9]{1,18}")


def parse_cores(text: str | None) -> tuple[int, ...]:
    """`1,3` or `2-5` as numbers; RobotouilleError says what is wrong with it."""
    cores: list[int] = []
    present = os.cpu_count() or 1
    for part in (text or "").split(","):
        first, _, last = part.strip().partition("-")
        if not part.strip():
            continue
        bounds = _NUMBER.fullmatch(first), _NUMBER.fullmatch(last or first)
        if None in bounds or int(last or first) < int(first):
            raise RobotouilleError(f"--cpus: {part[:40]!r} is no core; name them like 1,3 or 2-5")
        wanted = range(int(first), int(last or first) + 1)
        if wanted.stop > present:
            unknown = max(wanted.start, present)
            raise RobotouilleError(
                f"--cpus: there is no core {unknown}; they are numbered 0 to {present - 1}"
            )
        cores += wanted
    return tuple(sorted(set(cores)))


def keep_to_cores(cores: tuple[int, ...]) -> None:
    """Keep this process, and its children, to these cores; all if there are none given."""
    if not cores:
        return
    if not hasattr(os, "sched_setaffinity"):
        raise RobotouilleError("--cpus: this system does not let a process choose its cores")
    try:
        os.sched_setaffinity(0, cores)
    except OSError as error:
        raise RobotouilleError(f"--cpus: {error.strerror}") from None
