"""An episode that one watches: live, or back and forth in what one has seen of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from robotouille.domain.rendering import Language
from robotouille.world.grounding.actions import GroundAction
from robotouille_client.game import Game
from robotouille_client.window.replay.history.live import LiveHistory
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.source import CHAT_LINES, bubbles_at
from robotouille_client.window.replay.timeline.steps_curve import StepsCurve
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.replay.viewer_keys import ViewerKeys
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.view import View

__all__ = ["Spectator"]

_BEFORE = "This was before; End goes back to live"
_OVER = "This was before. The game is over: End shows how it ended"


class Spectator:
    """A source for a window on somebody else's game, and its `strip`."""

    def __init__(
        self,
        game: Game,
        now: Callable[[], float],
        connected: Callable[[], bool] = lambda: True,
        language: Language | None = None,
    ) -> None:
        self.history = LiveHistory(game, now, language)
        self._remote = RemoteSource(game, now, connected, language, self.history.observe)
        self.playhead = Playhead(
            lambda: self.history.length,
            self.history.rate,
            now,
            first=self.history.first,
            live=True,
        )
        self.state = ViewerState(now)
        keys = ViewerKeys([self.history], self.playhead, self.state, now, talks=True)
        self.strip = TimelineStrip(self.history, self.playhead, self.state, keys, StepsCurve())

    def view(self) -> View:
        live = self._remote.view()
        self.history.sit(live.seats)
        if self.playhead.follows:
            return replace(live, hover=self.state.followed)
        return self._seen(live)

    def _seen(self, live: View) -> View:
        """What was seen where the playhead is."""
        history, position = self.history, self.playhead.position
        step = int(position) + (position % 1 > 0)
        moving = self.playhead.playing
        return replace(
            live,
            state=history.state(step),
            previous=history.state(step - 1),
            step=step,
            phase=position % 1 or 1.0 if moving else 1.0,
            clock="seen before",
            seats=history.seats(step),
            bubbles=bubbles_at(history, step),
            chat=history.chat(step, CHAT_LINES),
            status=_OVER if self._remote.finished else _BEFORE,
            outcome="",
            blocked=(),
            hover=self.state.followed,
            notice="",
            pause=None,
            waits_for=(),
        )

    def act(self, action: GroundAction) -> None:
        pass

    def say(self, text: str) -> None:
        self._remote.say(text)

    @property
    def finished(self) -> bool:
        return self._remote.finished
