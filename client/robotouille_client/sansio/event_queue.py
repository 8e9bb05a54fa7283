"""Queue of events that a program has not read yet, bounded in bytes."""

from __future__ import annotations

from collections import deque

from robotouille_client.sansio.game_events import (
    ActRejected,
    GameEvent,
    ObservationReceived,
    RosterChanged,
    StateChanged,
)
from robotouille_client.sansio.state_bytes import state_bytes

MAX_EVENT_BYTES = 8 * 2**20
"""Maximum size of the waiting events in memory: about 10,000 steps of a usual game.

`robotouille-mcp` plays 64 games at the same time, whose clients may read nothing for minutes.
"""
EVENT_BYTES = 400
"""Size of an event without a state, in addition to its message."""
SEAT_BYTES = 800
TEXT_BYTES = 60
"""Size of a text in a list, in addition to its characters. In a message it can take one byte."""
REASON_BYTES = 200
"""Size of an unmet condition, in addition to its objects and characters."""


class EventQueue:
    """Events in order. The oldest ones are dropped when they take too much memory.

    A program may never read its events, and a faulty server may send large texts for ever.
    """

    def __init__(self) -> None:
        self._events: deque[tuple[GameEvent, int]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._events)

    def append(self, event: GameEvent, message_size: int) -> None:
        """Add an event from a message of a size in bytes."""
        size = message_size + _size(event)
        self._events.append((event, size))
        self._bytes += size
        while self._bytes > MAX_EVENT_BYTES and len(self._events) > 1:
            self.popleft()

    def popleft(self) -> GameEvent:
        """Remove and return the oldest event."""
        event, size = self._events.popleft()
        self._bytes -= size
        return event

    def take_all(self) -> list[GameEvent]:
        """Remove and return all events."""
        events = [event for event, _ in self._events]
        self._events.clear()
        self._bytes = 0
        return events


def _size(event: GameEvent) -> int:
    if isinstance(event, StateChanged):
        return state_bytes(event.state)
    if isinstance(event, ObservationReceived):
        return EVENT_BYTES + TEXT_BYTES * len(event.actions)
    if isinstance(event, RosterChanged):
        return EVENT_BYTES + SEAT_BYTES * len(event.seats) + TEXT_BYTES * len(event.waits_for)
    if isinstance(event, ActRejected):
        objects = sum(len(unmet.objects) for unmet in event.unmet)
        return EVENT_BYTES + REASON_BYTES * len(event.unmet) + TEXT_BYTES * objects
    return EVENT_BYTES
