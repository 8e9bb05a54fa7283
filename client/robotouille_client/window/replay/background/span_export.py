"""A span of a recording as a video, written by a process of its own while the window goes on."""

from __future__ import annotations

import contextlib
import importlib.util
import subprocess
import sys
from pathlib import Path
from threading import Thread

from robotouille.errors import MissingExtraError
from robotouille_client.window.replay.film import draft_of
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.viewer_state import Job, ViewerState

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
        self._process: subprocess.Popen[str] | None = None
        self._reader: Thread | None = None
        self._done: float | None = None
        self._fault = ""

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
        command = (
            sys.executable, "-m", PROGRAM, str(self._path), str(self._output), str(first),
            str(last), f"{self._rate:g}", self._tasks, self._rendering,
        )  # fmt: skip
        self._done, self._fault = None, ""
        self._words = f"Saving the steps {first} to {last} as {self._output.name}"
        self._process = subprocess.Popen(  # noqa: S603
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self._reader = Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()
        self._show()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None  # noqa: S101
        with process.stdout as lines:
            for line in lines:
                done, _, total = line.partition(" ")
                if done.isdigit():
                    self._done = int(done) / max(1, int(total))
        assert process.stderr is not None  # noqa: S101
        with process.stderr as errors:
            self._fault = errors.read().strip()

    def _show(self) -> None:
        self._state.jobs["video"] = Job(self._words, self.stop, self._done)

    def wait(self, seconds: float) -> bool:
        """Whether it has ended, after so many seconds at most."""
        if self._reader is not None:
            self._reader.join(seconds)
        return self._reader is None or not self._reader.is_alive()

    def poll(self) -> None:
        """Say how far it is, and when it is done."""
        process, reader = self._process, self._reader
        if process is None or reader is None:
            return
        if reader.is_alive():
            self._show()
            return
        status = process.wait()
        self._forget()
        if status == 0:
            self._state.tell(f"Video saved: {self._output}")
            return
        last = self._fault.splitlines()[-1:] or [f"exit status {status}"]
        self._state.tell(f"No video: {last[0]}")

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
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()
            with contextlib.suppress(OSError):
                draft_of(self._output).unlink(missing_ok=True)
