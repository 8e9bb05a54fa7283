"""Rate limits: a token bucket, and the budget of messages that one connection may send."""

from __future__ import annotations

from robotouille.errors import ProtocolError
from robotouille.protocol import messages


class TokenBucket:
    """Amount that may still be used; it refills over time.

    The bucket holds at most `burst` (default: twice `per_second`) and gains `per_second`. Debts
    can make its content negative.
    """

    __slots__ = ("_at", "_burst", "_left", "_rate")

    def __init__(self, per_second: float, now: float, burst: float | None = None) -> None:
        self._rate = per_second
        # A client that was silent for two seconds, such as one that loads, may catch up.
        self._burst = 2 * per_second if burst is None else burst
        self._left = self._burst
        self._at = now

    def left(self, now: float) -> float:
        """Return the amount that can be taken now."""
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        return self._left

    def wait(self, now: float) -> float:
        """Return the seconds until the bucket holds 1."""
        return max(0.0, 1 - self.left(now)) / self._rate

    def take(self, now: float, cost: float = 1) -> bool:
        """Take `cost`; return False if the bucket does not hold that much."""
        if self.left(now) < cost:
            return False
        self._left -= cost
        return True

    def owe(self, now: float, cost: float) -> None:
        """Take `cost` even if the bucket does not hold that much."""
        if cost > 0:
            self._left = self.left(now) - cost


STEP_COST, TEXT_COST = 8.0, 8.0
"""Cost of a step, and of a player's text view of its state, in units of `LoopBudget`."""
COSTS: dict[type[messages.Message], float] = {
    messages.Create: 10,
    messages.Close: 2,
    messages.Join: 5,
    messages.Resync: 5,
    messages.ListEpisodes: 3,
    messages.GetRendering: 3,
    messages.GetPicture: 2,
}
"""Cost of a message, if not 1. Each KiB of the message, and of the snapshots and lists that answer
it, costs 1 more. After each of these messages, all other connections get a turn. Resyncs are
excepted: all resyncs of one turn share an answer."""
RETURN = 5
"""Cost of a `hello` that returns to a session: it is answered by a snapshot, as a join is."""
PACED = (messages.Create, messages.Close)
"""Messages that hosts send by the hundred for a study. They cost a connection as much as any other
message and are never refused for their number: the server reads those above the limit later."""
KIB = 1024
MAX_HELLO_BYTES = 8 * KIB
"""Maximum size of a message before `welcome`. The longest `hello` is smaller."""
MISTAKE = 9.0
"""Additional cost of a message that is answered by an error, or of an action that does not exist.
Finding the error costs more than most messages: misspelt actions are compared with all others."""
MAX_GREETINGS = 5
"""Messages that a connection may send before `welcome`. Each may have a token to check."""
MAX_REFUSED = 200
"""Refused messages, within about a minute, after which the connection is closed."""


def cost_of(message: messages.Message) -> float:
    """Return the cost of a message in units of `LoopBudget`."""
    if isinstance(message, messages.Hello) and message.resume is not None:
        return RETURN
    return COSTS.get(type(message), 1)


class FloodError(Exception):
    """A connection has sent far more than it may."""


class MessageBudget:
    """Messages and bytes that a connection may send per second, and its refused messages."""

    __slots__ = ("_bucket", "_greetings", "_per_second", "_refusals")

    def __init__(self, per_second: float, now: float) -> None:
        self._per_second = per_second
        self._bucket = TokenBucket(per_second, now)
        self._refusals = TokenBucket(MAX_REFUSED / 60, now, MAX_REFUSED)
        self._greetings = 0

    @property
    def exceeded(self) -> str:
        """Explanation for clients that have sent too many messages."""
        return f"more than {self._per_second:g} messages a second"

    def charge(self, now: float, size: int, answered: int, *, greeted: bool) -> bool:
        """Charge for a message and for the answers to earlier ones.

        Refused messages cost as much as others, because they are read and answered, too.

        Args:
            now: The current time.
            size: The size of the message in bytes.
            answered: The bytes of answers sent since the last charge.
            greeted: True if `hello` has been answered.

        Returns:
            True if the budget was sufficient.

        Raises:
            ProtocolError: The message is not worth parsing.
            FloodError: Too many messages were refused, or came before `welcome`; the connection
                must be closed.
        """
        if not greeted:
            self._greetings += 1
            if self._greetings > MAX_GREETINGS:
                raise FloodError
        if not greeted and size > MAX_HELLO_BYTES:
            self._refuse(now, size)
            message = f"{size:,} bytes; at most {MAX_HELLO_BYTES:,} are read before hello"
            raise ProtocolError("message/too-large", message)
        self._bucket.owe(now, answered / KIB)
        # The size counts, because decoding takes time in proportion to it.
        if self._bucket.take(now, 1 + size / KIB):
            return True
        self._refuse(now, size)
        if size > MAX_HELLO_BYTES:
            # Parsing so large a message only to find its `ref` would cost what the limit saves.
            raise ProtocolError("rate/limited", self.exceeded)
        return False

    def _refuse(self, now: float, size: int) -> None:
        """Count a refused message; long messages count for more."""
        if not self._refusals.take(now, 1 + size / MAX_HELLO_BYTES):
            raise FloodError

    def take(self, now: float, extra: float) -> bool:
        """Take what a message costs beyond its size; return False if the budget is too small."""
        return self._bucket.take(now, extra)

    def charge_mistakes(self, now: float, count: int) -> None:
        """Charge for messages that were answered by an error; this never fails."""
        self._bucket.owe(now, MISTAKE * count)

    def pause(self, now: float) -> float:
        """Return the seconds until the budget has a reserve for other messages."""
        # A reserve, so that a paced host can still send other messages.
        lacking = self._per_second / 4 - self._bucket.left(now)
        return max(0.0, lacking) / self._per_second
