"""Why a connection cannot be had, or leads elsewhere."""

from __future__ import annotations

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages

__all__ = ["ConnectionFailedError", "MovedError", "NotYetError", "StrangerError"]


class ConnectionFailedError(RobotouilleError):
    """The server cannot be reached, or would not have us."""


class StrangerError(ConnectionFailedError):
    """The server sends us to another host, or away from TLS: our tokens do not go there."""


class NotYetError(ConnectionFailedError):
    """The server asks us to try again in a moment."""


class MovedError(RobotouilleError):
    """What we want is with another process of the server."""

    def __init__(self, moved: messages.Moved) -> None:
        self.moved = moved
        super().__init__(f"{moved.episode} is on port {moved.port}")
