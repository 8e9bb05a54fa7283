"""Progress bars on stderr, where that is a terminal; nothing where it is none."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    track,
)

__all__ = ["ProgressBar", "progress_bar", "progress_columns", "tracked"]

T = TypeVar("T")


class ProgressBar:
    """How many of how many are done."""

    def __init__(self, progress: Progress, what: str) -> None:
        self._progress = progress
        self._task = progress.add_task(what, total=None)

    def __call__(self, done: int, total: int) -> None:
        """Show it."""
        self._progress.update(self._task, completed=done, total=total)

    def stage(self, what: str, done: int, total: int) -> None:
        """Show it, of one thing after the other."""
        self._progress.update(self._task, description=what, completed=done, total=total)


def progress_columns() -> tuple[ProgressColumn, ...]:
    """What a bar consists of: what it is about, how much is done, and for how long it has gone."""
    return (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )


@contextmanager
def progress_bar(what: str) -> Iterator[ProgressBar]:
    """A bar that counts something, and is gone in the end."""
    console = Console(stderr=True)
    quiet = not console.is_terminal
    columns = progress_columns()
    with Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        yield ProgressBar(progress, what)


def tracked(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """The same items, with a bar that counts them.

    Args:
        total: How many there are, where the items do not say so themselves.
    """
    console = Console(stderr=True)
    quiet = not console.is_terminal
    yield from track(items, what, total=total, console=console, disable=quiet, transient=True)
