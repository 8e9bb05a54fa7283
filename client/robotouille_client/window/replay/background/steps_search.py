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
SECONDS = 60.0
"""What a plan may cost, and after how long no more plans are made."""


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
        self._fault = ""

    def start(self) -> None:
        """Begin, unless it has begun."""
        if self._curve.begun:
            return
        self._curve.begun = True
        self._state.busy = "Working out the steps to go …"
        command = (
            sys.executable, "-m", "robotouille_client.window.replay.background.steps_worker",
            str(self._path), str(EXPANSIONS), str(SECONDS),
        )  # fmt: skip
        self._process = subprocess.Popen(  # noqa: S603
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self._reader = Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None  # noqa: S101
        with process.stdout as lines:
            self._lines.extend(lines)
        assert process.stderr is not None  # noqa: S101
        with process.stderr as errors:
            self._fault = errors.read().strip()

    def wait(self, seconds: float) -> bool:
        """Whether it has ended, after so many seconds at most."""
        if self._reader is not None:
            self._reader.join(seconds)
        return self._reader is None or not self._reader.is_alive()

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
            if process.wait():
                self._state.tell(f"Steps to go: {self._fault.rpartition(chr(10))[2] or 'failed'}")
            else:
                self._state.tell(f"Steps to go are known up to step {known - 1}")
        else:
            self._state.busy = f"Working out the steps to go: {known} of {whole}"

    def close(self) -> None:
        """Stop working."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
