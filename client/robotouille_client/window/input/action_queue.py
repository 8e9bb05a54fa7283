"""Queue of the local player's actions: one is sent at a time, the others wait."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.places import capitalised
from robotouille.world.presentation.usefulness import Occupancy
from robotouille_client.window.input.controls import ResolvedInput
from robotouille_client.window.view import Bubble, GameSource, View

MAX_QUEUED = 3
QUICK_SECONDS = 0.4
"""Time after an action during which a new input is queued. A later input replaces the action."""
SHOWN_SECONDS = 0.5
"""Time for which the result of an action is marked."""
PATIENCE_SECONDS = 2.0
"""Time for which a walk to an occupied station is retried."""


@dataclass(frozen=True, slots=True)
class Intent:
    """Input that is resolved to an action when its turn comes.

    Attributes:
        follows: True if the input is meant for the station that the walk before it leads to.
    """

    label: str
    resolve: Callable[[View], ResolvedInput]
    follows: bool = False


@dataclass(frozen=True, slots=True)
class _Retry:
    """Walk to an occupied station that is retried until a time in seconds."""

    label: str
    action: GroundAction
    until: float


@dataclass(frozen=True, slots=True)
class Sent:
    """The last action that was sent. `time` is when it was sent, or when its result was known."""

    action: GroundAction
    time: float
    step: int
    bubble: Bubble | None
    fate: Literal["asked", "done", "rejected"] = "asked"


class ActionQueue:
    """Queue that sends one action at a time."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._waiting: list[Intent] = []
        self._sent: Sent | None = None
        self._label = ""
        self._retry: _Retry | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the waiting actions, the next one first."""
        first = () if self._retry is None else (self._retry.label,)
        return (*first, *(intent.label for intent in self._waiting))

    @property
    def sent(self) -> Sent | None:
        """The last action, until shortly after its result is known."""
        sent = self._sent
        if sent is None or (sent.fate != "asked" and self._clock() - sent.time > SHOWN_SECONDS):
            return None
        return sent

    @property
    def idle(self) -> bool:
        """True if no action is queued or awaits its result."""
        return not self.labels and (self._sent is None or self._sent.fate != "asked")

    def clear(self) -> bool:
        """Drop the waiting actions and return whether there were any."""
        had = bool(self.labels)
        self._forget()
        return had

    def ask(self, intent: Intent, source: GameSource, view: View) -> str:
        """Send an input's action now or queue it; return a notice for the player, or "".

        An input that follows a walk waits until the walk has succeeded. Any other input replaces a
        walk that is being retried.
        """
        if view.frozen or view.me is None:
            return ""
        if view.lobby is not None and view.starts_in is None:
            return "The game hasn't started yet"
        self._settle(view)
        asked = self._sent if self._sent is not None and self._sent.fate == "asked" else None
        walks = asked is not None and asked.action.destination is not None
        if intent.follows and (walks or self._retry is not None):
            return self._wait(intent)
        # The player has changed their mind about the occupied station.
        if self._retry is not None:
            self._forget()
        busy = bool(view.state.busy_steps(view.me)) or view.starts_in is not None
        # A quick second press is meant for afterwards. A later one replaces the first action.
        just_sent = asked is not None and self._clock() - asked.time < QUICK_SECONDS
        if not (busy or just_sent or self._waiting):
            return self._do(intent, source, view)
        return self._wait(intent)

    def tick(self, source: GameSource, view: View) -> str:
        """Send the next action if possible; return a notice for the player, or ""."""
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
            return f"{MAX_QUEUED} actions are queued already"
        self._waiting.append(intent)
        return ""

    def _forget(self) -> None:
        self._waiting, self._retry = [], None

    def _do(self, intent: Intent, source: GameSource, view: View) -> str:
        resolved = intent.resolve(view)
        # The waiting inputs were meant to follow this action.
        if not resolved.valid:
            self._waiting = []
        if resolved.action is None:
            return capitalised(resolved.hint)
        self._label = intent.label
        self._send(resolved.action, source, view)
        return ""

    def _send(self, action: GroundAction, source: GameSource, view: View) -> None:
        self._sent = Sent(action, self._clock(), view.step, _bubble(view))
        source.act(action)

    def _try_again(self, retry: _Retry, source: GameSource, view: View) -> None:
        """Retry the walk if the station is free; give up when the time has passed."""
        if self._clock() > retry.until:
            self._forget()
        elif view.me is not None and retry.action in view.state.actions(view.me):
            self._send(retry.action, source, view)

    def _wanted(self, action: GroundAction, view: View) -> _Retry | None:
        """Return the retry of a rejected walk if only another player was in the way."""
        if action.destination is None:
            return None
        occupancy = Occupancy(view.world)
        unmet = view.world.unmet(view.state, action)
        # Other players move away after a while, but other conditions stay unmet.
        if not unmet or any(occupancy.needed_free(each) is None for each in unmet):
            return None
        if self._retry is not None and self._retry.action == action:
            return self._retry
        return _Retry(self._label, action, self._clock() + PATIENCE_SECONDS)

    def _settle(self, view: View) -> None:
        """Record the result of the action that was sent."""
        sent = self._sent
        if sent is None or sent.fate != "asked":
            return
        now, bubble = self._clock(), _bubble(view)
        fate: Literal["asked", "done", "rejected"] = "asked"
        # A rejection shows as a new bubble. The old bubble is about an earlier action.
        if bubble is not None and bubble is not sent.bubble:
            fate, self._retry = "rejected", self._wanted(sent.action, view)
            if self._retry is None:
                self._forget()
        elif view.step > sent.step:
            fate, self._retry = "done", None
        if fate != "asked":
            self._sent = Sent(sent.action, now, sent.step, bubble, fate)


def _bubble(view: View) -> Bubble | None:
    """Return the bubble that shows why the local player's last action was rejected."""
    own = (b for b in view.bubbles if b.player == view.me and b.kind == "rejected")
    return next(own, None)
