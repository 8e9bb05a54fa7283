"""How much of what participants write is recorded: free text, which could grow without end.

A step takes little of a recording, and the step limit ends them. Reasoning, chat and rejected
actions come as often as somebody sends them.
"""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.errors import ProtocolError

__all__ = [
    "MAX_AUDIENCE_BYTES",
    "MAX_NOTE",
    "MAX_SEAT_BYTES",
    "NEWCOMER_BYTES",
    "NOTE_BYTES",
    "SEAT_QUOTA_BYTES",
    "Quota",
    "size_of_note",
    "size_of_rejection",
    "take_or_refuse",
]

SEAT_QUOTA_BYTES = 8 * 1024 * 1024
"""Of what is written in the name of one seat in an episode."""
MAX_AUDIENCE_BYTES = 1024 * 1024
"""Of all that spectators say in an episode."""
NEWCOMER_BYTES = 512 * 1024
"""That somebody who takes a seat may write at least, whatever was written there before…"""
MAX_SEAT_BYTES = 11 * 1024 * 1024
"""… up to this, of all who have had the seat."""
MAX_NOTE = 8000
"""Characters of one note that a seat makes, as many as of reasoning."""
NOTE_BYTES = 100
"""What a note takes beside its text."""


def size_of_rejection(texts: Iterable[str]) -> int:
    """Bytes of a rejected action in a recording: what it asked for, and the reasons; its reasoning
    was taken off before."""
    return NOTE_BYTES + sum(len(text.encode()) for text in texts)


def size_of_note(topic: str, text: str) -> int:
    """Bytes of a seat's note in a recording."""
    return NOTE_BYTES + len(topic.encode()) + len(text.encode())


class Quota:
    """The bytes of somebody's text that are recorded: `used` of `limit`.

    `reached` says whether something did not fit any more.
    """

    __slots__ = ("limit", "reached", "used")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.used = 0
        self.reached = False

    def renew(self) -> None:
        """Somebody else begins to write."""
        least = min(self.used + NEWCOMER_BYTES, MAX_SEAT_BYTES)
        if least > self.limit:
            self.limit, self.reached = least, False
        elif self.used < self.limit - NOTE_BYTES:
            self.reached = False

    def half_left(self, size: int) -> bool:
        """Whether so much more would leave half of it to others."""
        return self.used + size <= self.limit // 2

    def take(self, size: int) -> bool:
        """Whether so much more is recorded."""
        if self.reached or self.used + size > self.limit:
            self.reached = True
            return False
        self.used += size
        return True


def take_or_refuse(quota: Quota, size: int, instead: str) -> None:
    """ProtocolError `rate/words` where a text cannot be recorded any more; `instead` says what one
    can do then."""
    if not quota.take(size):
        message = (
            f"no more of what is written here is recorded ({quota.used:,} bytes are); {instead}"
        )
        raise ProtocolError("rate/words", message)
