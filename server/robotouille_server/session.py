"""A participant, over one or several connections."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from robotouille_server.peer import Peer

if TYPE_CHECKING:
    from robotouille_server.room import Room

__all__ = ["Session"]


class Session:
    """Who somebody is, where they are, and the connection they have at the moment, if any."""

    def __init__(self, session_id: str, token: str, name: str, kind: str) -> None:
        self.id = session_id
        self.token = token
        self.name = name
        self.kind = kind
        self.peer: Peer | None = None
        self.room: Room | None = None
        self.player: str | None = None
        self.view = "state"
        self.known: set[str] = set()
        self.expiry: asyncio.TimerHandle | None = None

    @property
    def wants_state(self) -> bool:
        return self.view in ("state", "both")

    @property
    def wants_text(self) -> bool:
        return self.view in ("text", "both")

    def cancel_expiry(self) -> None:
        if self.expiry is not None:
            self.expiry.cancel()
            self.expiry = None
