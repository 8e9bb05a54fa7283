"""A window on a history that is in no file: of a game that one was in oneself."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from robotouille.errors import RobotouilleError
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.replay.background.job import Job, toggle
from robotouille_client.window.replay.background.seen_export import SeenExport
from robotouille_client.window.replay.background.steps_search import StepsSearch
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.history.seen_states import ENDING, write_states
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.source import ReplaySource
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.replay.viewer_keys import ViewerKeys
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.view import View

__all__ = ["HistoryViewer"]


class HistoryViewer(ReplaySource):
    """The source of such a window, and its `strip`; each frame it looks after what is being worked
    out beside it, until it is closed.

    Args:
        stem: The path of videos of spans, without the steps and the ending.
        rendering: The name of the one to draw them with; else the domain's own.
        look: That of a kitchen which is not installed, in place of a rendering.
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
        export = SeenExport(stem, history, state, rendering, look)
        self._jobs: tuple[Job, ...] = (self._search, export)
        keys = ViewerKeys(
            [history], playhead, state, now,
            curve=self._toggle_curve, export=partial(toggle, export),
        )  # fmt: skip
        self.strip = TimelineStrip(history, playhead, state, keys, curve)

    def view(self) -> View:
        for job in self._jobs:
            job.poll()
        return super().view()

    def close(self) -> None:
        """Stop what is being worked out."""
        for job in self._jobs:
            job.close()
        self._folder.cleanup()

    def _toggle_curve(self) -> None:
        if self._search.running:
            self._search.stop()
            return
        try:
            write_states(self._history, self._states)
        except (RobotouilleError, OSError) as error:
            self._viewer_state.tell(f"No steps to go: {error}")
        else:
            self._search.start()
