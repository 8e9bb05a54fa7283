"""A history as a window's source: the moment at which the playhead is."""

from __future__ import annotations

from robotouille.errors import RobotouilleError
from robotouille.replay.timeline import Interlude
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State
from robotouille_client.window.replay.history.history import EntryKind, History
from robotouille_client.window.replay.playhead import Playhead
from robotouille_client.window.replay.viewer_state import ViewerState
from robotouille_client.window.sources.texts import outcome_words, won
from robotouille_client.window.view import Bubble, View

__all__ = ["NOTICE_SECONDS", "ReplaySource", "bubbles_at", "notices_at"]

NOTICE_SECONDS = 4.0
"""For how long what happened between two steps of a recording is told."""
BUBBLE_STEPS = 3
CHAT_LINES = 6


def bubbles_at(history: History, step: int) -> tuple[Bubble, ...]:
    """What was said and rejected in a step and the two before it: the last word of each player."""
    found = []
    for near in range(max(0, step - BUBBLE_STEPS + 1), step + 1):
        for entry in history.entries(near):
            if entry.kind is EntryKind.SAID and entry.player:
                found.append(Bubble(entry.player, entry.words, "chat"))
            elif entry.kind is EntryKind.REJECTED:
                found.append(Bubble.rejection(entry.player, next(iter(entry.reasons), "")))
    return tuple({bubble.player: bubble for bubble in found}.values())


def notices_at(interludes: list[Interlude], steps: int) -> dict[int, str]:
    """What to tell at which step: announcements for `steps` steps each, pauses until the game goes
    on."""
    told: dict[int, str] = {}
    for step, words, lasts in interludes:
        for later in range(step, step + (max(1, steps) if lasts else 1)):
            told[later] = words if later > step or step not in told else f"{told[step]} · {words}"
    return told


class ReplaySource:
    """A history, at the step where a playhead is; another one may be longer than it is.

    A state that cannot be told any more is not shown: the last one that could be stays, and the
    panel says so.

    Args:
        title: What the panel says while all is well.
    """

    def __init__(
        self, history: History, playhead: Playhead, state: ViewerState, title: str = ""
    ) -> None:
        self._history = history
        self._playhead = playhead
        self._viewer_state = state
        self._title = title
        self._notices = notices_at(history.interludes, round(playhead.rate * NOTICE_SECONDS))
        self._last: tuple[int, State] = (0, history.world.initial)

    def view(self) -> View:
        history, position = self._history, self._playhead.position
        step = min(int(position) + (position % 1 > 0), history.length)
        state, fault = self._state(step)
        if not fault:
            self._last = step, state
        ended = step == history.length and position >= history.length
        moving = self._playhead.playing and step > 0 and not ended and not fault
        outcome = history.outcome if ended else None
        return View(
            world=history.world,
            state=state,
            previous=self._state(step - 1)[0] if step and not fault else None,
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
            hover=self._viewer_state.followed,
            notice=self._notices.get(step, ""),
        )

    def _state(self, step: int) -> tuple[State, str]:
        """The state after a step, and what is wrong with it in words."""
        try:
            return self._history.state(step), ""
        except RobotouilleError as error:
            last, state = self._last
            return state, f"Step {step} cannot be shown, you see step {last}: {error}"

    def _missing(self) -> str:
        """What is missing of the recording, in words."""
        if self._history.fault:
            return f"The end is missing: {self._history.fault}"
        if self._history.outcome is None:
            return "This recording has no end: it was cut off, or is still being played"
        return self._title

    def act(self, action: GroundAction) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    @property
    def finished(self) -> bool:
        return self._playhead.position >= self._history.length
