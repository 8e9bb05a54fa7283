"""Limits: the bucket that meters messages, and the table of all limits for the documentation."""

from __future__ import annotations

__all__ = ["TokenBucket"]


class TokenBucket:
    """How much of something may still be had: a bucket that refills with time.

    It holds `burst` at most (twice the rate if left out) and gains `per_second`; with what is owed
    it may hold less than nothing.
    """

    __slots__ = ("_at", "_burst", "_left", "_rate")

    def __init__(self, per_second: float, now: float, burst: float | None = None) -> None:
        self._rate = per_second
        self._burst = 2 * per_second if burst is None else burst
        self._left = self._burst
        self._at = now

    def left(self, now: float) -> float:
        """What could be taken now."""
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        return self._left

    def take(self, now: float, cost: float = 1) -> bool:
        """Take `cost`, if there is so much."""
        if self.left(now) < cost:
            return False
        self._left -= cost
        return True

    def owe(self, now: float, cost: float) -> None:
        """Take `cost`, whether there is so much or not."""
        if cost > 0:
            self._left = self.left(now) - cost
