"""Whose steps are asked for: what laboratories watch, and for how long."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import dataclass, field

from robotouille.errors import ProtocolError
from robotouille_server.rooms.room import Room

__all__ = ["MAX_WATCHES", "Watched", "Watches"]

MAX_WATCHES = 100
"""At a time, on one server."""


@dataclass(frozen=True, slots=True)
class Watched:
    """What somebody watches: an episode, or all with these labels. `owner`: only those that this
    subject has opened; None: whoever has. `token` is the id of that with which it was asked for:
    a watch ends with it."""

    subject: str
    owner: str | None
    episode: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    token: str = ""

    def matches(self, room: Room) -> bool:
        """Whether a room is one of those."""
        if self.owner is not None and room.owner != self.owner:
            return False
        return self.episode in ("", room.id) and self.labels.items() <= room.labels.items()

    @property
    def key(self) -> tuple[str, str, frozenset[tuple[str, str]]]:
        """What is the same for two watches of which the later replaces the earlier."""
        return self.subject, self.episode, frozenset(self.labels.items())


class Watches:
    """All that is watched; `episodes` are the ids of those of which there are rooms.

    Args:
        rooms: All that there are.
        revoked: The ids of tokens that are worth nothing any more.
    """

    def __init__(self, rooms: Callable[[], Collection[Room]], revoked: Container[str] = ()) -> None:
        self.episodes: set[str] = set()
        self._revoked = revoked
        self._rooms = rooms
        self._watches: dict[object, tuple[Watched, float]] = {}

    def add(self, watched: Watched, until: float) -> None:
        """Watch this, or for longer; ProtocolError `rate/limited` where too much is."""
        if watched.key not in self._watches and len(self._watches) >= MAX_WATCHES:
            message = f"{MAX_WATCHES} watches at a time; end one with unwatch"
            raise ProtocolError("rate/limited", message)
        self._watches[watched.key] = watched, until
        self._look()

    def remove(self, watched: Watched) -> int:
        """End a watch, or all of its subject if it is of everything; how many there were."""
        everything = not watched.episode and not watched.labels
        ended = [
            key
            for key, (each, _) in self._watches.items()
            if key == watched.key or (everything and each.subject == watched.subject)
        ]
        for key in ended:
            del self._watches[key]
        self._look()
        return len(ended)

    def expire(self, now: float) -> None:
        """End what is over."""
        over = [
            key
            for key, (watched, until) in self._watches.items()
            if until <= now or watched.token in self._revoked
        ]
        for key in over:
            del self._watches[key]
        if over:
            self._look()

    def opened(self, room: Room) -> None:
        """There is a new room."""
        if any(watched.matches(room) for watched, _ in self._watches.values()):
            self.episodes.add(room.id)

    def ended(self, room: Room) -> None:
        """There are no more steps of it."""
        self.episodes.discard(room.id)

    def _look(self) -> None:
        watches = [watched for watched, _ in self._watches.values()]
        self.episodes = {
            room.id
            for room in self._rooms()
            if not room.episode.ended and any(watched.matches(room) for watched in watches)
        }
