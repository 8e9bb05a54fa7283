"""Chat, speech bubbles and notices, and who waits for whom."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from robotouille.episode import ChatPosted
from robotouille.planning.policies.team_talk import (
    appeal,
    appealed,
    next_intention,
    requested,
)
from robotouille.world.grounding.actions import GroundAction
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
from robotouille.world.presentation.work import Occupancy
from robotouille.world.scene import Placed, scene
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State
from robotouille_client.sansio.game_events import ChatReceived
from robotouille_client.window.sources.texts import signal_words, speaker, unserved_words
from robotouille_client.window.view import NEWS, Bubble

BLOCKED_SECONDS = 30.0
"""Time for which a rejected player counts as waiting.

It ends earlier if the station becomes free or the player does something else. It is long, because a
mark that comes and goes does not show who has to move.
"""
ASKED_SECONDS = 30.0
"""Time for which a player who asked for something counts as waiting.

It is longer because a request is deliberate, and answering it can take a walk and some work.
"""


@dataclass(frozen=True, slots=True)
class _Request:
    """Request to `whom` to leave a station or, without a station, to do something.

    `stood` is the station where the player asked, or last said to be waiting; `text` is the
    message.
    """

    station: str
    whom: str
    until: float
    stood: str | None
    text: str


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a game.

    Attributes:
        before: State before the step; None if it is not known.
        did: (player, action, applied) for each player.
        waits: Players that said they wait.
    """

    before: State | None
    after: State
    did: Sequence[tuple[str, GroundAction | None, bool]] = ()
    waits: Collection[str] = ()


class Blockages:
    """Players who wait for a station or for a teammate."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waits: dict[tuple[str, str], float] = {}
        self._requests: dict[str, tuple[_Request, ...]] = {}
        self._earlier: dict[str, tuple[_Request, ...]] = {}

    def said(
        self, player: str, text: str, signal: Signal | None, state: State, wording: Wording
    ) -> None:
        """Read a chat message for requests to leave a station or to do something."""
        placed = scene(state)
        # Spectators have no place in the kitchen, so they cannot be held up.
        if player not in placed:
            return
        asked = [
            (station, other)
            for other, station in _standing(placed)
            if other != player and _asks_for(station, text, signal, state, wording)
        ]
        # A station says precisely what is needed; a name alone only says from whom.
        if not asked:
            whom = appealed(text, player, state, wording)
            asked = [] if whom is None else [("", whom)]
        if asked:
            until, stood = self._now() + ASKED_SECONDS, placed[player].at
            self._requests[player] = tuple(_Request(*each, until, stood, text) for each in asked)

    def refused(self, player: str, unmet: Iterable[Unmet], state: State) -> None:
        """Read the reasons of a rejected action for a station that another player occupies."""
        rules = Occupancy(state.world)
        for each in unmet:
            # The occupant may have left in the same step. Then nobody is in the way any more.
            station = rules.needed_free(each)
            if station is not None and {*rules.players_at(state, station)} - {player}:
                self._waits[player, station] = self._now() + BLOCKED_SECONDS

    def stepped(self, step: Step, wording: Wording) -> None:
        """Update requests after a step."""
        placed, now = scene(step.after), self._now()
        self._settle(step, wording)
        # A player who works at something does not need the request now. A walk alone proves
        # nothing: players step aside while they wait.
        for player, action, applied in step.did:
            if applied and action is not None:
                self._waits = {wait: t for wait, t in self._waits.items() if wait[0] != player}
                if action.destination is None and player in self._requests:
                    self._earlier[player] = self._requests.pop(player)
        # Bots that wait say so in each step, which renews their requests. They do not ask again
        # after other work.
        for player in {*step.waits} & self._earlier.keys():
            again = tuple(each for each in self._earlier.pop(player) if each.until > now)
            self._requests.setdefault(player, again)
        for player in {*step.waits} & self._requests.keys():
            self._requests[player] = tuple(
                replace(each, until=now + ASKED_SECONDS, stood=placed[player].at)
                for each in self._requests[player]
            )

    def _settle(self, step: Step, wording: Wording) -> None:
        """Remove the requests to do what has been done in a step."""
        before = step.before
        if before is None:
            return
        asked = {each.whom for requests in self._requests.values() for each in requests}
        # Whoever does it, nobody has to do it any more.
        done = {
            appeal(action, before, wording).casefold()
            for _, action, applied in step.did
            if asked and applied and action is not None
        }
        for player, requests in self._requests.items():
            self._requests[player] = tuple(
                each for each in requests if each.text.casefold() not in done
            )

    def at(self, state: State) -> tuple[tuple[str, str, str], ...]:
        """Return (player, station, occupant) for each player who waits in a state.

        The station is empty if the player waits for a teammate to do something.
        """
        now = self._now()
        self._waits = {wait: until for wait, until in self._waits.items() if until > now}
        # This runs in every frame. In most frames no player waits, so skip computing the scene.
        if not (self._waits or self._requests):
            return ()
        placed = scene(state)
        by = {station: player for player, station in _standing(placed)}
        self._requests = {
            player: tuple(
                each
                for each in requests
                if each.until > now and by.get(each.station, each.whom) != player
                and (not each.station or each.station in by)
            )
            for player, requests in self._requests.items()
        }  # fmt: skip
        self._requests = {player: found for player, found in self._requests.items() if found}
        # A player who walked away after asking is not shown as waiting.
        found = dict.fromkeys(
            (player, each.station, by.get(each.station, each.whom))
            for player, requests in self._requests.items()
            for each in requests
            if placed[player].at == each.stood
        )
        refused = ((player, station, by.get(station, player)) for player, station in self._waits)
        found.update(dict.fromkeys(one for one in refused if one[0] != one[2]))
        return tuple(found)


def _asks_for(
    station: str, text: str, signal: Signal | None, state: State, wording: Wording
) -> bool:
    if signal is None:
        return requested(text, station, state, wording)
    return signal == Signal(Intent.NEED, station)


def _standing(placed: dict[str, Placed]) -> list[tuple[str, str]]:
    return [(name, each.at) for name, each in placed.items() if each.at is not None]


BUBBLE_SECONDS = 3.0
SIGNAL_SECONDS = 5.0
"""Seconds for which a signal is shown: others have to find what it points at."""
CHAT_LINES = 6
NOTICE_SECONDS = 6.0
READING_SECONDS = 0.06
"""Additional time for each letter of a notice."""


class ChatLog:
    """Recent chat lines, speech bubbles and the current notice."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._bubbles: list[tuple[float, Bubble, Signal | None]] = []
        """Bubbles, until when they are shown, and the signals that some of them show."""
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

    def stepped(self, before: State, state: State) -> None:
        """Remove the bubbles that a step has outdated."""
        self._bubbles = [
            (until, bubble, signal) for until, bubble, signal in self._bubbles
            if signal is None
            or not is_outdated(signal, bubble.player, state)
            # People also point at what is free.
            or is_outdated(signal, bubble.player, before)
        ]  # fmt: skip
        self._remove_announcements(before, state)

    def ended(self) -> None:
        """Remove the bubbles about work, which the end of the game has outdated."""
        self._bubbles = [
            (until, bubble, signal) for until, bubble, signal in self._bubbles
            if (signal.intent is Intent.THANKS if signal else not bubble.things)
        ]  # fmt: skip

    def _remove_announcements(self, before: State, state: State) -> None:
        """Remove announcements of actions with things that other players have just taken."""
        announced = [each for _, each, signal in self._bubbles if each.things and signal is None]
        # This runs in every step. In most steps nothing is announced, so skip computing the scene.
        if not announced:
            return
        earlier, now, players = scene(before), scene(state), {*state.world.players}
        taken = {
            name: each.host
            for name, each in now.items()
            if each.host in players and name in earlier and earlier[name].host not in players
        }
        outdated = [
            each for each in announced
            if any(taken.get(name, each.player) != each.player for name in each.things)
        ]  # fmt: skip
        self._bubbles = [row for row in self._bubbles if row[1] not in outdated]

    def _add(
        self, bubble: Bubble, seconds: float = BUBBLE_SECONDS, signal: Signal | None = None
    ) -> None:
        # Two bubbles over one player would overlap, so the newest replaces the last.
        kept = [row for row in self._bubbles if row[1].player != bubble.player]
        self._bubbles = [*kept, (self._now() + seconds, bubble, signal)]

    @property
    def bubbles(self) -> tuple[Bubble, ...]:
        now = self._now()
        return tuple(bubble for until, bubble, _ in self._bubbles if now < until)

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

    def stepped(self, step: Step, wording: Wording) -> None:
        """Update what is shown after a step."""
        self.blockages.stepped(step, wording)
        before, state = step.before, step.after
        if before is None:
            return
        self.chat_log.stepped(before, state)
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
