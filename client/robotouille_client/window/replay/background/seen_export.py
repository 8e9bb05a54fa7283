"""A span of a game that was seen, as a video: it is in no file, so each frame writes some of it."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.replay.film import filming
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState

__all__ = ["SeenExport"]

SIZE = "1280x720"


class SeenExport:
    """Writes spans, one at a time, as a `SpanExport` does of a recording.

    Args:
        stem: The videos' path, without the steps and the ending.
        rendering: The name of the one to draw it with; else the domain's own.
        look: That of a kitchen which is not installed, in place of a rendering.
    """

    def __init__(
        self,
        stem: Path,
        history: History,
        state: ViewerState,
        rendering: str = "",
        look: KitchenLook | None = None,
    ) -> None:
        self._stem = stem
        self._history = history
        self._state = state
        self._rendering = rendering
        self._look = look
        self._output = stem
        self._frames: Generator[tuple[int, int], None, None] | None = None

    @property
    def running(self) -> bool:
        """Whether a video is being written."""
        return self._frames is not None

    def start(self) -> None:
        """Begin to write the marked span, or all that was seen if none is marked."""
        first, last = (
            max(step, self._history.first) for step in self._state.span(self._history.length)
        )
        self._output = self._stem.absolute().with_name(f"{self._stem.name}-{first}-{last}.mp4")
        rate = min(60.0, max(0.1, self._history.rate))
        self._frames = filming(
            self._history, self._output, rate, SIZE, (first, last), self._rendering, self._look
        )
        words = f"Saving the steps {first} to {last} as {self._output.name}"
        self._state.jobs["video"] = JobProgress(words, self.stop, 0.0)

    def poll(self) -> None:
        """Write one more frame, and say how far it is or that it is done."""
        if self._frames is None:
            return
        try:
            self._output.parent.mkdir(parents=True, exist_ok=True)
            done, total = next(self._frames)
        except StopIteration:
            self._end(f"Video saved: {self._output}")
        except (RobotouilleError, OSError) as error:
            self._end(f"No video: {error}")
        else:
            self._state.jobs["video"].done = done / max(1, total)

    def stop(self) -> None:
        """Give it up; nothing is left of it."""
        self._end("The video was given up")

    def close(self) -> None:
        """Do not go on with a video that is being written: nobody would be told of it."""
        if self._frames is not None:
            self._frames.close()
        self._frames = None

    def _end(self, words: str) -> None:
        self.close()
        self._state.jobs.pop("video", None)
        self._state.tell(words)
