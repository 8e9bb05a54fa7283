"""A participant, over one or several connections."""

from __future__ import annotations

from typing import Protocol

from robotouille.episode import Episode
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.auth import CountedConnection, Role, Visitor
from robotouille_server.transport import Peer

__all__ = ["JoinedRoom", "Session"]


class JoinedRoom(Protocol):
    """The room that a session is in, as its connection uses it: see `Room`."""

    id: str
    code: str
    episode: Episode

    @property
    def spectators(self) -> int: ...

    def bans(self, session_id: str, participant: str) -> bool: ...

    def connection_lost(self, session: Session) -> None: ...

    def connection_back(self, session: Session, seen: messages.Seen | None) -> None: ...

    def set_ready(self, session: Session, ready: bool) -> None: ...

    def leave(self, session: Session) -> None: ...

    def act(self, session: Session, request: messages.Act) -> None: ...

    def refuse(self, session: Session, request: messages.Act, why: ProtocolError) -> None: ...

    def record_unreadable(
        self, session: Session, message: bytes | str, why: ProtocolError
    ) -> None: ...

    def say(self, session: Session, text: str) -> None: ...

    def note(self, session: Session, request: messages.Note) -> None: ...

    def ask_snapshot(self, session: Session) -> None: ...


class Session:
    """Who somebody is, where they are, and the connection they have at the moment, if any.

    `name` is what others see: `given_name`, as the participant or the role token has said it, with
    a number in an episode where somebody else has that. `participant` is the pseudonym under which
    they are recorded, `generation` that of the resume token which was used last; `only_episode` and
    `only_seat` are what their role token is limited to, `role_expires` until when it is good (0:
    for ever), `token_id` its id, and `once` says that nobody else may join with it.
    `players` are those that they play, in seat order; none for a spectator.
    `counted_connection` is the connection as limits count it; `earlier_bytes` came over those
    before it, `recorded_bytes` are what it said and gave as reasons on record. `latency_ms` is what
    others are told of its connection.
    """

    __slots__ = (
        "_view",
        "away_since",
        "counted_connection",
        "earlier_bytes",
        "generation",
        "given_name",
        "id",
        "kind",
        "known",
        "latency_ms",
        "name",
        "once",
        "only_episode",
        "only_seat",
        "participant",
        "peer",
        "players",
        "recorded_bytes",
        "role",
        "role_expires",
        "room",
        "token_id",
        "visitor",
        "wants_state",
        "wants_text",
    )

    def __init__(
        self,
        session_id: str,
        *,
        name: str,
        kind: str,
        role: Role,
        participant: str = "",
        only_episode: str = "",
        only_seat: str = "",
        role_expires: float = 0.0,
        token_id: str = "",
        once: bool = False,
    ) -> None:
        self.id = session_id
        self.name = self.given_name = name
        self.kind = kind
        self.role = role
        self.participant = participant or session_id
        self.only_episode = only_episode
        self.only_seat = only_seat
        self.role_expires = role_expires
        self.token_id = token_id
        self.once = once
        self.counted_connection: CountedConnection | None = None
        self.generation = 0
        self.visitor: Visitor | None = None
        self.peer: Peer | None = None
        self.room: JoinedRoom | None = None
        self.players: tuple[str, ...] = ()
        self.view = "state"
        self.known: set[str] = set()
        self.away_since = 0.0
        self.earlier_bytes = self.recorded_bytes = 0
        self.latency_ms = 0

    def disconnected(self) -> None:
        """The connection is gone; who comes back has another."""
        self.counted_connection = None
        if self.peer is not None:
            self.earlier_bytes += self.peer.received_bytes
        self.peer = None
        self.latency_ms = 0

    @property
    def player(self) -> str | None:
        """The first of their players; None for a spectator."""
        return self.players[0] if self.players else None

    def own_seat(self, seat: str | None) -> str:
        """The one of their players that a message is about: the first if it says none.

        ProtocolError `seat/none` for a spectator, `seat/unknown` if it is not theirs.
        """
        player = self.player if seat is None else seat
        if not self.players or player is None:
            raise ProtocolError("seat/none", "you watch; only players do that", "type")
        if player not in self.players:
            message = f"{player} is not yours: you play {' and '.join(self.players)}"
            raise ProtocolError("seat/unknown", message, "seat")
        return player

    def seat_shown(self, seat: str | None) -> str:
        """The seat that an answer names: only whoever has several is told which."""
        return (seat or self.players[0]) if self.has_several else ""

    @property
    def has_several(self) -> bool:
        """Whether they play several seats."""
        return len(self.players) > 1

    @property
    def views(self) -> tuple[str | None, ...]:
        """The players in whose words the game is told to them; None: in a spectator's."""
        return self.players or (None,)

    @property
    def received_bytes(self) -> int:
        """What came over all connections, as messages."""
        return self.earlier_bytes + (self.peer.received_bytes if self.peer is not None else 0)

    @property
    def view(self) -> str:
        """How the session wants to see the game: `state`, `text` or `both`."""
        return self._view

    @view.setter
    def view(self, view: str) -> None:
        self._view = view
        self.wants_state = view in ("state", "both")
        self.wants_text = view in ("text", "both")
