"""How far a run is: episodes, successes, cost and the time that is left."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.progress import Progress, TimeRemainingColumn

from robotouille.program import tell
from robotouille_client.console.progress import progress_columns
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.runs import Job

__all__ = ["RunProgress"]


TELL_SECONDS = 30


class RunProgress:
    """A line on stderr that changes; where that is no terminal, a new one now and then."""

    def __init__(self, done: Sequence[EpisodeRow], total: int) -> None:
        self._rows = list(done)
        self._total = total
        self._begun = time.monotonic()
        console = Console(stderr=True)
        self._progress = Progress(
            *progress_columns(),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("", total=total, completed=len(self._rows))

    def __enter__(self) -> RunProgress:
        self._progress.start()
        self._show()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def finished(self, job: Job, row: EpisodeRow) -> None:
        """One more is over."""
        self._rows.append(row)
        self._progress.advance(self._task)
        self._show()

    async def tell_now_and_then(self) -> None:
        """A line every half a minute, until it is cancelled; none where a line changes."""
        while self._progress.disable:
            await asyncio.sleep(TELL_SECONDS)
            tell(f"{self}", err=True)

    def __str__(self) -> str:
        """Such as `12 of 300 episodes over, 3 solved, 1 errors, $0.12, after 90 s`."""
        seconds = time.monotonic() - self._begun
        over = f"{len(self._rows)} of {self._total} episodes over"
        return ", ".join([over, *self._words(), f"after {seconds:.0f} s"])

    def _show(self) -> None:
        self._progress.update(self._task, description=", ".join(self._words()))

    def _words(self) -> list[str]:
        solved = sum(row.outcome.success for row in self._rows)
        errors = sum(row.error is not None for row in self._rows)
        costs = [row.usage.cost for row in self._rows if row.usage.cost is not None]
        words = [f"{solved} solved"]
        words += [f"{errors} errors"] if errors else []
        words += [f"${sum(costs):.2f}"] if costs else []
        return words
