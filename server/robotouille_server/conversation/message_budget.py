"""What one connection may send: how much a message costs, and what happens beyond that."""

from __future__ import annotations

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.runtime.token_bucket import TokenBucket

__all__ = ["COSTS", "MAX_HELLO_BYTES", "MAX_REFUSED", "PACED", "FloodError", "MessageBudget"]

COSTS: dict[type[messages.Message], float] = {
    messages.Create: 10,
    messages.Close: 2,
    messages.Join: 5,
    messages.Resync: 5,
    messages.ListEpisodes: 3,
    messages.GetRendering: 3,
    messages.GetPicture: 2,
}
"""What a message takes of a connection's budget, where that is not one. Each KiB of it, and of
the snapshots and lists that it is answered with, is one more. After each of these everybody else
has a turn; of resyncs all those of a turn are answered together."""
PACED = (messages.Create, messages.Close)
"""What hosts send by the hundred, for a study. It costs a connection no more than any other
message, and is never refused for its number: what is beyond the limit is read later."""
KIB = 1024
MAX_HELLO_BYTES = 8 * KIB
"""Of a message before `hello` is answered: that is the longest anybody needs."""
MAX_REFUSED = 200
"""Messages over the limit, in about a minute, after which a connection is closed."""


class FloodError(Exception):
    """A connection has sent far more than it may."""


class MessageBudget:
    """The messages that a connection may send a second, and those that are refused, by size."""

    __slots__ = ("_bucket", "_per_second", "_refusals")

    def __init__(self, per_second: float, now: float) -> None:
        self._per_second = per_second
        self._bucket = TokenBucket(per_second, now)
        self._refusals = TokenBucket(MAX_REFUSED / 60, now, MAX_REFUSED)

    @property
    def exceeded(self) -> str:
        """What somebody is told who has sent too many."""
        return f"more than {self._per_second:g} messages a second"

    def charge(self, now: float, size: int, answered: int, *, greeted: bool) -> bool:
        """Take a message off the budget, and what the last one was answered with; whether there
        was so much. One that is refused is not free either: it was read, and is answered.

        ProtocolError for one that is not worth reading; FloodError if that was one too many.

        Args:
            size: Of the message, in bytes.
            answered: Bytes with which earlier ones were answered since the last charge.
            greeted: Whether `hello` is answered.
        """
        if not greeted and size > MAX_HELLO_BYTES:
            self._refuse(now, size)
            message = f"{size:,} bytes; at most {MAX_HELLO_BYTES:,} are read before hello"
            raise ProtocolError("message/too-large", message)
        self._bucket.owe(now, answered / KIB)
        if self._bucket.take(now, 1 + size / KIB):
            return True
        self._refuse(now, size)
        if size > MAX_HELLO_BYTES:
            raise ProtocolError("rate/limited", self.exceeded)  # Not worth looking for its `ref`.
        return False

    def _refuse(self, now: float, size: int) -> None:
        """One more message that is refused; a long one counts for more."""
        if not self._refusals.take(now, 1 + size / MAX_HELLO_BYTES):
            raise FloodError

    def take(self, now: float, extra: float) -> bool:
        """Take what a message costs beyond its size, if there is so much."""
        return self._bucket.take(now, extra)

    def pause(self, now: float) -> float:
        """Seconds until there is a reserve for what else may come; none where there is one."""
        lacking = self._per_second / 4 - self._bucket.left(now)
        return max(0.0, lacking) / self._per_second
