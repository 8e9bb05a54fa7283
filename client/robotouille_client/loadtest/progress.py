"""What the terminal shows while a load test runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from robotouille_client.loadtest.server_monitor import ServerSample
from robotouille_client.loadtest.worker_pool import WorkerPool

__all__ = ["ProgressDisplay"]


LINE_SECONDS = 5.0
"""Between two lines where there is no terminal."""


class ProgressDisplay:
    """A live line with a bar on a terminal; elsewhere a line for each phase, and now and then."""

    def __init__(self, quiet: bool = False) -> None:
        self._console = Console(stderr=True, quiet=quiet)
        self._live = Live(console=self._console, refresh_per_second=4, transient=True)
        self._name = "connecting"
        self._seconds: float | None = None
        self._since = self._said = time.monotonic()
        self._news = ""

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.stop()

    def phase(self, name: str, seconds: float | None) -> None:
        """A new phase, and about how long it takes."""
        self._name, self._seconds = name, seconds
        self._since = self._said = time.monotonic()
        if not self._console.is_terminal:
            about = f" ({seconds:g} s)" if seconds else ""
            self._console.print(f"{name}{about}", highlight=False)
        self._show()

    def update(self, pool: WorkerPool, samples: Sequence[ServerSample]) -> None:
        """What there is to see by now."""
        parts = [f"{sum(pool.connected):,} connected, {sum(pool.playing):,} rooms play"]
        if pool.seconds:
            last = pool.seconds[max(pool.seconds)].all
            parts.append(f"{last.counts.get('steps', 0):,.0f} steps/s")
            age = last.duration("delta age")
            if age.count:
                parts.append(f"delta age {age.percentile(99) * 1000:.1f} ms (p99)")
        if len(samples) > 1:
            before, now = samples[-2], samples[-1]
            share = (now.cpu - before.cpu) / max(now.at - before.at, 1e-3)
            parts.append(f"server {share:.0%} of a core, {now.memory / 2**20:,.0f} MiB")
        self._news = "; ".join(parts)
        self._show()

    def _show(self) -> None:
        now = time.monotonic()
        if not self._console.is_terminal:
            if now > self._said + LINE_SECONDS:
                self._said = now
                self._console.print(f"  {self._news}", highlight=False, soft_wrap=True)
            return
        passed = now - self._since
        table = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=self._seconds, completed=passed, width=24)
        if self._seconds is None:
            bar = ProgressBar(total=None, pulse=True, width=24)
        table.add_row(bar, f"[bold]{self._name}[/] [dim]{self._news}[/]")
        self._live.update(table)
