"""The window of `robotouille replay play`: one recording, or two of a task side by side."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import pygame

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.errors import RobotouilleError
from robotouille.replay.recording import Recording
from robotouille_client.window import parse_size, require_screen
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.replay.background.job import Job, toggle
from robotouille_client.window.replay.background.span_export import SpanExport
from robotouille_client.window.replay.background.steps_search import StepsSearch
from robotouille_client.window.replay.history.recorded import RecordedHistory
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.side_by_side import SideBySidePainter, SideBySideStrip
from robotouille_client.window.replay.source import ReplaySource
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.replay.viewer_keys import ViewerKeys
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.view import View
from robotouille_client.window.window import Window

__all__ = ["ReplayCards", "Viewer", "watch"]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp")


def watch(
    recordings: Sequence[tuple[Path, Recording]],
    rate: float | None = None,
    size: str = "1280x720",
    *,
    at: int = 0,
    screenshot: Path | None = None,
    rendering: str = "",
) -> None:
    """Show a recording, or two side by side, until the window is closed.

    Args:
        rate: Steps a second; None: as it was recorded.
        at: The step to begin at.
        rendering: The name of the one to draw it with; else the domain's own.
        screenshot: Save a picture there instead, for which no screen is needed.

    Raises:
        RobotouilleError: There is no screen, they cannot be shown side by side, or the picture
            cannot be written.
    """
    if screenshot is None:
        require_screen()
    elif screenshot.suffix.lower() not in PICTURES:
        endings = ", ".join(PICTURES)
        raise RobotouilleError(f"a picture's name ends in {endings}, found {screenshot.name!r}")
    viewer = Viewer(
        recordings,
        rate,
        rendering=rendering,
        make_window=partial(
            Window,
            parse_size(size),
            headless=screenshot is not None,
            preferences=Preferences(rendering=rendering),
            cards=ReplayCards(),
        ),
    )
    if at:
        viewer.playhead.seek(at, playing=False)
    try:
        if screenshot is None:
            asyncio.run(viewer.window.run(viewer, linger=None))
        else:
            viewer.window.frame(viewer)
            viewer.window.screenshot(screenshot)
    except (OSError, pygame.error) as error:
        if screenshot is None:
            raise
        raise RobotouilleError(f"{screenshot}: cannot be written: {error}") from None
    finally:
        viewer.close()


class ReplayCards:
    """What is asked while a recording is watched; at its end it stays on the screen."""

    def over(self, view: View) -> None:
        """Nothing: one may go back in it."""

    def leaving(self, view: View) -> Form:
        """Whether one has seen enough."""
        rows = [Button("Go on watching", Answer.STAY), Button("Leave the replay", Answer.MENU)]
        return Form("Seen enough?", rows, cancel=Answer.STAY)

    def news(self) -> str:
        """Nothing."""
        return ""

    def stay(self) -> None:
        """Nothing: a recording goes on behind the question."""

    def stand_still(self, still: bool) -> None:
        """Nothing: nobody plays."""


class Viewer(ReplaySource):
    """A window on one or two recordings, and its source; each frame it looks after what is being
    worked out beside it.

    Args:
        rate: Steps a second; None: as it was recorded.
        rendering: The name of the one to draw it with; else the domain's own.
        make_window: Makes the window, given its caption, its strip and, for two recordings, what
            paints them; with the same rendering.
        words: What is laid over those of the domain, in the log.

    Raises:
        RobotouilleError: There are more than two, or two that cannot be shown side by side.
    """

    def __init__(
        self,
        recordings: Sequence[tuple[Path, Recording]],
        rate: float | None = None,
        *,
        rendering: str = "",
        now: Callable[[], float] = time.monotonic,
        make_window: Callable[..., Window] = Window,
        words: Language = NO_WORDS,
    ) -> None:
        _check(recordings)
        self._path = recordings[0][0]
        self.histories = [RecordedHistory(recording, words) for _, recording in recordings]
        self.state = ViewerState(now)
        self.playhead = Playhead(self._length, rate or self.histories[0].rate, now)
        titles = [path.name if len(recordings) > 1 else "" for path, _ in recordings]
        super().__init__(self.histories[0], self.playhead, self.state, titles[0])
        curves = [StepsCurve() for _ in recordings]
        self._searches = [
            StepsSearch(path, history, curve, self.state, now)
            for (path, _), history, curve in zip(recordings, self.histories, curves, strict=True)
        ]
        alone = len(recordings) == 1
        export = SpanExport(
            recordings[0][0], self.histories[0], self.state, self.playhead.rate, rendering
        )
        self._jobs: tuple[Job, ...] = (*self._searches, export)
        keys = ViewerKeys(
            self.histories, self.playhead, self.state, now,
            curve=self._toggle_curves, export=partial(toggle, export) if alone else None,
            picture=self._save_picture,
        )  # fmt: skip
        strips = self.strips = [
            TimelineStrip(history, self.playhead, self.state, keys if first else None, curve)
            for history, curve, first in zip(self.histories, curves, (True, False), strict=False)
        ]
        caption = f"Robotouille: {recordings[0][1].task.name}"
        if alone:
            self.window = make_window(caption=caption, strip=strips[0])
            return
        right = ReplaySource(self.histories[1], self.playhead, self.state, titles[1])
        self.window = make_window(
            caption=caption,
            strip=SideBySideStrip(strips[0], strips[1]),
            painter=SideBySidePainter(strips[0], strips[1], right.view, rendering),
        )

    def view(self) -> View:
        for job in self._jobs:
            job.poll()
        return super().view()

    def close(self) -> None:
        """Close the window, and stop what is being worked out."""
        for job in self._jobs:
            job.close()
        self.window.close()

    def _length(self) -> int:
        return max(history.length for history in self.histories)

    def _toggle_curves(self) -> None:
        running = [search for search in self._searches if search.running]
        for search in running or self._searches:
            toggle(search)

    def _save_picture(self) -> None:
        """Save what the window shows beside the recording, and tell where that is."""
        folder, stem = self._path.absolute().parent, self._path.name.partition(".rbt")[0]
        step = self.playhead.step
        names = (f"{stem}-{step}{more}.png" for more in ("", *(f"-{n}" for n in range(2, 1000))))
        path = next((folder / name for name in names if not (folder / name).exists()), folder)
        try:
            self.window.screenshot(path)
        except (OSError, pygame.error) as error:
            self.state.tell(f"No picture: {folder} cannot be written to: {error}")
        else:
            self.state.tell(f"Picture saved: {path}")


def _check(recordings: Sequence[tuple[Path, Recording]]) -> None:
    """That they can be shown side by side."""
    if len(recordings) > 2:
        raise RobotouilleError(f"two recordings can be shown side by side, not {len(recordings)}")
    if len({recording.header["digest"] for _, recording in recordings}) > 1:
        (one, first), (other, second) = recordings
        raise RobotouilleError(
            f"only recordings of one task can be shown side by side: {one.name} is of "
            f"{_task_words(first)}, {other.name} of {_task_words(second)}"
        )


def _task_words(recording: Recording) -> str:
    task = recording.task
    return f"{task.name} ({task.seats} seats, timing {task.timing.value}, {task.digest[:8]})"
