"""Progress bars on stderr, shown only if stderr is a terminal."""

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

T = TypeVar("T")


class ProgressBar:
    """A bar with a description and a count of done items."""

    def __init__(self, progress: Progress, what: str) -> None:
        self._progress = progress
        self._task = progress.add_task(what, total=None)

    def __call__(self, done: int, total: int) -> None:
        """Show the count."""
        self._progress.update(self._task, completed=done, total=total)

    def stage(self, what: str, done: int, total: int) -> None:
        """Show another description and its count."""
        self._progress.update(self._task, description=what, completed=done, total=total)


def progress_columns() -> tuple[ProgressColumn, ...]:
    """Return the columns of all progress bars: description, bar, count and elapsed time."""
    return (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )


@contextmanager
def progress_bar(what: str) -> Iterator[ProgressBar]:
    """Show a progress bar within the context."""
    console = Console(stderr=True)
    quiet = not console.is_terminal
    columns = progress_columns()
    with Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        yield ProgressBar(progress, what)


def tracked(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Yield the items while a progress bar counts them.

    Args:
        total: The number of items, if `items` has no length.
    """
    console = Console(stderr=True)
    quiet = not console.is_terminal
    yield from track(items, what, total=total, console=console, disable=quiet, transient=True)
