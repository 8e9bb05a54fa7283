"""The absence rule of an episode: how long the game waits for absent participants."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.episode.lifecycle import Absence, PauseReason, PauseReasons
from robotouille.episode.record import EpisodeRecord
from robotouille.episode.seats import Seat, names_of

LOBBY_SECONDS = 600.0
"""Seconds for which an episode that has not started waits for a participant."""


class Presence:
    """Tracks who is absent, which pauses that causes, and when a seat is lost.

    Attributes:
        pauses: The reasons for which the game is paused now.
        complete: True while all seats' participants are present.
        opened: Time at which the episode was opened.
    """

    # Separate from the record, because recovery writes recorded steps and seats directly, and must
    # not trigger pauses with them.
    def __init__(self, record: EpisodeRecord, opened: float) -> None:
        self.pauses = PauseReasons()
        self.complete = False
        self.opened = opened
        self._record = record
        self._expected: set[str] = set()

    def update(self, now: float) -> None:
        """Update the pauses after a participant came or went."""
        record, seats = self._record, self._record.seats
        present = [seat.present for seat in seats.values()]
        self.complete = all(present)
        started, grace = record.in_progress, record.rules.grace
        # An episode that waits for its first participants stays open for longer than one grace, so
        # that its code can be shared before anybody comes.
        until = now + grace if started else self._open_until(now)
        self._set(PauseReason.DESERTED, not any(present), until)
        pausing = started and record.rules.absence is Absence.PAUSE
        self._set(PauseReason.ABSENCE, pausing and not self.complete, now + grace)
        # Participants come back one by one after a restart. The game goes on when the last one is
        # back.
        self._expected = {player for player in self._expected if not seats[player].present}
        if not self._expected and PauseReason.RESTART in self.pauses:
            self.lift(PauseReason.RESTART, now)

    def _open_until(self, now: float) -> float:
        rules = self._record.rules
        usual = now + max(rules.grace, LOBBY_SECONDS)
        if rules.open_for is None:
            return usual
        closes = self.opened + rules.open_for
        # A participant who was here once may come back, even just before the episode closes.
        return max(closes, usual) if self._record.used else closes

    def _set(self, why: PauseReason, applies: bool, until: float) -> None:
        if not applies:
            self.pauses.until.pop(why, None)
        elif why not in self.pauses:  # The first absence sets the end; a second does not extend it.
            self.pauses.until[why] = until

    def expect(self, players: Iterable[str], until: float) -> None:
        """Pause after a restart until these players are back, or until the given time."""
        self._expected = set(players)
        if self._expected:
            self.pauses.until[PauseReason.RESTART] = until

    def lift(self, why: PauseReason, now: float) -> None:
        """Remove a reason for a pause."""
        self.pauses.until.pop(why, None)
        if why is PauseReason.RESTART:
            self._expected.clear()
        if not self.pauses.outer:
            self.grant_grace(now)

    def grant_grace(self, now: float) -> None:
        """Restart the grace of all absent participants.

        Nobody may lose a seat for an absence during a pause that was not the participant's doing.
        """
        for absence in (PauseReason.DESERTED, PauseReason.ABSENCE):
            self.pauses.until.pop(absence, None)
        for seat in self._record.seats.values():
            if not seat.present:
                seat.away = now
        self.update(now)

    def due(self) -> float | None:
        """Return when the next pause ends by itself or the next seat is lost."""
        times = (self.pauses.due(), self._seat_due())
        return min((time for time in times if time is not None), default=None)

    def _seat_due(self) -> float | None:
        away = [seat.away for seat in self._record.seats.values() if self._may_lose(seat)]
        return min(away) + self._record.rules.grace if away else None

    def overdue(self, now: float) -> list[Seat]:
        """Return the seats of absent participants whose grace is over."""
        grace, seats = self._record.rules.grace, self._record.seats.values()
        return [seat for seat in seats if self._may_lose(seat) and now >= seat.away + grace]

    def _may_lose(self, seat: Seat) -> bool:
        # A deserted game is abandoned as a whole, and while an outer reason pauses the game no
        # absence counts. With `pause` and `bot` the seat is kept for as long as the game lasts.
        if seat.present or not seat.taken:
            return False
        if PauseReason.DESERTED in self.pauses or self.pauses.outer:
            return False
        rule = self._record.rules.absence
        return not self._record.in_progress or rule in (Absence.WAIT, Absence.END)

    def missing(self) -> str:
        """Return who is missing, as text for the outcome."""
        if PauseReason.DESERTED in self.pauses:
            return "everybody left" if self._record.used else "nobody came"
        missing = names_of(seat for seat in self._record.seats.values() if not seat.present)
        return f"{missing} did not come back"
