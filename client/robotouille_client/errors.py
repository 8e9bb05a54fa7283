"""Errors of the client library.

    RobotouilleError                      base class, in `robotouille.errors`
    ├── ProtocolError                     the server refuses; `code` says what
    └── ConnectionFailedError             the server cannot be reached or does not answer
        ├── RetryLaterError               the server asks to try again later
        └── UntrustedRedirectError        the server redirects to where tokens are not sent

All of them are caused by the server or the network, never by the caller.
"""

from __future__ import annotations

from robotouille.errors import ProtocolError, RobotouilleError

__all__ = [
    "ConnectionFailedError",
    "ProtocolError",
    "RetryLaterError",
    "RobotouilleError",
    "UntrustedRedirectError",
]


class ConnectionFailedError(RobotouilleError):
    """The server cannot be reached, does not answer, or refuses the connection."""


class RetryLaterError(ConnectionFailedError):
    """The server asks to try again later."""


class UntrustedRedirectError(ConnectionFailedError):
    """The server redirects to another host or away from TLS, where tokens are not sent."""
