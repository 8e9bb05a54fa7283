"""Chat, speech bubbles and notices, and who waits for whom."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from robotouille.planning.policies.team_talk import (
    announced_version,
    appealed,
    next_intention,
    requested,
)
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.wording import Wording
from robotouille.world.presentation.work import Occupancy
from robotouille.world.scene import Placed, scene
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State
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

    `stood` is the station where the player asked, or last said to be waiting.
    """

    station: str
    whom: str
    until: float
    stood: str | None


class Blockages:
    """Players who wait for a station or for a teammate."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._waits: dict[tuple[str, str], float] = {}
        self._requests: dict[str, tuple[_Request, ...]] = {}

    def said(self, player: str, text: str, state: State, wording: Wording) -> None:
        """Read a chat message for requests to leave a station or to do something."""
        placed = scene(state)
        # Spectators have no place in the kitchen, so they cannot be held up.
        if player not in placed:
            return
        asked = [
            (station, other)
            for other, station in _standing(placed)
            if other != player and requested(text, station, state, wording)
        ]
        # A station says precisely what is needed; a name alone only says from whom.
        if not asked:
            whom = appealed(text, player, state, wording)
            asked = [] if whom is None else [("", whom)]
        if asked:
            until, stood = self._now() + ASKED_SECONDS, placed[player].at
            self._requests[player] = tuple(_Request(*each, until, stood) for each in asked)

    def refused(self, player: str, unmet: Iterable[Unmet], state: State) -> None:
        """Read the reasons of a rejected action for a station that another player occupies."""
        rules = Occupancy(state.world)
        for each in unmet:
            # The occupant may have left in the same step. Then nobody is in the way any more.
            station = rules.needed_free(each)
            if station is not None and {*rules.players_at(state, station)} - {player}:
                self._waits[player, station] = self._now() + BLOCKED_SECONDS

    def stepped(
        self,
        did: Iterable[tuple[str, GroundAction | None, bool]],
        waits: Collection[str],
        state: State,
    ) -> None:
        """Update requests after a step: (player, action, applied) in `did`, waiting in `waits`."""
        placed, until = scene(state), self._now() + ASKED_SECONDS
        # A player who works at something has given up the request. A walk alone proves nothing:
        # players step aside while they wait.
        for player, action, applied in did:
            if applied and action is not None:
                self._waits = {wait: t for wait, t in self._waits.items() if wait[0] != player}
                if action.destination is None:
                    self._requests.pop(player, None)
        # Bots that wait say so in each step, which renews their requests.
        for player in {*waits} & self._requests.keys():
            self._requests[player] = tuple(
                replace(each, until=until, stood=placed[player].at)
                for each in self._requests[player]
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


def _standing(placed: dict[str, Placed]) -> list[tuple[str, str]]:
    return [(name, each.at) for name, each in placed.items() if each.at is not None]


BUBBLE_SECONDS = 3.0
CHAT_LINES = 6
NOTICE_SECONDS = 6.0
READING_SECONDS = 0.06
"""Additional time for each letter of a notice."""


class ChatLog:
    """Recent chat lines, speech bubbles and the current notice."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._bubbles: list[tuple[float, Bubble]] = []
        self._lines: deque[tuple[str, str]] = deque(maxlen=CHAT_LINES)
        self._notice = ""
        self._notice_until = 0.0

    def rejected(
        self, player: str, unmet: Sequence[Unmet], text: Callable[[], str] | None = None
    ) -> None:
        """Show why an action was rejected: `text` or else the first unmet condition."""
        # The player has already replaced a superseded action, so its rejection needs no bubble.
        if all(each.kind is not UnmetKind.SUPERSEDED for each in unmet):
            words = text() if text else str(unmet[0]) if unmet else ""
            self._add(Bubble.rejection(player, words))

    def said(self, name: str, player: str, text: str) -> None:
        """Add a chat message."""
        # Bots announce their version of the team protocol to each other; people need not see it.
        if announced_version(text) is not None:
            return
        self._lines.append((name, text))
        if player:
            # The chat has the whole announcement; over a player there is room for its beginning.
            self._add(Bubble(player, next_intention(text) or text, "chat"))

    def repeated(self, name: str, text: str) -> None:
        """Add a chat message from before the local player returned."""
        if announced_version(text) is None:
            self._lines.append((name, text))

    def happened(self, text: str) -> None:
        """Add a game event, such as a participant who joins."""
        self._lines.append((NEWS, text))

    def announced(self, text: str) -> None:
        """Add an operator's announcement, and show it as a notice."""
        self._lines.append(("", text))
        self._notify(text)

    def add_game_event(self, text: str) -> None:
        """Add a game event, and show it as a notice."""
        self._lines.append((NEWS, text))
        self._notify(text)

    def _notify(self, text: str) -> None:
        self._notice = text
        # Long announcements stay longer, so that everyone has time to read them.
        self._notice_until = self._now() + NOTICE_SECONDS + READING_SECONDS * len(text)

    def _add(self, bubble: Bubble) -> None:
        # Two bubbles over one player would overlap, so the newest replaces the last.
        kept = [(t, b) for t, b in self._bubbles if b.player != bubble.player]
        self._bubbles = [*kept, (self._now(), bubble)]

    @property
    def bubbles(self) -> tuple[Bubble, ...]:
        now = self._now()
        return tuple(b for t, b in self._bubbles if now - t < BUBBLE_SECONDS)

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        return tuple(self._lines)

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

    def show_speech(
        self, name: str, player: str, text: str, state: State, wording: Wording
    ) -> None:
        """Show a chat message; `player` is empty for spectators."""
        self.chat_log.said(name, player, text)
        self.blockages.said(player, text, state, wording)
