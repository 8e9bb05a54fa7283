"""Chat, speech bubbles and notices."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from robotouille.episode import ChatPosted
from robotouille.planning.policies.team_talk import (
    next_intention,
)
from robotouille.world.presentation.signals import (
    Intent,
    Signal,
    is_outdated,
    named,
    signal_fault,
    signal_text,
)
from robotouille.world.presentation.unserved import unserved
from robotouille.world.presentation.wording import Wording
from robotouille.world.scene import scene
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State
from robotouille_client.sansio.game_events import ChatReceived
from robotouille_client.window.sources.blockages import Blockages, TakenStep
from robotouille_client.window.sources.texts import signal_words, speaker, unserved_words
from robotouille_client.window.view import NEWS, Bubble

BUBBLE_SECONDS = 3.0
SIGNAL_SECONDS = 5.0
"""Seconds for which a signal is shown: others have to find what it points at."""
GLANCE_SECONDS = 0.8
"""Seconds for which the reason of a rejection is shown at least."""
CHAT_LINES = 6
NOTICE_SECONDS = 6.0
READING_SECONDS = 0.06
"""Additional time for each letter of a notice."""


@dataclass(frozen=True, slots=True)
class _Shown:
    """Bubble that is shown between two times in seconds, and the signal that it shows, if any."""

    since: float
    until: float
    bubble: Bubble
    signal: Signal | None

    @property
    def announces(self) -> bool:
        """True if the bubble shows what a player is going to work with."""
        return bool(self.bubble.things) and self.signal is None

    def is_read(self, now: float) -> bool:
        """Return whether a player has had the time to read why an action was rejected."""
        return self.bubble.kind == "rejected" and now - self.since >= GLANCE_SECONDS

    def is_met(self, before: State, state: State) -> bool:
        """Return whether a request has been met in a step."""
        if self.signal is None:
            return False
        player = self.bubble.player
        # People also point at what is free.
        was_met = is_outdated(self.signal, player, before)
        return is_outdated(self.signal, player, state) and not was_met


class ChatLog:
    """Recent chat lines, speech bubbles and the current notice."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._bubbles: list[_Shown] = []
        self._lines: deque[tuple[str, str, int]] = deque(maxlen=CHAT_LINES)
        """Speakers, texts, and the number of times of each."""
        self._notice = self._about = ""
        self._notice_until = 0.0

    def rejected(
        self, player: str, unmet: Sequence[Unmet], text: Callable[[], str] | None = None
    ) -> None:
        """Show why an action was rejected: `text` or else the first unmet condition."""
        # The player has already replaced a superseded action, so its rejection needs no bubble.
        if all(each.kind is not UnmetKind.SUPERSEDED for each in unmet):
            words = text() if text else str(unmet[0]) if unmet else ""
            self._add(Bubble.rejection(player, words))

    def said(
        self,
        name: str,
        player: str,
        text: str,
        signal: Signal | None = None,
        things: tuple[str, ...] = (),
    ) -> None:
        """Add a chat message, or a signal with its sentence.

        An announcement of a player's next actions shows over the player only: bots make so many
        that requests would be lost among them.

        Args:
            things: Objects whose pictures tell what an announcement of actions is about.
        """
        announced = next_intention(text) if player else ""
        if not announced:
            self._write(name, text)
        if not player:
            return
        if signal is not None:
            words, shown = signal_words(signal.intent), (signal.target,) if signal.target else ()
            bubble = Bubble(player, words, "chat", shown, signal.target)
            self._add(bubble, SIGNAL_SECONDS, signal)
        else:
            # Pictures say what is next.
            words = "" if things else announced or text
            self._add(Bubble(player, words, "chat", things))

    def repeated(self, name: str, text: str) -> None:
        """Add a chat message from before the local player returned."""
        if not next_intention(text):
            self._write(name, text)

    def _write(self, name: str, text: str) -> None:
        """Add a line. It replaces an equal one among the lines that are shown."""
        before = next((line for line in self._lines if line[:2] == (name, text)), None)
        if before is not None:
            self._lines.remove(before)
        self._lines.append((name, text, 1 if before is None else before[2] + 1))

    def happened(self, text: str) -> None:
        """Add a game event, such as a participant who joins."""
        self._lines.append((NEWS, text, 1))

    def announced(self, text: str) -> None:
        """Add an operator's announcement, and show it as a notice."""
        self._lines.append(("", text, 1))
        self.notify(text)

    def add_game_event(self, text: str) -> None:
        """Add a game event, and show it as a notice."""
        self._lines.append((NEWS, text, 1))
        self.notify(text)

    def notify(self, text: str, about: str = "") -> None:
        """Show a notice that is not a line of the chat, about a station if one is named."""
        self._notice, self._about = text, about
        # Long announcements stay longer, so that everyone has time to read them.
        self._notice_until = self._now() + NOTICE_SECONDS + READING_SECONDS * len(text)

    def withdraw(self, about: str) -> None:
        """Remove the notice about a station, if it is shown."""
        if about == self._about:
            self._notice = ""

    def stepped(self, before: State, step: TakenStep) -> None:
        """Remove the bubbles that a step has outdated."""
        state = step.after
        # Players who do something else know by now why their last action was rejected.
        acted = {player for player, action, applied in step.did if applied and action is not None}
        self._bubbles = [
            each for each in self._bubbles
            if not each.is_met(before, state)
            and not (each.is_read(self._now()) and each.bubble.player in acted)
        ]  # fmt: skip
        # This runs in every step. In most steps nothing is announced, so skip computing the scene.
        if any(each.announces for each in self._bubbles):
            self._remove_announcements(before, state)

    def ended(self) -> None:
        """Remove the bubbles about work, which the end of the game has outdated."""
        self._bubbles = [
            each for each in self._bubbles
            if not each.announces and (each.signal is None or each.signal.intent is Intent.THANKS)
        ]  # fmt: skip

    def _remove_announcements(self, before: State, state: State) -> None:
        """Remove announcements of actions with things that other players have just taken."""
        earlier, now, players = scene(before), scene(state), {*state.world.players}
        taken = {
            name: each.host
            for name, each in now.items()
            if each.host in players and name in earlier and earlier[name].host not in players
        }

        def holds(shown: _Shown) -> bool:
            bubble = shown.bubble
            takers = {taken.get(name, bubble.player) for name in bubble.things}
            return not shown.announces or takers == {bubble.player}

        self._bubbles = [each for each in self._bubbles if holds(each)]

    def _add(
        self, bubble: Bubble, seconds: float = BUBBLE_SECONDS, signal: Signal | None = None
    ) -> None:
        # Two bubbles over one player would overlap, so the newest replaces the last.
        kept = [each for each in self._bubbles if each.bubble.player != bubble.player]
        self._bubbles = [*kept, _Shown(self._now(), self._now() + seconds, bubble, signal)]

    @property
    def bubbles(self) -> tuple[Bubble, ...]:
        now = self._now()
        return tuple(each.bubble for each in self._bubbles if now < each.until)

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        return tuple(
            (name, text if times == 1 else f"{text} ×{times}") for name, text, times in self._lines
        )

    @property
    def notice(self) -> str:
        """The last announcement while it is new."""
        return self._notice if self._now() < self._notice_until else ""


@dataclass(frozen=True, slots=True)
class Feedback:
    """Chat log and blockages of one game, updated together."""

    chat_log: ChatLog
    blockages: Blockages

    def show_rejection(
        self,
        player: str,
        sentence: str,
        unmet: Sequence[Unmet],
        state: State,
        wording: Wording,
    ) -> None:
        """Show why a player's action was rejected, and who was in the way."""
        # Finding the words is slow, so the chat log calls this only if it shows them.
        text = partial(wording.rejection, sentence, player, unmet, state)
        self.chat_log.rejected(player, unmet, text)
        self.blockages.refused(player, unmet, state)

    def stepped(self, step: TakenStep, wording: Wording) -> None:
        """Update what is shown after a step."""
        self.blockages.stepped(step, wording)
        before, state = step.before, step.after
        if before is None:
            return
        self.chat_log.stepped(before, step)
        if state.orders is not None:
            self._show_unserved(before, state, wording)

    def _show_unserved(self, before: State, state: State, wording: Wording) -> None:
        """Show why a dish that looks ready since a step is not served, until it changes."""
        known = {(each.station, each.things) for each in unserved(before, wording)}
        now = {(each.station, each.things): each for each in unserved(state, wording)}
        for station, _ in known - now.keys():
            self.chat_log.withdraw(station)
        for (station, _), each in now.items():
            if (station, each.things) not in known:
                self.chat_log.notify(unserved_words(each), about=station)

    def show_speech(
        self, said: ChatPosted | ChatReceived, player: str, state: State, wording: Wording
    ) -> None:
        """Show a chat message or signal; `player` is empty for spectators."""
        text, signal = said.text, said.signal
        if signal is not None and not signal_fault(signal, player, state):
            # In the words of this window.
            text = signal_text(signal, state, wording)
        upcoming = next_intention(text)
        things = named(upcoming, state, wording) if upcoming else ()
        self.chat_log.said(speaker(said.name, player), player, text, signal, things)
        self.blockages.said(player, text, signal, state, wording)
