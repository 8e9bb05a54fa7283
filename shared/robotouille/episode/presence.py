"""Who is there, who is missing, and what waits for whom."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from robotouille.episode.pauses import PauseReason, PauseReasons
from robotouille.episode.rules import Absence, Rules
from robotouille.episode.seats import Seat, names_of

__all__ = ["LOBBY_SECONDS", "Presence"]

LOBBY_SECONDS = 600.0
"""For how long an episode that has not begun waits for somebody to come."""


class Presence:
    """The absence policy of an episode. `begun` says whether the game has begun.

    `pauses` are the reasons for which time stands still at present. `opened` is when the episode
    was opened, `used` whether anybody has ever taken a seat.
    """

    def __init__(self, seats: Mapping[str, Seat], rules: Rules, opened: float) -> None:
        self.pauses = PauseReasons()
        self.complete = False
        self.used = False
        self.opened = opened
        self._seats = seats
        self._rules = rules
        self._expected: set[str] = set()

    def watch(self, now: float, *, begun: bool) -> None:
        """Somebody came or went: who is waited for, and until when?"""
        here = [seat.present for seat in self._seats.values()]
        self.complete = all(here)
        grace = self._rules.grace
        until = now + grace if begun else self._open_until(now)
        self._set(PauseReason.DESERTED, not any(here), until)
        pausing = begun and self._rules.absence is Absence.PAUSE
        self._set(PauseReason.ABSENCE, pausing and not self.complete, now + grace)
        self._expected = {p for p in self._expected if not self._seats[p].present}
        if not self._expected and PauseReason.RESTART in self.pauses:
            self.lift(PauseReason.RESTART, now, begun=begun)

    def _open_until(self, now: float) -> float:
        """For how long an episode that has not begun waits for somebody to come."""
        usual, open_for = now + max(self._rules.grace, LOBBY_SECONDS), self._rules.open_for
        if open_for is None:
            return usual
        closes = self.opened + open_for
        return max(closes, usual) if self.used else closes

    def _set(self, why: PauseReason, applies: bool, until: float) -> None:
        if not applies:
            self.pauses.until.pop(why, None)
        elif why not in self.pauses:
            self.pauses.until[why] = until

    def expect(self, players: Iterable[str], until: float) -> None:
        """After a restart: let time stand still until these are back, or that time has come."""
        self._expected = set(players)
        if self._expected:
            self.pauses.until[PauseReason.RESTART] = until

    def lift(self, why: PauseReason, now: float, *, begun: bool) -> None:
        """A reason does not hold any more; whoever is absent has its whole grace before it."""
        self.pauses.until.pop(why, None)
        if why is PauseReason.RESTART:
            self._expected.clear()
        if not self.pauses.outer:
            self.grant_grace(now, begun=begun)

    def grant_grace(self, now: float, *, begun: bool) -> None:
        """Whoever is absent has its whole grace from now on."""
        for absence in (PauseReason.DESERTED, PauseReason.ABSENCE):
            self.pauses.until.pop(absence, None)
        for seat in self._seats.values():
            if not seat.present:
                seat.away = now
        self.watch(now, begun=begun)

    def due(self, *, begun: bool) -> float | None:
        """When the next pause ends by itself, or the next absent participant loses the seat."""
        times = (self.pauses.due(), self._seat_due(begun))
        return min((time for time in times if time is not None), default=None)

    def _seat_due(self, begun: bool) -> float | None:
        away = [seat.away for seat in self._seats.values() if self._may_lose(seat, begun)]
        return min(away) + self._rules.grace if away else None

    def overdue(self, now: float, *, begun: bool) -> list[Seat]:
        """The absent whose grace is over."""
        grace = self._rules.grace
        return [
            seat
            for seat in self._seats.values()
            if self._may_lose(seat, begun) and now >= seat.away + grace
        ]

    def _may_lose(self, seat: Seat, begun: bool) -> bool:
        if (
            seat.present
            or not seat.taken
            or PauseReason.DESERTED in self.pauses
            or self.pauses.outer
        ):
            return False
        return not begun or self._rules.absence in (Absence.WAIT, Absence.END)

    def missing(self) -> str:
        """Whom we miss, in words."""
        if PauseReason.DESERTED in self.pauses:
            return "everybody left" if self.used else "nobody came"
        missing = names_of(seat for seat in self._seats.values() if not seat.present)
        return f"{missing} did not come back"
