"""Limits on the text of participants that is recorded.

Steps take little space, and the step limit bounds their number. Reasoning, chat and rejected
requests have no such bound, so each seat has a quota of bytes for them.
"""

from __future__ import annotations

from collections.abc import Iterable

from robotouille.errors import ProtocolError

SEAT_QUOTA_BYTES = 8 * 1024 * 1024
"""Initial quota of a seat."""
MAX_AUDIENCE_BYTES = 1024 * 1024
"""Quota of all spectators together."""
NEWCOMER_BYTES = 512 * 1024
"""Bytes that a seat's next participant has at least, even if the previous one used up the quota."""
MAX_SEAT_BYTES = 11 * 1024 * 1024
"""Upper limit of a seat's quota, however many participants it had."""
MAX_NOTE = 8000
"""Characters of one note, as of reasoning."""
NOTE_BYTES = 100
"""Bytes that a recorded note takes in addition to its text."""


def size_of_rejection(texts: Iterable[str]) -> int:
    """Return the bytes of a rejected request in a recording, without its reasoning.

    The reasoning is taken from the quota when the request arrives.
    """
    return NOTE_BYTES + sum(len(text.encode()) for text in texts)


def size_of_note(topic: str, text: str) -> int:
    """Return the bytes of a seat's note in a recording."""
    return NOTE_BYTES + len(topic.encode()) + len(text.encode())


# A reader refuses recordings above 256 MiB (`MAX_FILE` in robotouille.replay.container), so text
# without a limit could make a recording unreadable.
class Quota:
    """Number of bytes of text that are still recorded.

    Attributes:
        limit: Bytes in all.
        used: Bytes used.
        reached: True once a text did not fit. Nothing more is recorded until `renew`.
    """

    __slots__ = ("limit", "reached", "used")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.used = 0
        self.reached = False

    def renew(self) -> None:
        """Make room for a new participant."""
        # A participant who fills the quota and leaves must not silence the next one. The upper
        # limit keeps a series of such participants from filling the disk.
        least = min(self.used + NEWCOMER_BYTES, MAX_SEAT_BYTES)
        if least > self.limit:
            self.limit, self.reached = least, False
        # The predecessor's text may have been too long for the rest of the quota, although shorter
        # ones still fit.
        elif self.used < self.limit - NOTE_BYTES:
            self.reached = False

    def half_left(self, size: int) -> bool:
        """Return whether half of the quota would be left after this many bytes."""
        return self.used + size <= self.limit // 2

    def take(self, size: int) -> bool:
        """Take bytes. Return whether they fitted."""
        # Once reached, shorter texts are refused as well, so the `quota` note in the recording
        # marks where the texts end.
        if self.reached or self.used + size > self.limit:
            self.reached = True
            return False
        self.used += size
        return True


def take_or_refuse(quota: Quota, size: int, instead: str) -> None:
    """Take bytes from a quota, or raise ProtocolError `rate/words`.

    Args:
        instead: Advice for the participant.
    """
    if not quota.take(size):
        message = f"the quota of recorded text is used up ({quota.used:,} bytes); {instead}"
        raise ProtocolError("rate/words", message)
