"""Games that are over and may be played again: by whom, and in which room."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection
from dataclasses import dataclass, replace

from robotouille.episode.rules import NO_TREATMENT
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.rooms.directory.episode_setup import EpisodeSetup
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.workers import plain_code

__all__ = ["MAX_FINISHED", "FinishedGame", "Rematches", "check_alone"]

MAX_FINISHED = 256
"""Games of a process that can be played again; the oldest are forgotten."""
ALONE = {"type", "ref", "rematch"}
"""What may be said in a `create` with `rematch`."""


@dataclass(slots=True)
class FinishedGame:
    """What makes the same game again; `again` is the episode that all get who ask, once somebody
    has.

    `players` are the pseudonyms of all who had a seat: sessions and participants; `banned` those of
    who was sent out.
    """

    episode: str
    code: str
    setup: EpisodeSetup
    owner: str
    players: frozenset[str]
    banned: frozenset[str]
    again: str = ""

    @classmethod
    def of(cls, room: Room) -> FinishedGame:
        """That of a room."""
        seats = room.episode.seats.values()
        setup = EpisodeSetup(
            room.world.task,
            room.episode.rules.model_copy(update={"open_for": None}),
            room.seed,
            room.labels,
            {seat.player: seat.treatment for seat in seats if seat.treatment != NO_TREATMENT},
        )
        return cls(
            room.id,
            room.code,
            setup,
            room.owner,
            frozenset(room.players - {""}),
            frozenset(room.episode.banned),
        )

    def setup_for(self, owner: str) -> EpisodeSetup:
        """The same again; its labels are for who has opened the first."""
        return self.setup if owner == self.owner else replace(self.setup, labels={})

    def check(self, asker: Collection[str]) -> None:
        """ProtocolError `auth/episode` unless one of these pseudonyms had a seat, `episode/banned`
        if one of them was sent out."""
        if not self.banned.isdisjoint(asker):
            message = "you were sent out of this episode, and cannot play it again"
            raise ProtocolError("episode/banned", message, "rematch")
        if self.players.isdisjoint(asker):
            message = f"you had no seat in {self.code}; those who had can play it again"
            raise ProtocolError("auth/episode", message, "rematch")


class Rematches:
    """The games of a process that ended, by id and code."""

    def __init__(self) -> None:
        self._games: OrderedDict[str, FinishedGame] = OrderedDict()
        self._codes: dict[str, FinishedGame] = {}

    def add(self, room: Room) -> None:
        """A game is over; one that nobody had a seat in is not kept."""
        game = FinishedGame.of(room)
        if not game.players or game.episode in self._games:
            return
        while len(self._games) >= MAX_FINISHED:
            _, oldest = self._games.popitem(last=False)
            self._codes.pop(plain_code(oldest.code), None)
        self._games[game.episode] = self._codes[plain_code(game.code)] = game

    def find(self, name: str) -> FinishedGame | None:
        """The game of an id or code."""
        return self._games.get(name) or self._codes.get(plain_code(name))


def check_alone(request: messages.Create) -> None:
    """ProtocolError `message/invalid-field` if more is asked for than the same again."""
    said = request.model_dump(exclude_defaults=True).keys() - ALONE
    if said:
        message = "the same game again has the same task and rules: leave this out"
        raise ProtocolError("message/invalid-field", message, min(said))
