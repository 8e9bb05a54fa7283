"""A span of a recording as a video, written by a process of its own while the window goes on."""

from __future__ import annotations

import contextlib
import importlib.util
import subprocess
import sys
from pathlib import Path

from robotouille.errors import MissingExtraError
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.viewer_state import ViewerState

__all__ = ["SpanExport"]


PROGRAM = "from robotouille_client.cli.main import main; main()"


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
        self._tasks = ("--tasks", str(folder)) if folder not in (None, path.parent) else ()
        self._history = history
        self._state = state
        self._rate = rate
        self._rendering = rendering
        self._output = path
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Begin to write the marked span, or all of the recording if none is marked."""
        if self._process is not None:
            self._state.tell("A video is being written already")
            return
        if importlib.util.find_spec("av") is None:
            self._state.tell(str(MissingExtraError("writing a video", "video")))
            return
        first, last = self._state.span(self._history.length)
        stem = self._path.name.removesuffix(".part").removesuffix(".rbt")
        self._output = self._path.with_name(f"{stem}-{first}-{last}.mp4")
        rate = min(60.0, max(0.1, self._rate))
        command = (
            sys.executable, "-c", PROGRAM, "replay", "video",
            str(self._path), str(self._output),
            *self._tasks, "--from", str(first), "--to", str(last), "--speed", f"{rate:g}",
            "--rendering", self._rendering,
        )  # fmt: skip
        self._process = subprocess.Popen(  # noqa: S603
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        self._state.busy = f"Writing {self._output.name} …"

    def wait(self, seconds: float) -> bool:
        """Whether it has ended, after so many seconds at most."""
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(seconds)
        return self._process is None or self._process.poll() is not None

    def poll(self) -> None:
        """Say so if the video is done."""
        process = self._process
        if process is None or process.poll() is None:
            return
        self._process, self._state.busy = None, ""
        assert process.stderr is not None  # noqa: S101
        with process.stderr as errors:
            why = errors.read().strip()
        if process.returncode == 0:
            self._state.tell(f"Written: {self._output}")
        else:
            last = why.splitlines()[-1:] or [f"exit status {process.returncode}"]
            self._state.tell(f"No video: {last[0]}")

    def close(self) -> None:
        """Do not go on with a video that is being written: nobody would be told of it."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.communicate()
            self._output.unlink(missing_ok=True)
