"""Recordings that are watched in the window, or saved as videos."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille_client.console import explain
from robotouille_client.window.shell.game_cards import ReplayCards
from robotouille_client.window.shell.screens.replays_menu import recent_recordings, replays_menu
from robotouille_client.window.shell.stage import Stage

__all__ = ["Replays"]


class Replays:
    """Shows recordings.

    Args:
        recordings: Where those of games that were played here are.
        tasks: A folder of own kitchens: recordings of them are shown with its pictures.
    """

    def __init__(self, stage: Stage, recordings: Path | None, tasks: Path | None) -> None:
        self._stage = stage
        self._recordings = recordings
        self._tasks = tasks

    async def choose(self) -> object:
        """Ask for one after the other, and watch it."""
        message = ""
        while True:
            folders = [Path("recordings"), *([self._recordings] if self._recordings else [])]
            form = replays_menu(recent_recordings(folders), message)
            path = await self._stage.ask(form)
            if not isinstance(path, Path):
                return None
            try:
                await self.watch(path)
                message = ""
            except (RobotouilleError, OSError) as error:
                message = explain(error)

    async def watch(self, path: Path) -> None:
        """Watch a recording in this window until its owner leaves it."""
        from robotouille_client.window.replay.recorded_look import open_shown
        from robotouille_client.window.replay.viewer import Viewer

        stage = self._stage
        stage.splash("Loading …")
        recordings = [(path, open_shown(path, self._tasks, damaged=True))]
        make = partial(stage.window, ReplayCards())
        viewer = Viewer(
            recordings, rendering=stage.settings.rendering, now=stage.clock, make_window=make
        )
        try:
            await stage.watched(viewer.window, viewer)
        finally:
            viewer.close()

    async def film(self, path: Path) -> None:
        """Save a recording as a video beside it."""
        from robotouille_client.window.replay.film import film
        from robotouille_client.window.replay.history.recorded import RecordedHistory
        from robotouille_client.window.replay.recorded_look import open_shown

        stage = self._stage
        output = path.with_suffix(".mp4")
        history = RecordedHistory(open_shown(path, self._tasks))
        work = asyncio.to_thread(
            film, history, output, 5.0, "1280x720", rendering=stage.settings.rendering
        )
        try:
            done = await stage.wait(work, "Saving the video …")
            stage.message = f"Saved {output}" if done is not None else ""
        except (RobotouilleError, OSError) as error:
            stage.message = explain(error)
