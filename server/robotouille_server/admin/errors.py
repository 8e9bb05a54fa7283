"""Requests that are not honoured, with their HTTP status and stable code."""

from __future__ import annotations

from http import HTTPStatus

from robotouille.errors import RobotouilleError

__all__ = ["CODES", "RequestRefusedError"]

CODES = {
    "host/unknown": "the Host header is not a name of this port (see `allowed hosts`)",
    "auth/needed": "a token is needed: `Authorization: Bearer …`",
    "auth/forwarded": "the request came through a proxy, and no tokens are checked",
    "auth/episode": "the token is for another episode",
    "request/origin": "another web site asked for it",
    "request/header": "a request that changes something came without `X-Robotouille-Operator`",
    "request/type": "a body is not `application/json`",
    "request/size": "a body has no length, is larger than 16 KiB, or comes in chunks",
    "request/invalid": "a parameter or field is wrong; the message says which",
    "request/unknown": "there is no such path",
    "request/method": "the path does not take this method",
    "episode/unknown": "no episode has this id or code",
    "episode/over": "the episode is over already",
    "session/unknown": "nobody of this name is in the episode",
    "recording/unknown": "there is no recording of this name",
    "recording/unreadable": "the recordings folder or a file in it cannot be read",
    "operator/busy": "too many pages are open at once, or too many with this token",
    "operator/internal": "the operator's view failed; the server's log says how",
}
"""Every code of the API's own, and what it means. A token's check adds its own codes."""


class RequestRefusedError(RobotouilleError):
    """A request is not honoured; `code` is one of CODES or that of a token's check."""

    def __init__(self, status: HTTPStatus, code: str, message: str) -> None:
        self.status = status
        self.code = code
        self.message = message
        super().__init__(f"{code}: {message}")
