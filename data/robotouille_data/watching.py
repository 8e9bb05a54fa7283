"""Go on indexing as recordings are finished, whatever becomes of the database meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event

from sqlalchemy.engine import URL

from robotouille_data.errors import UnavailableError
from robotouille_data.indexing import Indexed, index

__all__ = ["MAX_PAUSE", "watch"]

MAX_PAUSE = 60.0
"""Seconds between two attempts at a database that is away."""


def watch(
    url: URL,
    folders: Sequence[Path],
    stop: Event,
    *,
    jobs: int = 1,
    interval: float = 5.0,
    report: Callable[[Indexed], None],
    trouble: Callable[[str, float], None],
) -> None:
    """Index the folders again and again.

    What is new is found by what the catalogue lacks, so that nothing is missing after a database
    was away, or this process was.

    Args:
        stop: Is set to end it; what is under way is finished first.
        interval: Seconds between two looks at the folders.
        report: Is told what each look has found.
        trouble: Is told why the database cannot be written, and in how many seconds that is tried
            again.

    Raises:
        CatalogueError: Something that waiting does not mend.
    """
    failed = 0
    while not stop.is_set():
        try:
            found = index(url, folders, jobs=jobs)
        except UnavailableError as error:
            pause = min(MAX_PAUSE, 2.0**failed)
            failed += 1
            trouble(str(error), pause)
            stop.wait(pause)
            continue
        failed = 0
        report(found)
        stop.wait(interval)
