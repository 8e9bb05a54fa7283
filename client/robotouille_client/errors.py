"""Why a connection cannot be had, or is over.

    RobotouilleError                  of everything, in `robotouille.errors`
    ├── ProtocolError                 the server refuses; `code` says what
    └── ConnectionFailedError         the server cannot be reached, or does not answer
        ├── NotYetError               the server asks us to try again in a moment
        └── StrangerError             the server sends us where our tokens do not go

All are the peer's or the network's fault, never the caller's.
"""

from __future__ import annotations

from robotouille.errors import ProtocolError, RobotouilleError

__all__ = [
    "ConnectionFailedError",
    "NotYetError",
    "ProtocolError",
    "RobotouilleError",
    "StrangerError",
]


class ConnectionFailedError(RobotouilleError):
    """The server cannot be reached, or would not have us."""


class NotYetError(ConnectionFailedError):
    """The server asks us to try again in a moment."""


class StrangerError(ConnectionFailedError):
    """The server sends us to another host, or away from TLS: our tokens do not go there."""
