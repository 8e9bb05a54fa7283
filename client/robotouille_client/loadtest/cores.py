"""Which cores of the machine this process may use."""

from __future__ import annotations

import os

from robotouille.errors import RobotouilleError

__all__ = ["keep_to_cores", "parse_cores"]


def parse_cores(text: str | None) -> tuple[int, ...]:
    """`1,3` or `2-5` as numbers; RobotouilleError says what is wrong with it."""
    cores: list[int] = []
    for part in (text or "").split(","):
        first, _, last = part.strip().partition("-")
        if not part.strip():
            continue
        if not (first.isdecimal() and (last or first).isdecimal()):
            raise RobotouilleError(f"--cpus: {part!r} is no core; name them like 1,3 or 2-5")
        cores += range(int(first), int(last or first) + 1)
    present = set(range(os.cpu_count() or 1))
    if unknown := sorted(set(cores) - present):
        raise RobotouilleError(
            f"--cpus: there is no core {unknown[0]}; they are numbered 0 to {max(present)}"
        )
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
