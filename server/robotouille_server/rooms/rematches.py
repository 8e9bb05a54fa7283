"""Rematches: ended games that their players can play again, and how often."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Set
from dataclasses import dataclass, replace

from robotouille.episode.rules import NO_TREATMENT
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.join_codes import plain_code
from robotouille_server.rooms.episode_setup import EpisodeSetup
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.budgets import TokenBucket

MAX_FINISHED = 256
"""Ended games that a process remembers."""
MAX_OPEN = 2
"""Open rematches that one participant has requested."""
MAX_OPEN_OF_GAME = 4
"""Open rematches of a game, and of its rematches, that players have requested. People need one.
Each ended game of such a chain has a rematch, so one code would otherwise admit dozens of games at
once."""
REMATCHES_A_MINUTE, REMATCHES_AT_ONCE = 10.0, 40.0
"""Rematches of a game, and of its rematches, that players may request. People need a game each;
bots that play one in a second can play forty."""
ARCHIVED_A_MINUTE, ARCHIVED_AT_ONCE = 60.0, 256.0
"""Rematches of all games together that are read from recordings, after a restart or because this
process has forgotten them. Without a common limit, each old game would have a full budget again."""
RECORDED_BYTES = 100 * 1024
"""Bytes of a rematch's recording that count as one more rematch. This bounds what players can write
to the disk."""
ALONE = {"type", "ref", "rematch"}
"""Fields that a `create` with `rematch` may have."""


@dataclass(frozen=True, slots=True)
class Asker:
    """Participant who requests a rematch.

    Attributes:
        names: The session and the pseudonym.
        host: True if the participant may also open other episodes. Hosts are trusted, so the rate
            of rematches does not apply to them.
    """

    names: frozenset[str]
    host: bool = False

    @property
    def charged_names(self) -> list[str]:
        """The names, unless the rate of rematches does not apply to the participant."""
        return [] if self.host else sorted(self.names)


@dataclass(slots=True)
class Allowance:
    """Rematches that players may still request of a game and of its rematches.

    Attributes:
        bucket: The number of rematches.
        owed: The number that the next request pays for the recordings of ended rematches.
    """

    bucket: TokenBucket
    owed: int = 0

    def charge(self, now: float) -> None:
        """Charge a rematch; raise ProtocolError `rate/episodes` after too many."""
        if seconds := self.bucket.wait(now):
            message = f"this game was played again too often; try again in {math.ceil(seconds)} s"
            raise ProtocolError("rate/episodes", message, "rematch")
        # People may play again at once after a long game: its recording delays later requests.
        self.bucket.owe(now, 1 + self.owed)
        self.owed = 0


@dataclass(slots=True)
class FinishedGame:
    """Ended game that can be played again.

    Attributes:
        episode: The id of the ended episode.
        code: The code of the ended episode.
        setup: The task and rules.
        owner: The pseudonym of the participant who opened the ended episode.
        players: The sessions and pseudonyms of all who had a seat.
        banned: The sessions and pseudonyms of all who were removed, also after the end.
        allowance: The rematches that may still be requested; shared with all rematches of the game.
        chain: The id of the first game in this game's chain of rematches. A game that is read from
            its recording begins a chain.
        next: The id of the rematch, if one was opened. All players share one rematch.
    """

    episode: str
    code: str
    setup: EpisodeSetup
    owner: str
    players: frozenset[str]
    banned: Set[str]
    allowance: Allowance
    chain: str
    next: str = ""

    @classmethod
    def of(cls, room: Room, allowance: Allowance, chain: str) -> FinishedGame:
        """Return the game of a room."""
        seats = room.episode.seats.values()
        setup = EpisodeSetup(
            room.world.task,
            # A rematch begins when its players have joined; it is not a reservation.
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
            frozenset(room.membership.ever_seated - {""}),
            room.episode.record.banned,
            allowance,
            chain,
        )

    def setup_for(self, owner: str, asker: Asker) -> EpisodeSetup:
        """Return the setup of a rematch; only the first owner's rematches keep the labels."""
        # A host without a token and a player without one have the same owner: none.
        own = asker.host and owner == self.owner
        return self.setup if own else replace(self.setup, labels={})

    def check(self, asker: Asker) -> None:
        """Check that a participant may play again.

        Raises:
            ProtocolError: `auth/episode` if the participant had no seat, `episode/banned` if it was
                removed.
        """
        # The ban is checked first, because a removed player also had a seat.
        if not self.banned.isdisjoint(asker.names):
            message = "you were removed from this episode and cannot play it again"
            raise ProtocolError("episode/banned", message, "rematch")
        if self.players.isdisjoint(asker.names):
            # The code stays secret: the participant may know only the id.
            message = "you had no seat in this episode; only its players can play it again"
            raise ProtocolError("auth/episode", message, "rematch")


@dataclass(frozen=True, slots=True)
class _OpenRematch:
    asker: Asker
    allowance: Allowance
    chain: str


class Rematches:
    """Ended games of a process, by id and code, and their open rematches."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._games: OrderedDict[str, FinishedGame] = OrderedDict()
        self._codes: dict[str, FinishedGame] = {}
        self._open: dict[Room, _OpenRematch] = {}
        self._archived = self._allowance(ARCHIVED_A_MINUTE, ARCHIVED_AT_ONCE)

    def add(self, room: Room, *, archived: bool = False) -> None:
        """Remember an ended game, unless nobody had a seat in it.

        Args:
            room: The room of the game.
            archived: True if the game is read from its recording after its end.
        """
        before = self._open.pop(room, None)
        chain = room.id if before is None else before.chain
        if before is not None:
            allowance = before.allowance
            if not before.asker.host and room.journal is not None:
                allowance.owed += room.journal.size // RECORDED_BYTES
        elif archived:
            allowance = self._archived
        else:
            allowance = self._allowance(REMATCHES_A_MINUTE, REMATCHES_AT_ONCE)
        game = FinishedGame.of(room, allowance, chain)
        # An archived episode that is shown again must not replace its game, which may have a
        # rematch.
        if not game.players or game.episode in self._games:
            return
        # The number of games is bounded, because each keeps its task and the ids of its players.
        while len(self._games) >= MAX_FINISHED:
            _, oldest = self._games.popitem(last=False)
            self._codes.pop(plain_code(oldest.code), None)
        self._games[game.episode] = self._codes[plain_code(game.code)] = game

    def _allowance(self, a_minute: float, at_once: float) -> Allowance:
        return Allowance(TokenBucket(a_minute / 60, self._now(), at_once))

    def find(self, name: str) -> FinishedGame | None:
        """Return the game with an id or code."""
        return self._games.get(name) or self._codes.get(plain_code(name))

    def charge(self, game: FinishedGame, asker: Asker) -> None:
        """Charge a participant for a rematch that it is about to open.

        Raises:
            ProtocolError: `rate/episodes` after too many rematches, or while too many are open.
        """
        # Players are not trusted as hosts are. Without limits, one player could fill the server.
        opened = (not one.asker.names.isdisjoint(asker.names) for one in self._open.values())
        if sum(opened) >= MAX_OPEN:
            message = f"{MAX_OPEN} of your rematches are open already; play or end one first"
            raise ProtocolError("rate/episodes", message, "rematch")
        if asker.host:
            return
        alike = (one.chain == game.chain and not one.asker.host for one in self._open.values())
        if sum(alike) >= MAX_OPEN_OF_GAME:
            message = f"{MAX_OPEN_OF_GAME} rematches of this game are open already; join or end one"
            raise ProtocolError("rate/episodes", message, "rematch")
        game.allowance.charge(self._now())

    def opened(self, game: FinishedGame, room: Room, asker: Asker) -> None:
        """Note the room of a game's rematch."""
        game.next = room.id
        self._open[room] = _OpenRematch(asker, game.allowance, game.chain)

    def continued(self, room: Room, names: Iterable[str]) -> None:
        """Note a rematch that began in another process, with the names of who requested it.

        That process knows which game it continues. Here it counts as one that is read from a
        recording, so that its own recording is charged.
        """
        self._open[room] = _OpenRematch(Asker(frozenset(names)), self._archived, room.id)

    def drop(self, room: Room) -> None:
        """Forget a rematch that continues in another process."""
        self._open.pop(room, None)


def check_alone(request: messages.Create) -> None:
    """Raise ProtocolError if a rematch requests other options than the ended game had."""
    said = request.model_dump(exclude_defaults=True).keys() - ALONE
    if said:
        message = "a rematch keeps the task and rules: leave this field out"
        raise ProtocolError("message/invalid-field", message, min(said))
