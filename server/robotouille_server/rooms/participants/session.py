"""Session: one participant's presence on the server, over one or more connections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from robotouille.certification.stars import StarLimits
from robotouille.episode import Departure, Seat
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.auth import CountedConnection, Role, Visitor
from robotouille_server.rooms.recording.write_ahead import Readable
from robotouille_server.transport import Peer


class JoinedRoom(Protocol):
    """Part of a room that its sessions use; see `Room`.

    The protocol is here, and not in `rooms.room`, because rooms depend on sessions.
    """

    id: str
    code: str

    @property
    def mirrored(self) -> bool:
        """True if another node has the episode, so that nobody can play here."""

    def enter(self, session: Session, request: messages.Join, max_spectators: int) -> None: ...

    @property
    def spectators_here(self) -> int:
        """Number of spectators who are connected to this process."""

    @property
    def task(self) -> str:
        """Name of the task."""

    def find_star_limits(self) -> StarLimits | None:
        """Return the largest numbers of steps for stars.

        The result is None without a known plan, and in a mirror. The first call for a task may take
        0.2 s. Other threads may call this method.
        """

    @property
    def step(self) -> int: ...

    @property
    def limits_sight(self) -> bool:
        """True if players see a part of the kitchen."""

    @property
    def in_progress(self) -> bool: ...

    @property
    def ended(self) -> bool: ...

    @property
    def grace(self) -> float: ...

    def seat(self, player: str) -> Seat: ...

    @property
    def writing(self) -> bool: ...

    def hold(self, connection: Readable) -> None: ...

    def set_ready(self, session: Session, ready: bool) -> None: ...

    def leave(self, session: Session, why: Departure = ...) -> None: ...

    def act(self, session: Session, request: messages.Act) -> None: ...

    def refuse(self, session: Session, request: messages.Act, why: ProtocolError) -> None: ...

    def record_unreadable(
        self, session: Session, message: bytes | str, why: ProtocolError
    ) -> None: ...

    def say(self, session: Session, text: str) -> None: ...

    def signal(self, session: Session, request: messages.Signal) -> None: ...

    def note(self, session: Session, request: messages.Note) -> None: ...

    def ask_snapshot(self, session: Session) -> None: ...

    def connection_lost(self, session: Session) -> None: ...

    def check_return(self, session_id: str) -> None: ...

    def connection_back(self, session: Session, seen: messages.Seen | None) -> None: ...

    def readmit(self, session: Session, players: tuple[str, ...]) -> None: ...

    def players_of(self, session_id: str) -> tuple[str, ...]: ...

    def bans(self, session_id: str, participant: str) -> bool: ...


@dataclass(frozen=True, slots=True)
class SessionLimits:
    """Limits that a role token puts on a session.

    Attributes:
        only_episode: The id or code of the only episode the session may join, or empty.
        only_seat: The only seat that the session may take, or empty.
        role_expires: The end of the token in seconds since 1970, or 0 without a token.
        token_id: The id of the token, or empty.
        once: True if the token is good for one session only.
    """

    only_episode: str = ""
    only_seat: str = ""
    role_expires: float = 0.0
    token_id: str = ""
    once: bool = False


NO_LIMITS = SessionLimits()


class Session:
    """A participant, its room and its current connection.

    Attributes:
        id: The id of the session.
        given_name: The name from `hello` or the role token.
        name: The name that others see: `given_name`, with a number if another participant of the
            episode has that name.
        participant: The pseudonym under which the participant is recorded.
        generation: The generation of the resume token that was used last.
        players: The players of the participant's seats, in order; empty for a spectator.
        known: The digests of the tasks that the client has.
        counted_connection: The connection as rate limits count it.
        earlier_bytes: The bytes received over earlier connections.
        recorded_bytes: The bytes of chat and reasoning in the recording.
        mistakes: The actions of its latest messages that do not exist.
        latency_ms: The latency that others see.
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
        "limits",
        "mistakes",
        "name",
        "participant",
        "peer",
        "players",
        "recorded_bytes",
        "role",
        "room",
        "visitor",
        "wants_state",
        # Slots: a server has thousands of sessions (docs/decisions/0019).
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
        limits: SessionLimits = NO_LIMITS,
    ) -> None:
        self.id = session_id
        self.name = self.given_name = name
        self.kind = kind
        self.role = role
        self.participant = participant or session_id
        self.limits = limits
        self.counted_connection: CountedConnection | None = None
        self.generation = 0
        self.visitor: Visitor | None = None
        self.peer: Peer | None = None
        self.room: JoinedRoom | None = None
        self.players: tuple[str, ...] = ()
        self.view = "state"
        # Snapshots leave out tasks that the client has; a task is the longest part of a snapshot.
        self.known: set[str] = set()
        self.away_since = 0.0
        self.earlier_bytes = self.recorded_bytes = 0
        self.latency_ms = self.mistakes = 0

    @property
    def token_id(self) -> str:
        """Id of the role token, or empty."""
        return self.limits.token_id

    def disconnected(self) -> None:
        """Forget the connection, which is gone."""
        self.counted_connection = None
        if self.peer is not None:
            # `health` compares the traffic of participants over all their connections.
            self.earlier_bytes += self.peer.received_bytes
        self.peer = None
        self.latency_ms = 0

    @property
    def player(self) -> str | None:
        """Player of the first seat; None for a spectator."""
        return self.players[0] if self.players else None

    def own_seat(self, seat: str | None) -> str:
        """Return the seat that a message is about: the first one if it names none.

        Raises:
            ProtocolError: `seat/none` for a spectator, `seat/unknown` for another participant's
                seat.
        """
        player = self.player if seat is None else seat
        if not self.players or player is None:
            raise ProtocolError("seat/none", "spectators cannot do this; only players can", "type")
        if player not in self.players:
            message = f"{player} is not yours; you play {' and '.join(self.players)}"
            raise ProtocolError("seat/unknown", message, "seat")
        return player

    def seat_shown(self, seat: str | None) -> str:
        """Return the seat to name in an answer; empty for participants with one seat."""
        return (seat or self.players[0]) if self.has_several else ""

    @property
    def has_several(self) -> bool:
        """True if the participant has several seats."""
        return len(self.players) > 1

    @property
    def views(self) -> tuple[str | None, ...]:
        """Players whose text views the session receives; None is a spectator's view."""
        return self.players or (None,)

    @property
    def received_bytes(self) -> int:
        """Bytes of messages received over all connections."""
        return self.earlier_bytes + (self.peer.received_bytes if self.peer is not None else 0)

    @property
    def view(self) -> str:
        """Form in which the client receives the game: `state`, `text` or `both`."""
        return self._view

    @view.setter
    def view(self, view: str) -> None:
        self._view = view
        # These flags are stored, because they are read for every session in every step.
        self.wants_state = view in ("state", "both")
        self.wants_text = view in ("text", "both")
