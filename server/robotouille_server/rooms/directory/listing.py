"""Rooms as the lobby lists them, who is told what of them, and codes that were closed unused."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.workers import plain_code

__all__ = ["MAX_CODES", "MAX_LISTED", "UnusedCode", "UnusedCodes", "info", "labels_for"]

MAX_LISTED = 500
"""Episodes in an answer to `list`."""
MAX_CODES = 10_000
"""Closed unused, of which a process remembers why."""


def labels_for(room: Room, owner: str, *, operator: bool) -> Mapping[str, str]:
    """The labels of a room that somebody may see: a condition among them would tell players what
    they must not know. `owner` is the pseudonym of who asks."""
    return room.labels if operator or room.owner == owner else {}


def info(room: Room, labels: Mapping[str, str]) -> messages.EpisodeInfo:
    """A room as the lobby lists it."""
    episode = room.episode
    rules, outcome = episode.rules, episode.outcome
    return messages.EpisodeInfo(
        episode=room.id,
        code=room.code,
        task=room.world.task.name,
        clock=rules.clock.value,
        phase=room.episode.phase,
        step=episode.step,
        max_steps=rules.max_steps,
        seats=room.broadcaster.seats(),
        spectators=room.spectators,
        labels=dict(labels),
        created=room.created if labels or room.reserved else "",
        closes=room.closes_in if outcome is None else None,
        reason=outcome.reason.value if outcome else "",
        detail=outcome.detail if outcome else "",
    )


@dataclass(frozen=True, slots=True)
class UnusedCode:
    """A code that nobody has used, as its episode was listed at last."""

    info: messages.EpisodeInfo
    owner: str


class UnusedCodes:
    """The last of a process's codes that were closed unused; the oldest are forgotten."""

    def __init__(self) -> None:
        self._codes: OrderedDict[str, UnusedCode] = OrderedDict()

    def __iter__(self) -> Iterator[UnusedCode]:
        return iter(self._codes.values())

    def add(self, unused: UnusedCode) -> None:
        """One more."""
        while len(self._codes) >= MAX_CODES:
            self._codes.popitem(last=False)
        self._codes[plain_code(unused.info.code)] = unused

    def check(self, name: str) -> None:
        """ProtocolError `episode/over` if this is one of them."""
        unused = self._codes.get(plain_code(name))
        if unused is not None:
            why = unused.info.detail or "it was closed"
            message = f"the episode {unused.info.code} is over before it began: {why}"
            raise ProtocolError("episode/over", message, "episode")
