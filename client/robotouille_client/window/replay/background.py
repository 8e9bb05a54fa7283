"""Background jobs: slow work in a process, whose output a thread reads so that no frame waits."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from threading import Thread
from typing import Protocol

WORKERS = "robotouille_client.window.replay.workers"


class Job(Protocol):
    """Work that runs on demand, one run at a time, and reports to the viewer's state."""

    @property
    def running(self) -> bool:
        """True from the start to the end or the stop."""

    def start(self) -> None:
        """Start."""

    def poll(self) -> None:
        """Take over new results and report progress. Call this once a frame."""

    def stop(self) -> None:
        """Stop and report it."""

    def close(self) -> None:
        """Stop without a report, because the window closes."""


def toggle(job: Job) -> None:
    """Start a job, or stop it if it runs."""
    if job.running:
        job.stop()
    else:
        job.start()


class LineProcess:
    """Python module that runs in a process and prints lines.

    Args:
        module: Name of the module, as for `python -m`.
        on_line: Callback for each line of standard output, called in the reader thread.
    """

    def __init__(self, module: str, *arguments: str, on_line: Callable[[str], None]) -> None:
        self._on_line = on_line
        self._errors = ""
        # -P keeps files of the current folder from replacing libraries.
        self._process = subprocess.Popen(  # noqa: S603
            (sys.executable, "-P", "-m", module, *arguments),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None  # noqa: S101
        with self._process.stdout as lines:
            for line in lines:
                self._on_line(line)
        assert self._process.stderr is not None  # noqa: S101
        with self._process.stderr as errors:
            self._errors = errors.read().strip()

    def ended(self, within: float = 0.0) -> bool:
        """Wait for some seconds. Return whether the process has ended and every line was read."""
        self._reader.join(within)
        return not self._reader.is_alive()

    @property
    def fault(self) -> str:
        """Last line of standard error if the ended process failed, or an empty string."""
        status = self._process.wait()
        return (self._errors.splitlines() or [f"exit status {status}"])[-1] if status else ""

    def stop(self) -> bool:
        """Kill the process. Return whether it was still running."""
        if self._process.poll() is not None:
            return False
        self._process.kill()
        self._process.wait()
        return True
