"""Who may do what: four roles, and the one table of what each may send."""

from __future__ import annotations

from enum import StrEnum

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.runtime.workers import plain_code

__all__ = [
    "PERMISSIONS",
    "Role",
    "check_join",
    "check_opening",
    "check_permission",
    "check_scope",
    "same_episode",
]


class Role(StrEnum):
    """From the most to the least trusted; each may do all that those after it may."""

    OPERATOR = "operator"
    HOST = "host"
    PLAYER = "player"
    SPECTATOR = "spectator"

    def includes(self, other: Role) -> bool:
        """Whether whoever has this role may do all that `other` may."""
        return _ORDER.index(self) <= _ORDER.index(other)


_ORDER = tuple(Role)

_WATCHING = frozenset({"hello", "join", "leave", "resync", "get_rendering", "get_picture"})
_PLAYING = _WATCHING | {"ready", "act", "say", "note"}
_HOSTING = _PLAYING | {"list", "create", "close"}
_ALL = frozenset(str(model.model_fields["type"].default) for model in messages.CLIENT_MESSAGES)

PERMISSIONS: dict[Role, frozenset[str]] = {
    Role.OPERATOR: _ALL,
    Role.HOST: _HOSTING,
    Role.PLAYER: _PLAYING,
    Role.SPECTATOR: _WATCHING,
}
"""The types of the messages that a role may send."""


def check_permission(role: Role, message: messages.ClientMessage) -> None:
    """ProtocolError `auth/role` if this role may not send this message."""
    if message.type not in PERMISSIONS[role]:
        least = next(r for r in reversed(_ORDER) if message.type in PERMISSIONS[r])
        text = f"a {role} may not send {message.type!r}; it takes a token with the role {least}"
        raise ProtocolError("auth/role", text, "type")
    if isinstance(message, messages.Join) and not role.includes(Role(message.role)):
        text = f"a {role} may not join as {message.role}; join with role {role!s}"
        raise ProtocolError("auth/role", text, "role")


def check_join(
    message: messages.Join, *, only: str, seat: str, episode: str, code: str
) -> str | None:
    """The seat to ask for, where a token is limited to an episode (`only`) or a `seat`.

    `episode` and `code` are those of the room that `message` names. ProtocolError `auth/episode`
    or `auth/seat` if the token is for another, or asked for more than it is for.
    """
    check_scope(only, episode, code)
    if not seat or message.role != "player":
        return message.seat
    if message.seats not in ([], [seat]):
        raise ProtocolError("auth/seat", f"your token is for the seat {seat} alone", "seats")
    if message.seat not in (None, seat):
        raise ProtocolError("auth/seat", f"your token is for the seat {seat}", "seat")
    return seat


def check_opening(only: str) -> None:
    """ProtocolError `auth/episode` if a token that is limited to the episode `only`, unless that
    is empty, would open one."""
    if only:
        raise ProtocolError("auth/episode", "your token is for one episode and opens none", "type")


def check_scope(only: str, episode: str, code: str, field: str = "episode") -> None:
    """ProtocolError `auth/episode` if a token that is limited to the episode `only`, unless that
    is empty, is used for the one of this id and code."""
    if only and not (same_episode(only, episode) or same_episode(only, code)):
        raise ProtocolError("auth/episode", "your token is for another episode", field)


def same_episode(one: str, other: str) -> bool:
    """Whether two ids or codes are the same; dashes, spaces and case of codes do not matter."""
    return plain_code(one) == plain_code(other)
