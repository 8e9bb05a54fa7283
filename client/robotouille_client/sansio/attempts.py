"""The order in which a client tries the addresses of a server, and the delays between attempts."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from urllib.parse import SplitResult, urlsplit

from robotouille.protocol import messages
from robotouille_client.errors import UntrustedRedirectError
from robotouille_client.sansio.addresses import check_redirect, moved_url, split_addresses

# The first attempt is so early that players do not notice a restart. The limit bounds the attempts
# at a server that is down for hours to one in 2.5 s from each client, for each address.
FIRST_DELAY, MAX_DELAY = 0.1, 5.0
GROWTH = 1.5
# Another node takes games over three to eight seconds after a failure. If the delays grew further
# before that, a client that comes just too early would return only four seconds later.
EARLY_ATTEMPTS, MAX_EARLY_DELAY = 12, 1.5
# Time limit for opening a connection. A machine without power answers nothing, so the limit is
# short at first if there are other addresses. It grows with each round, for slow networks.
CONNECT_SECONDS, FIRST_CONNECT_SECONDS = 10.0, 2.0
# Number of addresses of redirects that a client remembers besides the server's own list.
MAX_MOVED = 8


def reconnect_delays(rng: random.Random) -> Iterator[float]:
    """Yield the seconds to wait before each connection attempt, without end.

    The upper limit of the delay grows from twice `FIRST_DELAY` by `GROWTH`, up to
    `MAX_EARLY_DELAY` and, after `EARLY_ATTEMPTS`, up to `MAX_DELAY`.
    """
    limit = 2 * FIRST_DELAY / GROWTH
    for number in count():
        limit = min(GROWTH * limit, MAX_EARLY_DELAY if number < EARLY_ATTEMPTS else MAX_DELAY)
        # All delays are random, even the longest. Otherwise, all clients of a restarted server
        # would always arrive at the same time.
        yield limit * rng.uniform(0.5, 1.0)


class ServerAddresses:
    """All addresses of a server that a client knows, and the one that it tries next.

    After a lost connection, a round of attempts tries the current address and then the others.
    Further rounds follow. A delay precedes each round; within a round, attempts follow at once.

    Args:
        urls: The addresses that the user named, separated by commas.

    Attributes:
        named: The addresses that the user named.
        current: The address of the connection, or of the next attempt.
        dead_end: True if a redirect led to a node that does not answer, until the episode is found.
    """

    def __init__(self, urls: str, rng: random.Random) -> None:
        self._rng = rng
        self.named = tuple(split_addresses(urls))
        self._nodes: tuple[str, ...] = ()
        self._moved: deque[str] = deque(maxlen=MAX_MOVED)
        self.dead_end = self._reached = self._redirected = False
        self._begin()
        self._left: deque[str] = deque(self._shuffled(self.named))
        self.current = self._home = self._left.popleft()

    def _begin(self) -> None:
        self._delays = reconnect_delays(self._rng)
        self._rounds = 0
        self._failed: set[str] = set()

    @property
    def others(self) -> list[str]:
        """The addresses besides the current one; empty unless the server has several nodes."""
        # The processes of one server redirect too, but only the first address is the user's.
        if len(self.named) == 1 and not self._nodes:
            return []
        known = dict.fromkeys((*self.named, *self._nodes, *self._moved, self._home))
        return [url for url in known if url != self.current]

    @property
    def left(self) -> bool:
        """True if this round has further addresses."""
        return bool(self._left)

    @property
    def connect_seconds(self) -> float:
        """Time limit for opening the next connection."""
        if not self._reached or not self.others:
            return CONNECT_SECONDS
        return min(FIRST_CONNECT_SECONDS * (1 + self._rounds), CONNECT_SECONDS)

    def resolve(self, address: messages.Moved | messages.WorkerAddress) -> str:
        """Return the address that a message of the current server names.

        Raises:
            UntrustedRedirectError: Tokens must not be sent there.
        """
        return moved_url(self.current, address, self.named)

    def reached(self, nodes: Iterable[str], *, stable: bool = True) -> None:
        """Stay at the current address, whose server welcomed the client.

        Args:
            nodes: Addresses of the server's other nodes. The client ignores untrusted ones.
            stable: False if the server has closed several connections at once.
        """
        self._home = self.current
        here = urlsplit(self.current)
        self._nodes = tuple(url for url in nodes if self._is_trusted(here, url))
        if self._nodes:
            self._moved.clear()
        self._left.clear()
        self._reached, self._redirected = True, False
        # The connection works again, so the next loss starts with a short delay. But if the
        # server redirects to a node that has stopped, each welcome leads to the next attempt.
        if not self.dead_end and stable:
            self._begin()

    def _is_trusted(self, here: SplitResult, url: str) -> bool:
        try:
            check_redirect(here, url, self.named)
        except UntrustedRedirectError:
            return False
        return True

    def answered(self) -> None:
        """Record that the server answered a join."""
        if self.dead_end:
            self.dead_end = False
            self._begin()

    def redirect(self, url: str, *, at_once: bool = False) -> float:
        """Begin a round with the address of a redirect, and return the delay before it."""
        self._turn(url)
        self._begin_round()
        return 0.0 if at_once else next(self._delays)

    def redirect_within_round(self, url: str) -> bool:
        """Turn to the address of a redirect; return False if it has failed in this round."""
        if url in self._failed:
            return False
        self._turn(url)
        self._left = deque(each for each in self._left if each != url)
        return True

    def _turn(self, url: str) -> None:
        self.current = url
        self._redirected = True
        if url not in self._moved:
            self._moved.append(url)

    def lost(self) -> float:
        """Begin a round with the current address, and return the delay before it."""
        self._begin_round()
        return next(self._delays)

    def _begin_round(self) -> None:
        self._left = deque(self._shuffled(self.others))
        self._failed.clear()

    def failed(self) -> float:
        """Turn to the next address after a failed attempt, and return the delay before it."""
        self.dead_end |= self._redirected
        self._redirected = False
        self._failed.add(self.current)
        if self._left:
            self.current = self._left.popleft()
            return 0.0
        self._left = deque(self._shuffled([self.current, *self.others]))
        self.current = self._left.popleft()
        self._failed.clear()
        self._rounds += 1
        return next(self._delays)

    def _shuffled(self, urls: Sequence[str]) -> list[str]:
        shuffled = list(urls)
        self._rng.shuffle(shuffled)
        return shuffled
