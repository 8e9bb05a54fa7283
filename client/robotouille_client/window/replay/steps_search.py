"""Works out the steps to go of a recording in a process of its own, and fills a curve with them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import deque
from pathlib import Path
from threading import Thread

from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve, StepsKnown
from robotouille_client.window.replay.viewer_state import ViewerState

__all__ = ["StepsSearch"]

EXPANSIONS = 500
SECONDS = 120.0
"""What it may take; of what is left then only bounds are known."""


class StepsSearch:
    """Begins on demand. A thread reads what the process finds: no frame waits for either."""

    def __init__(self, path: Path, history: History, curve: StepsCurve, state: ViewerState) -> None:
        self._path = path
        self._history = history
        self._curve = curve
        self._state = state
        self._lines: deque[str] = deque()
        self._process: subprocess.Popen[str] | None = None
        self._reader: Thread | None = None

    def start(self) -> None:
        """Begin, unless it has begun."""
        if self._curve.begun:
            return
        self._curve.begun = True
        self._state.busy = "Working out the steps to go …"
        command = (
            sys.executable, "-m", "robotouille_client.window.replay.steps_worker",
            str(self._path), str(EXPANSIONS), str(SECONDS),
        )  # fmt: skip
        self._process = subprocess.Popen(  # noqa: S603
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._reader = Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None  # noqa: S101
        with process.stdout as lines:
            self._lines.extend(lines)

    def poll(self) -> None:
        """Take over what was found since the last time."""
        process, reader = self._process, self._reader
        if process is None or reader is None:
            return
        ended = not reader.is_alive()
        while self._lines:
            least, most, dead = json.loads(self._lines.popleft())
            self._curve.add(StepsKnown(least, most, dead))
        known, whole = len(self._curve.known), self._history.length + 1
        if ended:
            self._process, self._state.busy = None, ""
            process.wait()
            missing = "" if known >= whole else f": known up to step {known - 1}"
            self._state.tell(f"Steps to go worked out{missing}")
        else:
            self._state.busy = f"Working out the steps to go: {known} of {whole}"

    def close(self) -> None:
        """Stop working."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
