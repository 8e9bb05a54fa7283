"""Whether and when a request that failed is sent again."""

from __future__ import annotations

import random
from dataclasses import dataclass

from robotouille_evaluation.models.model import ModelError

__all__ = ["RetryPolicy"]


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """At most `attempts` attempts, with pauses that double from `first_delay` to `max_delay`.

    The pauses are drawn at random, so that many episodes do not come back all at once. An endpoint
    that asks for longer than `max_retry_after` is not asked again. All times are in seconds.
    """

    attempts: int = 6
    first_delay: float = 1.0
    max_delay: float = 60.0
    max_retry_after: float = 300.0

    def pause(self, attempt: int, error: ModelError, rng: random.Random) -> float | None:
        """Seconds to wait after an attempt that failed.

        Args:
            attempt: Which it was, from 1.
            error: How it failed.
            rng: Draws the pause.

        Returns:
            At least what the endpoint asked for; None if there is no further attempt.
        """
        asked = error.retry_after or 0.0
        if not error.retry_may_help or attempt >= self.attempts or asked > self.max_retry_after:
            return None
        longest = min(self.max_delay, self.first_delay * 2.0 ** (attempt - 1))
        return max(0.0, asked) + longest * rng.uniform(0.5, 1.0)
