"""Roles, and the messages that each role may send."""

from __future__ import annotations

from enum import StrEnum

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.join_codes import plain_code


class Role(StrEnum):
    """Roles in descending order of trust. Each role includes the ones after it."""

    OPERATOR = "operator"
    HOST = "host"
    PLAYER = "player"
    SPECTATOR = "spectator"

    def includes(self, other: Role) -> bool:
        """Return whether this role includes another."""
        return _ORDER.index(self) <= _ORDER.index(other)


_ORDER = tuple(Role)

_WATCHING = frozenset({"hello", "join", "leave", "resync", "get_rendering", "get_picture"})
_PLAYING = _WATCHING | {"ready", "act", "say", "signal", "note"}
_HOSTING = _PLAYING | {"list", "create", "close"}
_ALL = frozenset(str(model.model_fields["type"].default) for model in messages.CLIENT_MESSAGES)

PERMISSIONS: dict[Role, frozenset[str]] = {
    Role.OPERATOR: _ALL,
    Role.HOST: _HOSTING,
    Role.PLAYER: _PLAYING,
    Role.SPECTATOR: _WATCHING,
}
"""Types of messages that a role may send."""


def check_permission(role: Role, message: messages.ClientMessage) -> None:
    """Raise ProtocolError `auth/role` if a role may not send a message."""
    again = isinstance(message, messages.Create) and message.rematch is not None
    # A rematch is only for those who had a seat in the game, which the lobby checks.
    if message.type not in PERMISSIONS[role] and not (again and role.includes(Role.PLAYER)):
        least = next(r for r in reversed(_ORDER) if message.type in PERMISSIONS[r])
        text = f"a {role} may not send {message.type!r}; this needs a token with the role {least}"
        raise ProtocolError("auth/role", text, "type")
    if isinstance(message, messages.Join) and not role.includes(Role(message.role)):
        text = f"a {role} may not join as {message.role}; join with role {role!s}"
        raise ProtocolError("auth/role", text, "role")


def check_join(
    message: messages.Join, *, only: str, seat: str, episode: str, code: str
) -> str | None:
    """Return the seat to request with a token that may be limited to an episode or seat.

    Args:
        message: The request.
        only: The id or code of the only episode the token is for, or empty.
        seat: The only seat the token is for, or empty.
        episode: The id of the requested episode.
        code: The code of the requested episode.

    Raises:
        ProtocolError: `auth/episode` or `auth/seat` if the token is not for this request.
    """
    check_scope(only, episode, code)
    if not seat or message.role != "player":
        return message.seat
    if message.seats not in ([], [seat]):
        raise ProtocolError("auth/seat", f"your token is for the seat {seat} only", "seats")
    if message.seat not in (None, seat):
        raise ProtocolError("auth/seat", f"your token is for the seat {seat}", "seat")
    return seat


def check_opening(only: str) -> None:
    """Raise ProtocolError `auth/episode` if a token that is limited to an episode may open none."""
    if only:
        text = "your token is for one episode and cannot open others"
        raise ProtocolError("auth/episode", text, "type")


def check_scope(only: str, episode: str, code: str, field: str = "episode") -> None:
    """Raise ProtocolError `auth/episode` if a token for `only` is used for another episode."""
    if not in_scope(only, episode, code):
        raise ProtocolError("auth/episode", "your token is for another episode", field)


def in_scope(only: str, episode: str, code: str) -> bool:
    """Return whether a token for `only` is valid for an episode; an empty `only` has no limit."""
    return not only or same_episode(only, episode) or same_episode(only, code)


def same_episode(one: str, other: str) -> bool:
    """Return whether two ids or codes are equal, apart from dashes, spaces and case."""
    return plain_code(one) == plain_code(other)
