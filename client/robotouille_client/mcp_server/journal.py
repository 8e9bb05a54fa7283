"""What has happened in a game since its player last looked, in words."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from robotouille.program import quoted
from robotouille.protocol import messages
from robotouille_client.game import Game
from robotouille_client.sansio.game_events import (
    Announced,
    Changed,
    GameEvent,
    Heard,
    NotSaid,
    Over,
    RosterChanged,
)

__all__ = ["ChatLine", "Journal", "News"]

MAX_LINES = 40
MAX_CHAT = 40


@dataclass(frozen=True, slots=True)
class ChatLine:
    """What a participant has said; `seat` is empty for a spectator, `own` are one's own words."""

    name: str
    seat: str
    text: str
    own: bool = False


@dataclass(frozen=True, slots=True)
class News:
    """What one has not been told before; `left_out` lines and chat messages were too many."""

    happened: tuple[str, ...] = ()
    chat: tuple[ChatLine, ...] = ()
    left_out: int = 0


class Journal:
    """Turns the events of a game into lines, and keeps those that were not read.

    `unread` says whether there is anything that its reader waits for: what others do and say, and
    what becomes of the kitchen, but not one's own words. These are counted as they come back.
    """

    def __init__(self, game: Game) -> None:
        self.unread = False
        self.own_words = 0
        self._game = game
        self._phase = game.phase
        self._seats = game.seats
        self._step = game.step
        self._lines: deque[str] = deque(maxlen=MAX_LINES)
        self._chat: deque[ChatLine] = deque(maxlen=MAX_CHAT)
        self._taken = 0

    def take(self, event: GameEvent) -> None:
        """Write down what an event means."""
        match event:
            case Changed():
                self._changed(event)
            case Heard():
                self._heard(event)
            case RosterChanged():
                for line in (*self._phase_lines(event), *self._seat_lines(event.seats)):
                    self._write(line)
            case Announced():
                self._write(f"The operator of the server says {quoted(event.text)}")
            case NotSaid():
                self._write(f"What you said was not told: {quoted(event.reason)}")
            case Over():
                why = f" ({quoted(event.reason)})" if event.reason else ""
                self._write(f"The episode is over for you{why}.")
            case _:
                pass

    def read(self) -> News:
        """What was not read before."""
        lines, chat = tuple(self._lines), tuple(self._chat)
        news = News(lines, chat, self._taken - len(lines) - len(chat))
        self._lines.clear()
        self._chat.clear()
        self._taken, self.unread = 0, False
        return news

    def _write(self, line: str) -> None:
        self.unread = True
        self._taken += 1
        self._lines.append(line)

    def _changed(self, event: Changed) -> None:
        step, self._step = self._step, event.step
        if event.previous is None:
            if event.step > step + 1:
                self._write(f"Steps {step + 1} to {event.step} passed while the line was lost.")
            return
        if event.state.facts != event.previous.facts:
            self.unread = True
        for player, action, applied in event.did:
            if player != self._game.seat:
                failed = "" if applied else " (it was too late for that)"
                self._write(f"Step {event.step}: {player}: {action.sentence}{failed}")

    def _heard(self, event: Heard) -> None:
        own = event.name == self._game.name and event.seat == (self._game.seat or "")
        self._taken += 1
        self._chat.append(ChatLine(event.name, event.seat, event.text, own))
        if own:
            self.own_words += 1
        else:
            self.unread = True

    def _phase_lines(self, event: RosterChanged) -> Iterator[str]:
        before, self._phase = self._phase, event.phase
        if before == event.phase:
            return
        if event.phase == "running":
            yield "The game has begun." if before == "waiting" else "The game goes on."
        elif event.phase == "paused":
            why = f" ({event.pause.reason})" if event.pause is not None else ""
            yield f"The game stands still{why}."

    def _seat_lines(self, seats: tuple[messages.SeatInfo, ...]) -> Iterator[str]:
        known = {seat.player: seat for seat in self._seats}
        self._seats = seats
        for seat in seats:
            before = known.get(seat.player)
            if before is None or seat.player == self._game.seat:
                continue
            if (before.name, before.controller) != (seat.name, seat.controller):
                yield _who_plays(seat)


def _who_plays(seat: messages.SeatInfo) -> str:
    if not seat.name:
        return f"{seat.player} is free."
    match seat.controller:
        case "absent":
            return f"{seat.player} stands still: {quoted(seat.name)} is away."
        case "stand-in":
            return f"{seat.player} is moved by a stand-in: {quoted(seat.name)} is away."
        case _:
            return f"{seat.player} is played by {quoted(seat.name)} ({seat.kind})."
