"""Viewers of one recording, two recordings side by side, a game just played, or a live game."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pygame

from robotouille.domain.rendering import NO_WORDS, Language
from robotouille.errors import RobotouilleError
from robotouille.replay.file_names import recording_stem
from robotouille.replay.recording import Recording
from robotouille.world.world import State
from robotouille_client.game import Game
from robotouille_client.window import parse_size, require_screen
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import Strip
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.options import DisplayOptions, WindowStyle
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.replay.background import Job, toggle
from robotouille_client.window.replay.film import HistoryExport, RecordingExport
from robotouille_client.window.replay.histories.history import (
    CHAT_LINES,
    NOTICE_SECONDS,
    History,
    bubbles_at,
    notices_at,
)
from robotouille_client.window.replay.histories.live_history import LiveHistory
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from robotouille_client.window.replay.histories.recorded_states import ENDING, write_states
from robotouille_client.window.replay.side_by_side import SideBySidePainter, SideBySideStrip
from robotouille_client.window.replay.timeline.steps_to_go import StepsCurve, StepsSearch
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.replay.viewer_keys import ViewerActions, ViewerKeys
from robotouille_client.window.replay.viewer_state import Playhead, ViewerState
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.sources.texts import outcome_words, won
from robotouille_client.window.view import GameSource, View
from robotouille_client.window.window import Window


class ReplaySource(GameSource):
    """Source that shows the moment of a history at which the playhead stands.

    If a state cannot be read, the last readable state stays on the screen and the panel gives the
    reason. The playhead may go beyond the history's end if a longer history is shown next to it.

    Args:
        title: Line that the panel shows while everything can be read.
    """

    def __init__(
        self, history: History, playhead: Playhead, state: ViewerState, title: str = ""
    ) -> None:
        self.history = history
        self.playhead = playhead
        self.state = state
        self._title = title
        self._notices = notices_at(history.interludes, round(playhead.rate * NOTICE_SECONDS))
        self._last: tuple[int, State] = (0, history.world.initial)

    def view(self) -> View:
        history, position = self.history, self.playhead.position
        step = min(int(position) + (position % 1 > 0), history.length)
        state, fault = self._state_at(step)
        if not fault:
            self._last = step, state
        ended = step == history.length and position >= history.length
        moving = self.playhead.playing and step > 0 and not ended and not fault
        outcome = history.outcome if ended else None
        return View(
            world=history.world,
            state=state,
            previous=self._state_at(step - 1)[0] if step and not fault else None,
            step=step,
            max_steps=history.max_steps,
            clock="replay" if moving else "replay, paused",
            phase=position % 1 or 1.0 if moving else 1.0,
            seats=history.seats(step),
            bubbles=bubbles_at(history, step),
            chat=history.chat(step, CHAT_LINES),
            status=fault or self._missing(),
            outcome=outcome_words(outcome) if outcome else "",
            won=won(outcome),
            hover=self.state.followed,
            notice=self._notices.get(step, ""),
        )

    def _state_at(self, step: int) -> tuple[State, str]:
        """Return the state after a step, and an error text if it cannot be read."""
        try:
            return self.history.state(step), ""
        except RobotouilleError as error:
            last, state = self._last
            return state, f"Step {step} cannot be shown. This is step {last}: {error}"

    def _missing(self) -> str:
        """Return a line about what the recording lacks, or the title."""
        if self.history.fault:
            return f"The end is missing: {self.history.fault}"
        if self.history.outcome is None:
            return "No end yet: this game was cut short or is still being played"
        return self._title

    @property
    def finished(self) -> bool:
        return self.playhead.position >= self.history.length


class _ViewerWithJobs(ReplaySource):
    """Replay source that also polls background jobs, once a frame, until it is closed."""

    _jobs: tuple[Job, ...] = ()

    def view(self) -> View:
        for job in self._jobs:
            job.poll()
        return super().view()

    def close(self) -> None:
        """Stop all jobs."""
        for job in self._jobs:
            job.close()


class HistoryViewer(_ViewerWithJobs):
    """Viewer of the game that the player has just played, which is not stored in a file.

    Args:
        stem: Path of the videos, without steps and suffix.
        rendering: Name of a rendering for the videos. Default: the domain's own.
        look: Look of a kitchen that is not installed here; replaces `rendering`.
    """

    def __init__(
        self,
        history: History,
        now: Callable[[], float],
        stem: Path,
        *,
        rendering: str = "",
        look: KitchenLook | None = None,
    ) -> None:
        state = ViewerState(now)
        playhead = Playhead(lambda: history.length, history.rate, now, first=history.first)
        super().__init__(history, playhead, state)
        curve = StepsCurve()
        self._folder = TemporaryDirectory(prefix="robotouille-")
        self._states = Path(self._folder.name) / f"seen{ENDING}"
        self._search = StepsSearch(self._states, history, curve, state, now)
        export = HistoryExport(stem, history, state, rendering, look)
        self._jobs = (self._search, export)
        actions = ViewerActions(curve=self._toggle_curve, export=partial(toggle, export))
        keys = ViewerKeys([history], playhead, state, now, actions)
        self.strip = TimelineStrip(history, playhead, state, keys, curve)

    def wait_for_search(self, seconds: float) -> bool:
        """Wait for the search of steps to go. Return whether it has ended."""
        return self._search.wait(seconds)

    def close(self) -> None:
        super().close()
        self._folder.cleanup()

    def _toggle_curve(self) -> None:
        if self._search.running:
            self._search.stop()
            return
        try:
            # The search runs in a process of its own, which needs the states in a file.
            write_states(self.history, self._states)
        except (RobotouilleError, OSError) as error:
            self.state.show_message(f"Steps to go are not available: {error}")
        else:
            self._search.start()


_EARLIER = "This was earlier. Press End to go back to live"
_EARLIER_ENDED = "This was earlier. The game has ended: press End to see how"


class SpectatorSource(GameSource):
    """Source for a spectator: the live game, or any earlier moment that the spectator has seen."""

    def __init__(
        self,
        game: Game,
        now: Callable[[], float],
        connected: Callable[[], bool] = lambda: True,
        language: Language | None = None,
    ) -> None:
        history = self.history = LiveHistory(game, now, language)
        self._remote = RemoteSource(game, now, connected, language, history.observe)
        self.playhead = Playhead(
            lambda: history.length, history.rate, now, first=history.first, live=True
        )
        self.state = ViewerState(now)
        keys = ViewerKeys([history], self.playhead, self.state, now, ViewerActions(talks=True))
        self.strip = TimelineStrip(history, self.playhead, self.state, keys, StepsCurve())

    def view(self) -> View:
        live = self._remote.view()
        self.history.set_seats(live.seats)
        if self.playhead.follows:
            return replace(live, hover=self.state.followed)
        return self._earlier(live)

    def _earlier(self, live: View) -> View:
        history, position = self.history, self.playhead.position
        step = int(position) + (position % 1 > 0)
        moving = self.playhead.playing
        return replace(
            live,
            state=history.state(step),
            previous=history.state(step - 1),
            step=step,
            phase=position % 1 or 1.0 if moving else 1.0,
            clock="earlier",
            seats=history.seats(step),
            bubbles=bubbles_at(history, step),
            chat=history.chat(step, CHAT_LINES),
            status=_EARLIER_ENDED if self._remote.finished else _EARLIER,
            outcome="",
            blocked=(),
            hover=self.state.followed,
            notice="",
            pause=None,
            waits_for=(),
        )

    def say(self, text: str) -> None:
        self._remote.say(text)

    @property
    def finished(self) -> bool:
        return self._remote.finished


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
    """Show one recording, or two side by side, until the window is closed.

    Args:
        rate: Steps a second. Default: the rate of the recorded game.
        at: First step to show.
        screenshot: File for a picture of that step; no window opens.
        rendering: Name of a rendering. Default: the domain's own.

    Raises:
        RobotouilleError: No screen was found, the recordings are of different tasks, or the
            picture cannot be written.
    """
    if screenshot is None:
        require_screen()
    elif screenshot.suffix.lower() not in PICTURES:
        suffixes = ", ".join(PICTURES)
        raise RobotouilleError(
            f"the name of a picture must end in {suffixes}, not {screenshot.name!r}"
        )

    def make_window(caption: str, strip: Strip, painter: Painter | None = None) -> Window:
        return Window(
            DisplayOptions(parse_size(size), caption, headless=screenshot is not None),
            style=WindowStyle(Preferences(rendering=rendering), strip=strip, painter=painter),
            cards=ReplayCards(),
        )

    viewer = RecordingViewer(recordings, rate, rendering=rendering, make_window=make_window)
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
        why = error.strerror if isinstance(error, OSError) else error
        raise RobotouilleError(f"{screenshot}: cannot be written: {why}") from None
    finally:
        viewer.close()


class ReplayCards:
    """Cards of a replay: only the question before leaving. The last step stays on the screen."""

    def start_card(self, view: View) -> None:
        """Show no card at the start."""

    def end_card(self, view: View) -> None:
        """Show no card at the end."""

    def leave_card(self, view: View) -> Form:
        """Return the question before leaving."""
        rows = [
            Button("Keep watching", MenuChoice.STAY),
            Button("Leave the replay", MenuChoice.MENU),
        ]
        return Form("Seen enough?", rows, cancel=MenuChoice.STAY)

    def message(self) -> str:
        """Return nothing new."""
        return ""

    def stay(self) -> None:
        """Do nothing: the replay runs on behind the question."""

    def pause(self, paused: bool) -> None:
        """Do nothing: nobody plays."""


class RecordingViewer(_ViewerWithJobs):
    """Window on one recording, or on two recordings of the same task, and its source.

    Args:
        rate: Steps a second. Default: the rate of the recorded game.
        rendering: Name of a rendering for videos. Default: the domain's own.
        make_window: Makes the window from its caption, its strip and, for two recordings, a
            painter. It must use the same rendering.
        words: Words that replace those of the domain in the log.

    Raises:
        RobotouilleError: There are more than two recordings, or they are of different tasks.
    """

    def __init__(
        self,
        recordings: Sequence[tuple[Path, Recording]],
        rate: float | None = None,
        *,
        rendering: str = "",
        now: Callable[[], float] = time.monotonic,
        make_window: Callable[..., Window],
        words: Language = NO_WORDS,
    ) -> None:
        _check(recordings)
        self._path = recordings[0][0]
        self.histories = [RecordedHistory(recording, words) for _, recording in recordings]
        state = ViewerState(now)
        playhead = Playhead(self._length, rate or self.histories[0].rate, now)
        titles = [path.name if len(recordings) > 1 else "" for path, _ in recordings]
        super().__init__(self.histories[0], playhead, state, titles[0])
        curves = [StepsCurve() for _ in recordings]
        self._searches = [
            StepsSearch(path, history, curve, state, now)
            for (path, _), history, curve in zip(recordings, self.histories, curves, strict=True)
        ]
        alone = len(recordings) == 1
        export = RecordingExport(self._path, self.history, state, playhead.rate, rendering)
        self._jobs = (*self._searches, export)
        actions = ViewerActions(
            curve=self._toggle_curves,
            export=partial(toggle, export) if alone else None,
            picture=self._save_picture,
        )
        keys = ViewerKeys(self.histories, playhead, state, now, actions)
        strips = self.strips = [
            TimelineStrip(history, playhead, state, keys if first else None, curve)
            for history, curve, first in zip(self.histories, curves, (True, False), strict=False)
        ]
        caption = f"Robotouille: {recordings[0][1].task.name}"
        if alone:
            self.window = make_window(caption=caption, strip=strips[0])
            return
        right = ReplaySource(self.histories[1], playhead, state, titles[1])
        self.window = make_window(
            caption=caption,
            strip=SideBySideStrip(strips[0], strips[1]),
            painter=SideBySidePainter(strips[0], strips[1], right.view, rendering),
        )

    def close(self) -> None:
        super().close()
        self.window.close()

    def wait_for_search(self, seconds: float) -> bool:
        """Wait for the searches of steps to go. Return whether all have ended."""
        waited = [search.wait(seconds) for search in self._searches]
        return all(waited)

    def _length(self) -> int:
        return max(history.length for history in self.histories)

    def _toggle_curves(self) -> None:
        running = [search for search in self._searches if search.running]
        for search in running or self._searches:
            toggle(search)

    def _save_picture(self) -> None:
        """Save the window's picture next to the recording, under a name that is still free."""
        folder, stem = self._path.absolute().parent, recording_stem(self._path.name)
        step = self.playhead.step
        names = (f"{stem}-{step}{more}.png" for more in ("", *(f"-{n}" for n in range(2, 1000))))
        path = next((folder / name for name in names if not (folder / name).exists()), folder)
        try:
            self.window.screenshot(path)
        except (OSError, pygame.error) as error:
            self.state.show_message(f"The picture cannot be saved in {folder}: {error}")
        else:
            self.state.show_message(f"Picture saved: {path}")


def _check(recordings: Sequence[tuple[Path, Recording]]) -> None:
    if len(recordings) > 2:
        raise RobotouilleError(f"at most two recordings fit side by side, not {len(recordings)}")
    if len({recording.header["digest"] for _, recording in recordings}) > 1:
        (one, first), (other, second) = recordings
        raise RobotouilleError(
            f"only recordings of the same task can be shown side by side: {one.name} is of "
            f"{_task_words(first)}, {other.name} of {_task_words(second)}"
        )


def _task_words(recording: Recording) -> str:
    task = recording.task
    return f"{task.name} ({task.seats} seats, timing {task.timing.value}, {task.digest[:8]})"
