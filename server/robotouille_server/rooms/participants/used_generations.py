"""Resume tokens of forgotten sessions that a later token has replaced."""

from __future__ import annotations

from typing import NamedTuple

from robotouille_server.auth import ResumeGrant

MAX_FORGOTTEN = 10_000
"""Number of forgotten sessions whose last generations are kept: about 2 MB."""


class _Last(NamedTuple):
    """Last used generation of a session, and the expiry of the last token it can have got."""

    generation: int
    expires: float


class UsedGenerations:
    """Last used generations of the resume tokens of forgotten sessions.

    Without them, a replaced token of a spectator would be valid again once the server has forgotten
    the session: spectators are not recorded (docs/decisions/0014).
    """

    __slots__ = ("_floor", "_last")

    def __init__(self) -> None:
        self._last: dict[str, _Last] = {}
        self._floor = 0.0

    def keep(self, session: str, generation: int, expires: float) -> None:
        """Keep the generation of a session that is forgotten now.

        Args:
            session: The id of the session.
            generation: The generation of the resume token that was used last.
            expires: The expiry of a resume token that is made now.
        """
        # Only used tokens replace earlier ones, so clients that never return need no memory.
        if generation == 0:
            return
        self._last.pop(session, None)
        self._last[session] = _Last(generation, expires)
        if len(self._last) > MAX_FORGOTTEN:
            oldest = self._last.pop(next(iter(self._last)))
            self._floor = max(self._floor, oldest.expires)

    def replaced(self, grant: ResumeGrant) -> bool:
        """Return whether a later token may have replaced a forgotten session's token."""
        last = self._last.get(grant.session)
        if last is not None:
            return grant.generation < last.generation
        # The session may be one whose generation is no longer kept. All its tokens are this old.
        return grant.expires <= self._floor
