"""Seats that a study shows as another kind, and the bots that see each other all the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pydantic import BaseModel

from robotouille.episode import Controller, Episode
from robotouille.protocol import messages
from robotouille_server.auth import Role
from robotouille_server.rooms.participants.session import Session


class Disguises:
    """Decides which bots learn that a seat is a bot which others see as a person or a model.

    Anyone can claim to be a bot in `hello`. Hosts, however, may know the conditions of a study, so
    the bots of hosts see each other as bots. No other client does, and a host's bot does not see
    through the disguise of other bots: the bots of a team must agree on its members.

    Args:
        episode: The episode.
        holder: Returns the session that has a seat.
    """

    __slots__ = ("_episode", "_holder", "_players")

    def __init__(self, episode: Episode, holder: Callable[[str], Session | None]) -> None:
        self._episode = episode
        self._holder = holder
        self._players = [s.player for s in episode.seats.values() if s.treatment.shown_as]

    def sees_through(self, session: Session | None) -> bool:
        """Return whether a session is a host's bot, in an episode with disguised seats."""
        if not self._players or session is None or not session.players:
            return False
        return session.kind == Controller.BOT and session.role.includes(Role.HOST)

    def hears(self, session: Session, seat: str) -> bool:
        """Return whether a bot receives the texts that a seat's bot sends to its team."""
        treated = self._episode.seat(seat).treatment.shown_as
        if treated in (None, Controller.BOT) or seat in session.players:
            return True
        return self.sees_through(session) and self.sees_through(self._holder(seat))

    def shown(self, message: BaseModel, session: Session) -> BaseModel:
        """Return a message as a session may see it."""
        if not isinstance(message, messages.Roster) or not self.sees_through(session):
            return message
        return message.model_copy(update={"seats": self.seats(message.seats, session)})

    def seats(
        self, seats: Sequence[messages.SeatInfo], session: Session
    ) -> Sequence[messages.SeatInfo]:
        """Return the seats as a session may see them."""
        if not self.sees_through(session):
            return seats
        return [self._revealed(s) if s.player in self._players else s for s in seats]

    def _revealed(self, shown: messages.SeatInfo) -> messages.SeatInfo:
        if not self.sees_through(self._holder(shown.player)):
            return shown
        seat = self._episode.seat(shown.player)
        kinds = {"kind": seat.kind, "controller": seat.controller.value}
        return shown.model_copy(update=kinds)
