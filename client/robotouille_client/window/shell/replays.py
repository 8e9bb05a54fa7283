"""What was played: watched in the window, or saved as a video."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import RobotouilleError
from robotouille_client.console import explain
from robotouille_client.window.forms.answers import Answer
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.shell.game_cards import GameCards
from robotouille_client.window.shell.screens.replays_menu import ReplaysMenu, recent_recordings
from robotouille_client.window.shell.screens.saving_form import SavingForm
from robotouille_client.window.shell.user_interface import UserInterface
from robotouille_client.window.sources.texts import path_words

if TYPE_CHECKING:
    from robotouille_client.window.replay.history.history import History

__all__ = ["Replays"]

VIDEO_RATE = 5.0
"""Steps a second in a video."""
VIDEO_SIZE = "1280x720"


class Replays:
    """Shows and films recordings, and what was seen of games on servers.

    Args:
        recordings: Where those of games that were played here are.
        tasks: A folder of own kitchens: recordings of them are shown with its pictures.
    """

    def __init__(self, ui: UserInterface, recordings: Path | None, tasks: Path | None) -> None:
        self._ui = ui
        self._recordings = recordings
        self._tasks = tasks

    async def choose(self) -> object:
        """Ask for one after the other, and watch it."""
        message = ""
        path: object = None
        while True:
            folders = [Path("recordings"), *([self._recordings] if self._recordings else [])]
            menu = ReplaysMenu(
                recent_recordings(folders),
                message,
                rendering=self._ui.preferences.rendering,
                chosen=path,
            )
            path = await self._ui.ask(menu.form)
            if not isinstance(path, Path):
                return None
            try:
                await self.watch(path)
                message = ""
            except (RobotouilleError, OSError) as error:
                message = explain(error)

    async def review(
        self,
        answer: object,
        cards: GameCards,
        watch: Callable[[], Awaitable[None]],
        save: Callable[[], Awaitable[None]],
        show: Callable[[], Awaitable[object]],
    ) -> object:
        """After a game: do what is asked for with it, until something else is; `show` shows it once
        more, as it ended, with its cards."""
        while answer in (Answer.WATCH, Answer.VIDEO):
            try:
                await (watch if answer == Answer.WATCH else save)()
            except (RobotouilleError, OSError) as error:
                self._ui.message = explain(error)
            cards.came_back(self._ui.take_message(), answer)
            answer = await show()
        return answer

    async def watch(self, path: Path) -> None:
        """Watch a recording in this window until its owner leaves it.

        Raises:
            RobotouilleError: It cannot be shown.
        """
        from robotouille_client.window.replay.history.recorded_look import open_shown
        from robotouille_client.window.replay.viewer import ReplayCards, Viewer

        ui = self._ui
        ui.splash("Loading …")
        recordings = [(path, open_shown(path, self._tasks, damaged=True))]
        make = partial(ui.window, ReplayCards())
        viewer = Viewer(
            recordings,
            rendering=ui.preferences.rendering,
            now=ui.clock,
            make_window=make,
            words=ui.words,
        )
        try:
            await ui.run_window(viewer.window, viewer)
        finally:
            viewer.close()

    async def watch_seen(self, history: History, look: KitchenLook | None, stem: Path) -> None:
        """Watch what was seen of a game; `stem` is the path of videos, without the ending."""
        from robotouille_client.window.replay.history_viewer import HistoryViewer
        from robotouille_client.window.replay.viewer import ReplayCards

        viewer = HistoryViewer(
            history, self._ui.clock, stem, rendering=self._ui.preferences.rendering, look=look
        )
        window = self._ui.window(
            ReplayCards(), caption=self._ui.display.caption, look=look, strip=viewer.strip
        )
        try:
            await self._ui.run_window(window, viewer)
        finally:
            viewer.close()

    async def save(self, path: Path) -> None:
        """Save a recording as a video beside it.

        Raises:
            RobotouilleError: It cannot be read, or the video cannot be written.
        """
        from robotouille_client.window.replay.history.recorded import RecordedHistory
        from robotouille_client.window.replay.history.recorded_look import open_shown

        recording = open_shown(path, self._tasks, damaged=True)
        history = RecordedHistory(recording, self._ui.words)
        await self.save_seen(history, None, path.with_suffix(".mp4"))

    async def save_seen(self, history: History, look: KitchenLook | None, output: Path) -> None:
        """Save what was seen of a game as a video; the next form says where it is.

        Raises:
            RobotouilleError: It cannot be written.
        """
        from robotouille_client.window.replay.film import filming

        form = SavingForm(output.name)
        rendering = self._ui.preferences.rendering

        async def write() -> bool:
            args = (history, output, VIDEO_RATE, VIDEO_SIZE)
            with contextlib.closing(filming(*args, rendering=rendering, look=look)) as frames:
                for done, total in frames:
                    form.percent = 100 * done // total
                    await asyncio.sleep(0)
            return True

        saved = await self._ui.wait(write(), form)
        words = f"The video is saved: {path_words(output)}" if saved else "No video was saved."
        self._ui.message = words
