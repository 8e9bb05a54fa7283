"""Videos of histories, or of part of one, and the jobs that write them."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path

import pygame

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.files.drafts import draft_of, drafted
from robotouille.replay.file_names import recording_stem
from robotouille.world.world import State
from robotouille_client.window import parse_size
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.replay.background import WORKERS, LineProcess
from robotouille_client.window.replay.histories.history import (
    NOTICE_SECONDS,
    History,
    bubbles_at,
    notices_at,
)
from robotouille_client.window.replay.viewer_state import JobProgress, ViewerState
from robotouille_client.window.sources.texts import outcome_words
from robotouille_client.window.video import VIDEOS, FilmOptions, frames_of, write_video

FPS = 24
GIF_FPS = 12
HOLD_SECONDS = 4
"""Time for the end of a game: the players cheer, then the outcome is shown."""

_Span = tuple[int | None, int | None]


def film(
    history: History,
    output: Path,
    speed: float,
    size: str,
    span: _Span = (None, None),
    rendering: str = "",
) -> int:
    """Write a history as a video, with a progress bar on the terminal. Return the number of frames.

    Arguments are as for `filming`.

    Raises:
        RobotouilleError: There are no such steps, or the file cannot be written.
    """
    from robotouille_client.console.progress import tracked

    written = filming(history, output, speed, size, span, rendering)
    _, total = next(written)
    for _ in tracked(written, output.name, total):
        pass
    return total


def filming(
    history: History,
    output: Path,
    speed: float,
    size: str,
    span: _Span = (None, None),
    rendering: str = "",
    look: KitchenLook | None = None,
    draft: Path | None = None,
) -> Generator[tuple[int, int], None, None]:
    """Write a history as a video and yield the frames done and in total.

    The file appears with the last frame. Closing the generator earlier leaves nothing behind.

    Args:
        speed: Steps a second.
        size: WIDTHxHEIGHT in pixels.
        span: First and last step; None for those of the history.
        rendering: Name of a rendering. Default: the domain's own.
        look: Look of a kitchen that is not installed here; replaces `rendering`.
        draft: File next to `output` that is written until the video is complete. A caller that may
            kill this process passes it, to delete it afterwards.

    Raises:
        RobotouilleError: There are no such steps, or the file cannot be written.
    """
    first, last = checked_span(history, span)
    if output.suffix.lower() not in VIDEOS:
        endings = " or ".join(VIDEOS)
        raise RobotouilleError(f"the name of a video must end in {endings}, not {output.name!r}")
    fps = GIF_FPS if output.suffix.lower() == ".gif" else FPS
    frames_per_step = max(1, round(fps / speed))
    ended = last == history.length and history.outcome is not None
    hold = HOLD_SECONDS * fps if ended else fps
    options = FilmOptions(
        size=parse_size(size),
        frames_per_step=frames_per_step,
        fps=fps,
        hold=hold,
        seats=history.seats,
        bubbles=lambda step: bubbles_at(history, step),
        notices=notices_at(history.interludes, round(speed * NOTICE_SECONDS)),
        max_steps=history.max_steps,
        outcome=outcome_words(history.outcome) if ended and history.outcome else "",
        rendering=look.rendering if look else rendering,
        pictures=look.pictures if look else None,
    )
    frames = frames_of(_states(history, first, last), options)
    total = (last - first + 1) * frames_per_step + hold
    yield from _written(frames, output, draft, fps, total)


def _written(
    frames: Iterable[pygame.Surface], output: Path, draft: Path | None, fps: int, total: int
) -> Iterator[tuple[int, int]]:
    """Write frames to a draft, and rename it when it is complete."""
    try:
        with drafted(output, draft) as file:
            for done in write_video(file, frames, fps, output.suffix):
                yield min(done, total - 1), total
        yield total, total
    except ValueError as error:
        raise RobotouilleError(str(error)) from None
    except OSError as error:
        raise RobotouilleError(f"{output}: cannot be written: {error.strerror}") from None


def checked_span(history: History, span: _Span) -> tuple[int, int]:
    """Return the first and last step of a span.

    Raises:
        RobotouilleError: The history has no such steps.
    """
    first = history.first if span[0] is None else span[0]
    last = history.length if span[1] is None else span[1]
    if not history.first <= first <= last <= history.length:
        raise RobotouilleError(
            f"steps {first} to {last} are not in the recording, which has steps "
            f"{history.first} to {history.length}"
        )
    return first, last


def _states(history: History, first: int, last: int) -> Iterator[tuple[int, State]]:
    return ((step, history.state(step)) for step in range(first, last + 1))


SIZE = "1280x720"


class HistoryExport:
    """Job that writes clips of a history that no file holds, in the window's own process.

    Each frame of the window writes one frame of video, so that the window goes on.

    Args:
        stem: Path of the videos, without steps and suffix.
        rendering: Name of a rendering. Default: the domain's own.
        look: Look of a kitchen that is not installed here; replaces `rendering`.
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
        """True while a video is being written."""
        return self._frames is not None

    def start(self) -> None:
        """Start to write the marked clip, or the whole history."""
        first, last = (
            max(step, self._history.first) for step in self._state.span(self._history.length)
        )
        self._output = self._stem.absolute().with_name(f"{self._stem.name}-{first}-{last}.mp4")
        rate = min(60.0, max(0.1, self._history.rate))
        self._frames = filming(
            self._history, self._output, rate, SIZE, (first, last), self._rendering, self._look
        )
        words = f"Saving steps {first} to {last} as a video"
        self._state.jobs["video"] = JobProgress(words, self.stop, 0.0)

    def poll(self) -> None:
        """Write one more frame and report progress."""
        if self._frames is None:
            return
        try:
            self._output.parent.mkdir(parents=True, exist_ok=True)
            done, total = next(self._frames)
        except StopIteration:
            self._end(f"Video saved: {self._output}")
        except (RobotouilleError, OSError) as error:
            self._end(f"The video cannot be saved: {error}")
        else:
            self._state.jobs["video"].done = done / max(1, total)

    def stop(self) -> None:
        """Stop; the unfinished video is deleted."""
        self._end("Video stopped")

    def close(self) -> None:
        """Stop without a report."""
        if self._frames is not None:
            self._frames.close()
        self._frames = None

    def _end(self, words: str) -> None:
        self.close()
        self._state.jobs.pop("video", None)
        self._state.show_message(words)


class RecordingExport:
    """Job that writes clips of a recording next to it, in a process of its own.

    Args:
        rate: Steps a second in the video.
        rendering: Name of a rendering. Default: the domain's own.
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
        self._output = self._draft = path
        self._words = ""
        self._process: LineProcess | None = None
        self._done: float | None = None

    @property
    def running(self) -> bool:
        """True while a video is being written."""
        return self._process is not None

    def start(self) -> None:
        """Start to write the marked clip, or the whole recording."""
        if self.running:
            self._state.show_message("A video is already being saved")
            return
        if importlib.util.find_spec("av") is None:
            self._state.show_message(str(MissingExtraError("writing a video", "video")))
            return
        first, last = self._state.span(self._history.length)
        stem = recording_stem(self._path.name)
        self._output = self._path.absolute().with_name(f"{stem}-{first}-{last}.mp4")
        self._draft = draft_of(self._output)
        self._done = None
        self._words = f"Saving steps {first} to {last} as a video"
        self._process = LineProcess(
            WORKERS, "film", str(self._path), str(self._output), str(self._draft),
            str(first), str(last), f"{self._rate:g}", self._tasks, self._rendering,
            on_line=self._read_progress,
        )  # fmt: skip
        self._show()

    def _read_progress(self, line: str) -> None:
        done, _, total = line.partition(" ")
        if done.isdigit():
            self._done = int(done) / max(1, int(total))

    def _show(self) -> None:
        self._state.jobs["video"] = JobProgress(self._words, self.stop, self._done)

    def wait(self, seconds: float) -> bool:
        """Wait for some seconds. Return whether the video has ended."""
        return self._process is None or self._process.ended(seconds)

    def poll(self) -> None:
        """Report progress and the end."""
        process = self._process
        if process is None:
            return
        if not process.ended():
            self._show()
            return
        self._forget()
        fault = process.fault
        self._state.show_message(
            f"The video cannot be saved: {fault}" if fault else f"Video saved: {self._output}"
        )

    def stop(self) -> None:
        """Stop; the unfinished video is deleted."""
        self.close()
        self._forget()
        self._state.show_message("Video stopped")

    def _forget(self) -> None:
        self._process = None
        self._state.jobs.pop("video", None)

    def close(self) -> None:
        """Stop without a report."""
        if self._process is not None and self._process.stop():
            with contextlib.suppress(OSError):
                self._draft.unlink(missing_ok=True)
