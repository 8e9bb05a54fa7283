"""A window on a history that is in no file: of a game that one was in oneself."""

from __future__ import annotations

from collections.abc import Callable

from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.source import ReplaySource
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.replay.viewer_keys import ViewerKeys
from robotouille_client.window.replay.viewer_state import ViewerState

__all__ = ["HistoryViewer"]


class HistoryViewer(ReplaySource):
    """The source of such a window, and its `strip`; no steps to go, and no spans as videos."""

    def __init__(self, history: History, now: Callable[[], float]) -> None:
        state = ViewerState(now)
        playhead = Playhead(lambda: history.length, history.rate, now, first=history.first)
        super().__init__(history, playhead, state)
        keys = ViewerKeys([history], playhead, state, now)
        self.strip = TimelineStrip(history, playhead, state, keys, StepsCurve())
