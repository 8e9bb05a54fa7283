"""Progress of commands that can take minutes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

from robotouille.terminal import tell
from robotouille_client.console.progress import progress_bar

LOG_SECONDS = 30.0
"""Period of lines of progress without a terminal."""


@contextmanager
def bar_or_lines(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show progress on stderr: a bar on a terminal, otherwise a line every half minute."""
    terminal = Console(stderr=True).is_terminal
    said = time.monotonic()
    with progress_bar(what) as bar:

        def progress(done: int, total: int) -> None:
            nonlocal said
            bar(done, total)
            if not terminal and time.monotonic() - said >= LOG_SECONDS:
                tell(f"{done} of {total} {what}", err=True)
                said = time.monotonic()

        yield progress
