"""Rules for joining games whose players see a part of the kitchen (docs/decisions/0056)."""

from __future__ import annotations

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.auth import Role

_PARTIAL = "players of this game see a part of the kitchen"
NOT_WATCHED = f"{_PARTIAL}, so only people with a link or token for spectators can watch it"
"""Reason for refusing a spectator."""


def may_watch(role: Role) -> bool:
    """Return whether a participant may see all of the kitchen as a spectator."""
    return role is not Role.PLAYER


def check_limited_sight(role: Role, request: messages.Join) -> None:
    """Check a request to join such a game.

    Raises:
        ProtocolError: `seat/partial` if the client would take a part of the kitchen for all of it;
            `auth/role` for a player who would see all of it as a spectator.
    """
    if request.role == "spectator":
        if not may_watch(role):
            raise ProtocolError("auth/role", NOT_WATCHED, "role")
    elif request.view != "text" and not request.partial:
        message = (
            f"{_PARTIAL}, and this program needs all of it; "
            "language models play it, and programs that join with partial"
        )
        raise ProtocolError("seat/partial", message, "partial")
