"""How often seats change: each coming and going, and who is ready or not, is recorded, and may not
fill a recording."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from robotouille.episode import Episode
from robotouille.errors import ProtocolError
from robotouille.planning.policies.standing import is_out_of_the_way
from robotouille.protocol import messages
from robotouille_server.runtime.token_bucket import TokenBucket

__all__ = ["SEAT_CHANGES", "SEAT_CHANGES_AT_ONCE", "SeatTurnover"]

SEAT_CHANGES, SEAT_CHANGES_AT_ONCE = 20, 40
"""How often a minute, and how often at once, a seat may be taken, come back to, or ready or not."""


class SeatTurnover:
    """A budget of changes for each seat. Time is an argument, in seconds."""

    __slots__ = ("_budgets",)

    def __init__(self, players: Iterable[str], now: float) -> None:
        self._budgets = {
            player: TokenBucket(SEAT_CHANGES / 60, now, SEAT_CHANGES_AT_ONCE) for player in players
        }

    def charge(
        self, players: Iterable[str], now: float, too_often: str = "has changed hands"
    ) -> None:
        """Something changes of seats: they are taken, come back to, or ready or not. ProtocolError
        `rate/seats`, and none is charged, if that was `too_often` for one of them."""
        budgets = {player: self._budgets[player] for player in players}
        for player, budget in budgets.items():
            if budget.left(now) < 1:
                message = f"{player} {too_often} too often just now; try again in a while"
                raise ProtocolError("rate/seats", message, "seat")
        for budget in budgets.values():
            budget.take(now)

    def choose(
        self, episode: Episode, request: messages.Join, now: float, *, idle: bool = False
    ) -> Sequence[str]:
        """The seats to join, charged: those that are asked for, all that are free, or a free one
        that has not changed hands too often.

        Args:
            idle: Whether who joins may stand still for long: a free seat is then one that stands
                in nobody's way, if there is one.

        Raises:
            ProtocolError: As `Episode.join` does, or `rate/seats`; nothing is charged then.
        """
        players = self._wanted(episode, request, now, idle=idle)
        episode.check_free(players)
        self.charge(players, now)
        return players

    def _wanted(
        self, episode: Episode, request: messages.Join, now: float, *, idle: bool
    ) -> Sequence[str]:
        if request.seat is not None:
            return (request.seat,)
        if request.seats and request.seats != "all":
            return request.seats
        free = episode.free_seats()
        if request.seats == "all":
            return free
        rested = [one for one in free if self._budgets[one].left(now) >= 1] or list(free[:1])
        aside = (one for one in rested if idle and is_out_of_the_way(episode.state, one))
        return [next(aside, rested[0])]
