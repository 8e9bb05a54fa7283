"""How often seats change hands: each coming and going is recorded, and may not fill a recording."""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.episode import Episode
from robotouille.errors import ProtocolError
from robotouille_server.runtime.token_bucket import TokenBucket

__all__ = ["SEAT_CHANGES", "SEAT_CHANGES_AT_ONCE", "SeatTurnover"]

SEAT_CHANGES, SEAT_CHANGES_AT_ONCE = 20, 40
"""How often a minute, and how often at once, a seat may be taken or come back to."""


class SeatTurnover:
    """A budget of changes for each seat. Time is an argument, in seconds."""

    __slots__ = ("_budgets",)

    def __init__(self, players: Iterable[str], now: float) -> None:
        self._budgets = {
            player: TokenBucket(SEAT_CHANGES / 60, now, SEAT_CHANGES_AT_ONCE) for player in players
        }

    def charge(self, player: str, now: float) -> None:
        """A seat is taken or come back to; ProtocolError `rate/seats` if that is too often."""
        if not self._budgets[player].take(now):
            message = f"{player} has changed hands too often just now; try again in a while"
            raise ProtocolError("rate/seats", message, "seat")

    def choose(self, episode: Episode, seat: str | None, now: float) -> str | None:
        """The seat to join, charged: the one that is asked for, or else a free one that has not
        changed hands too often. None, or one that is not there, is for the episode to refuse."""
        if seat is not None:
            if seat in self._budgets:
                self.charge(seat, now)
            return seat
        free = [seat.player for seat in episode.seats.values() if not seat.taken]
        calm = next((player for player in free if self._budgets[player].left(now) >= 1), None)
        if free:
            self.charge(calm or free[0], now)
        return calm
