"""A participant, over one or several connections."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotouille_server.access import Visitor
from robotouille_server.peer import Peer
from robotouille_server.roles import Role

if TYPE_CHECKING:
    from robotouille_server.room import Room

__all__ = ["Session"]


class Session:
    """Who somebody is, where they are, and the connection they have at the moment, if any.

    `participant` is the pseudonym under which they are recorded, `generation` that of the resume
    token which was used last; `only_episode` and `only_seat` are what their role token is
    limited to, `role_expires` until when it is good (0: for ever). `earlier_bytes` came over
    connections that are over, `recorded_bytes` are what it said and gave as reasons on record.
    """

    __slots__ = (
        "_view",
        "away_since",
        "earlier_bytes",
        "generation",
        "id",
        "kind",
        "known",
        "name",
        "only_episode",
        "only_seat",
        "participant",
        "peer",
        "player",
        "recorded_bytes",
        "role",
        "role_expires",
        "room",
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
    ) -> None:
        self.id = session_id
        self.name = name
        self.kind = kind
        self.role = role
        self.participant = participant or session_id
        self.only_episode = only_episode
        self.only_seat = only_seat
        self.role_expires = role_expires
        self.generation = 0
        self.visitor: Visitor | None = None
        self.peer: Peer | None = None
        self.room: Room | None = None
        self.player: str | None = None
        self.view = "state"
        self.known: set[str] = set()
        self.away_since = 0.0
        self.earlier_bytes = self.recorded_bytes = 0

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
