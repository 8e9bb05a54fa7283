"""A span of a recording as a video, written by a process of its own while the window goes on."""

from __future__ import annotations

import contextlib
import importlib.util
from pathlib import Path

from robotouille.errors import MissingExtraError
from robotouille_client.window.replay.background.line_process import LineProcess
from robotouille_client.window.replay.film import draft_of
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState

__all__ = ["SpanExport"]

PROGRAM = "robotouille_client.window.replay.background.film_worker"


class SpanExport:
    """Writes spans beside a recording, one at a time.

    Args:
        rate: Steps a second in the video.
        rendering: The name of the one to draw it with; else the domain's own.
    """

    def __init__(
        self, path: Path, history: History, state: ViewerState, rate: float, rendering: str = ""
    ) -> None:
        self._path = path
        folder = history.world.task.folder
        self._tasks = "" if folder in (None, path.parent) else str(folder)
        self._history = history
        self._state = state
        self._rate = min(60.0, max(0.1, rate))
        self._rendering = rendering
        self._output = path
        self._words = ""
        self._process: LineProcess | None = None
        self._done: float | None = None

    @property
    def running(self) -> bool:
        """Whether a video is being written."""
        return self._process is not None

    def start(self) -> None:
        """Begin to write the marked span, or all of the recording if none is marked."""
        if self.running:
            self._state.tell("A video is being written already")
            return
        if importlib.util.find_spec("av") is None:
            self._state.tell(str(MissingExtraError("writing a video", "video")))
            return
        first, last = self._state.span(self._history.length)
        stem = self._path.name.removesuffix(".part").removesuffix(".rbt")
        self._output = self._path.absolute().with_name(f"{stem}-{first}-{last}.mp4")
        self._done = None
        self._words = f"Saving the steps {first} to {last} as {self._output.name}"
        self._process = LineProcess(
            PROGRAM, str(self._path), str(self._output), str(first), str(last),
            f"{self._rate:g}", self._tasks, self._rendering, heard=self._hear,
        )  # fmt: skip
        self._show()

    def _hear(self, line: str) -> None:
        done, _, total = line.partition(" ")
        if done.isdigit():
            self._done = int(done) / max(1, int(total))

    def _show(self) -> None:
        self._state.jobs["video"] = JobProgress(self._words, self.stop, self._done)

    def wait(self, seconds: float) -> bool:
        """Whether it has ended, after so many seconds at most."""
        return self._process is None or self._process.ended(seconds)

    def poll(self) -> None:
        """Say how far it is, and when it is done."""
        process = self._process
        if process is None:
            return
        if not process.ended():
            self._show()
            return
        self._forget()
        fault = process.fault
        self._state.tell(f"No video: {fault}" if fault else f"Video saved: {self._output}")

    def stop(self) -> None:
        """Give it up; nothing is left of it."""
        self.close()
        self._forget()
        self._state.tell("The video was given up")

    def _forget(self) -> None:
        self._process = None
        self._state.jobs.pop("video", None)

    def close(self) -> None:
        """Do not go on with a video that is being written: nobody would be told of it."""
        if self._process is not None and self._process.stop():
            with contextlib.suppress(OSError):
                draft_of(self._output).unlink(missing_ok=True)
