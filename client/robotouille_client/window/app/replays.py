"""Replays of games: shown in the window or saved as videos."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import RobotouilleError
from robotouille_client.console import explain
from robotouille_client.window.app.game_cards import GameCards
from robotouille_client.window.app.replays_menu import (
    ReplaysMenu,
    SavingForm,
    recent_recordings,
)
from robotouille_client.window.app.user_interface import UserInterface
from robotouille_client.window.forms.rows import MenuChoice
from robotouille_client.window.pictures.appearance import KitchenLook
from robotouille_client.window.sources.texts import path_words

if TYPE_CHECKING:
    from robotouille_client.window.replay.histories.history import History

VIDEO_RATE = 5.0
"""Steps per second in a video."""
VIDEO_SIZE = "1280x720"


class Replays:
    """Menu entry for replays, and the replay of the last game.

    Args:
        recordings: Folder with recordings of local games.
        tasks: Folder of the player's own kitchens, whose pictures replays of them use.
    """

    def __init__(self, ui: UserInterface, recordings: Path | None, tasks: Path | None) -> None:
        self._ui = ui
        self._recordings = recordings
        self._tasks = tasks

    async def choose(self) -> object:
        """Let the player choose and watch recordings until they go back."""
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
        """Show the replay or save the video of a game until the player chooses something else.

        `show` shows the ended game again with its card.
        """
        while answer in (MenuChoice.WATCH, MenuChoice.VIDEO):
            try:
                await (watch if answer == MenuChoice.WATCH else save)()
            except (RobotouilleError, OSError) as error:
                self._ui.message = explain(error)
            cards.returned(self._ui.take_message(), answer)
            answer = await show()
        return answer

    async def watch(self, path: Path) -> None:
        """Show a recording in this window.

        Raises:
            RobotouilleError: The recording cannot be shown.
        """
        # Imported late, because the viewer would delay the start of the window.
        from robotouille_client.window.replay.histories.recorded_history import open_shown
        from robotouille_client.window.replay.viewer import RecordingViewer, ReplayCards

        ui = self._ui
        ui.splash("Loading …")
        # The intact beginning of a damaged recording is still worth watching.
        recordings = [(path, open_shown(path, self._tasks, damaged=True))]
        make = partial(ui.window, ReplayCards())
        viewer = RecordingViewer(
            recordings,
            rendering=ui.preferences.rendering,
            now=ui.time_source.clock,
            make_window=make,
            words=ui.words,
        )
        try:
            await ui.run_window(viewer.window, viewer)
        finally:
            viewer.close()

    async def watch_seen(self, history: History, look: KitchenLook | None, stem: Path) -> None:
        """Show the history of a game on a server. Videos are saved to `stem` plus an ending."""
        from robotouille_client.window.replay.viewer import HistoryViewer, ReplayCards

        viewer = HistoryViewer(
            history,
            self._ui.time_source.clock,
            stem,
            rendering=self._ui.preferences.rendering,
            look=look,
        )
        window = self._ui.window(
            ReplayCards(), caption=self._ui.display.caption, look=look, strip=viewer.strip
        )
        try:
            await self._ui.run_window(window, viewer)
        finally:
            viewer.close()

    async def save(self, path: Path) -> None:
        """Save a recording as a video next to it.

        Raises:
            RobotouilleError: The recording cannot be read, or the video cannot be written.
        """
        from robotouille_client.window.replay.histories.recorded_history import (
            RecordedHistory,
            open_shown,
        )

        recording = open_shown(path, self._tasks, damaged=True)
        history = RecordedHistory(recording, self._ui.words)
        await self.save_seen(history, None, path.with_suffix(".mp4"))

    async def save_seen(self, history: History, look: KitchenLook | None, output: Path) -> None:
        """Save a history as a video; the next form shows its path.

        Raises:
            RobotouilleError: The video cannot be written.
        """
        from robotouille_client.window.replay.film import filming

        form = SavingForm(output.name)
        rendering = self._ui.preferences.rendering

        async def write() -> bool:
            args = (history, output, VIDEO_RATE, VIDEO_SIZE)
            with contextlib.closing(filming(*args, rendering=rendering, look=look)) as frames:
                for done, total in frames:
                    form.percent = 100 * done // total
                    # The form needs frames of its own to show progress and take "Cancel".
                    await asyncio.sleep(0)
            return True

        saved = await self._ui.wait(write(), form)
        self._ui.message = f"Video saved: {path_words(output)}" if saved else "No video saved."
