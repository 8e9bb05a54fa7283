"""A process beside the window that tells lines: a thread reads them, so that no frame waits."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from threading import Thread

__all__ = ["LineProcess"]


class LineProcess:
    """A module that is run by itself, until it ends or is stopped.

    Args:
        module: Its name, as for `python -m`.
        heard: Is told each line of its standard output, in the thread that reads.
    """

    def __init__(self, module: str, *arguments: str, heard: Callable[[str], None]) -> None:
        self._heard = heard
        self._errors = ""
        # -P: no file of the current folder takes the place of a library.
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
                self._heard(line)
        assert self._process.stderr is not None  # noqa: S101
        with self._process.stderr as errors:
            self._errors = errors.read().strip()

    def ended(self, within: float = 0.0) -> bool:
        """Whether it has ended and all of its lines were heard, after so many seconds at most."""
        self._reader.join(within)
        return not self._reader.is_alive()

    @property
    def fault(self) -> str:
        """What went wrong with one that has ended, in a line; empty where nothing did."""
        status = self._process.wait()
        return (self._errors.splitlines() or [f"exit status {status}"])[-1] if status else ""

    def stop(self) -> bool:
        """End it; whether it was still running."""
        if self._process.poll() is not None:
            return False
        self._process.kill()
        self._process.wait()
        return True
