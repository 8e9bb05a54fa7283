"""What somebody wants done: the next thing is sent as soon as it can be, the others wait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.people.templates import capitalised
from robotouille_client.window.hands.controls import Meaning
from robotouille_client.window.view import Bubble, Source, View

__all__ = ["MAX_QUEUED", "ActionQueue", "Intent", "Sent"]

MAX_QUEUED = 3
QUICK_SECONDS = 0.4
"""Within these another input comes after the one that was sent; later it comes in its place."""
SHOWN_SECONDS = 0.5
PATIENCE_SECONDS = 2.0
"""For how long a walk to where somebody stands is tried again, should they go."""


@dataclass(frozen=True, slots=True)
class Intent:
    """An input, read when its turn comes; `label` says it in a word or two.

    One that `follows` is meant for the place that a walk before it leads to.
    """

    label: str
    read: Callable[[View], Meaning]
    follows: bool = False


@dataclass(frozen=True, slots=True)
class _Retry:
    """A walk to a place that was taken, and until when it is wanted, in seconds."""

    label: str
    action: GroundAction
    until: float


@dataclass(frozen=True, slots=True)
class Sent:
    """The newest action that was sent, and what became of it by `time`, in seconds."""

    action: GroundAction
    time: float
    step: int
    bubble: Bubble | None
    fate: Literal["asked", "done", "refused"] = "asked"


class ActionQueue:
    """Sends one action at a time; time is injected."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._waiting: list[Intent] = []
        self._sent: Sent | None = None
        self._label = ""
        self._retry: _Retry | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """What waits, the next first."""
        first = () if self._retry is None else (self._retry.label,)
        return (*first, *(intent.label for intent in self._waiting))

    @property
    def sent(self) -> Sent | None:
        """The newest action, until a moment after it was answered."""
        sent = self._sent
        if sent is None or (sent.fate != "asked" and self._clock() - sent.time > SHOWN_SECONDS):
            return None
        return sent

    @property
    def idle(self) -> bool:
        """Whether nothing waits, here or for an answer."""
        return not self.labels and (self._sent is None or self._sent.fate != "asked")

    def clear(self) -> bool:
        """Forget what waits; whether there was anything."""
        had = bool(self.labels)
        self._forget()
        return had

    def ask(self, intent: Intent, source: Source, view: View) -> str:
        """Do something now, or when what came before it is done; a notice, or nothing.

        What follows waits for a walk that is not answered, or tried again; all else comes in the
        place of one that is tried again.
        """
        if view.frozen or view.me is None:
            return ""
        if view.lobby is not None and view.starts_in is None:
            return "The game has not begun"
        self._settle(view)
        asked = self._sent if self._sent is not None and self._sent.fate == "asked" else None
        walks = asked is not None and asked.action.destination is not None
        if intent.follows and (walks or self._retry is not None):
            return self._wait(intent)
        if self._retry is not None:
            self._forget()
        busy = bool(view.state.busy_steps(view.me)) or view.starts_in is not None
        just_sent = asked is not None and self._clock() - asked.time < QUICK_SECONDS
        if not (busy or just_sent or self._waiting):
            return self._do(intent, source, view)
        return self._wait(intent)

    def tick(self, source: Source, view: View) -> str:
        """Send the next thing where it can be sent now; a notice, or nothing."""
        self._settle(view)
        if view.over:
            self.clear()
        if view.frozen or view.me is None or view.starts_in is not None:
            return ""
        if self._sent is not None and self._sent.fate == "asked":
            return ""
        if view.state.busy_steps(view.me):
            return ""
        if self._retry is not None:
            self._try_again(self._retry, source, view)
            return ""
        if not self._waiting:
            return ""
        return self._do(self._waiting.pop(0), source, view)

    def _wait(self, intent: Intent) -> str:
        if len(self._waiting) >= MAX_QUEUED:
            return f"{MAX_QUEUED} things wait already"
        self._waiting.append(intent)
        return ""

    def _forget(self) -> None:
        self._waiting, self._retry = [], None

    def _do(self, intent: Intent, source: Source, view: View) -> str:
        meaning = intent.read(view)
        if not meaning.valid:
            self._waiting = []
        if meaning.action is None:
            return capitalised(meaning.hint)
        self._label = intent.label
        self._send(meaning.action, source, view)
        return ""

    def _send(self, action: GroundAction, source: Source, view: View) -> None:
        self._sent = Sent(action, self._clock(), view.step, _bubble(view))
        source.act(action)

    def _try_again(self, retry: _Retry, source: Source, view: View) -> None:
        """Walk there, if the place is free by now; in the end it is given up, with what was to be
        done there."""
        if self._clock() > retry.until:
            self._forget()
        elif view.me is not None and retry.action in view.state.actions(view.me):
            self._send(retry.action, source, view)

    def _wanted(self, action: GroundAction, view: View) -> _Retry | None:
        """What to try again of a walk that was refused: if nothing but somebody was in the way."""
        if action.destination is None:
            return None
        occupancy = Occupancy(view.world)
        unmet = view.world.unmet(view.state, action)
        if not unmet or any(occupancy.needed_free(each) is None for each in unmet):
            return None
        if self._retry is not None and self._retry.action == action:
            return self._retry
        return _Retry(self._label, action, self._clock() + PATIENCE_SECONDS)

    def _settle(self, view: View) -> None:
        """Notice what became of the action that was sent."""
        sent = self._sent
        if sent is None or sent.fate != "asked":
            return
        now, bubble = self._clock(), _bubble(view)
        fate: Literal["asked", "done", "refused"] = "asked"
        if bubble is not None and bubble is not sent.bubble:
            fate, self._retry = "refused", self._wanted(sent.action, view)
            if self._retry is None:
                self._forget()
        elif view.step > sent.step:
            fate, self._retry = "done", None
        if fate != "asked":
            self._sent = Sent(sent.action, now, sent.step, bubble, fate)


def _bubble(view: View) -> Bubble | None:
    """Why the owner's newest action was refused, as long as that is seen."""
    own = (b for b in view.bubbles if b.player == view.me and b.kind == "rejected")
    return next(own, None)
