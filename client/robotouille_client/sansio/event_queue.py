"""Queue of events that a program has not read yet, bounded in number and in bytes."""

from __future__ import annotations

from collections import deque

from robotouille_client.sansio.game_events import GameEvent

MAX_EVENTS = 10_000
MAX_EVENT_BYTES = 32 * 2**20
"""Maximum size of the messages from which the waiting events were made."""


class EventQueue:
    """Events in order. The oldest ones are dropped when there are too many.

    A program may never read its events, and a faulty server may send large texts for ever.
    """

    def __init__(self) -> None:
        self._events: deque[tuple[GameEvent, int]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._events)

    def append(self, event: GameEvent, size: int) -> None:
        """Add an event from a message of a size in bytes."""
        self._events.append((event, size))
        self._bytes += size
        while len(self._events) > MAX_EVENTS or (
            self._bytes > MAX_EVENT_BYTES and len(self._events) > 1
        ):
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
