"""Rooms as the lobby lists them, and who is told what of them."""

from __future__ import annotations

from collections.abc import Mapping

from robotouille.protocol import messages
from robotouille_server.rooms.room import Room

__all__ = ["MAX_LISTED", "info", "labels_for"]

MAX_LISTED = 500
"""Episodes in an answer to `list`."""


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
        phase=room.broadcaster.phase,
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
