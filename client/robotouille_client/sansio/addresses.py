"""Checks of the addresses a server redirects to, and the delays between connection attempts."""

from __future__ import annotations

import random
from collections.abc import Iterator
from urllib.parse import SplitResult, urlsplit, urlunsplit

from robotouille.protocol import messages
from robotouille_client.errors import UntrustedRedirectError

# The first attempt is so early that players do not notice a restart. The limit bounds the attempts
# at a server that is down for hours to one in 2.5 s from each client.
FIRST_DELAY, MAX_DELAY = 0.1, 5.0


def moved_url(url: str, moved: messages.Moved | messages.WorkerAddress) -> str:
    """Return the address of the server process that a message names.

    Raises:
        UntrustedRedirectError: The address is on another host, or drops TLS.
    """
    parts = urlsplit(url)
    if moved.url:
        check_redirect(parts, moved.url)
        return moved.url
    # Without a URL the process is on the same host, behind another port.
    if not 0 < moved.port < 2**16:
        raise UntrustedRedirectError(f"{url} redirects to port {moved.port}, which is invalid")
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return urlunsplit(parts._replace(netloc=f"{host}:{moved.port}"))


def check_redirect(current: SplitResult, url: str) -> None:
    """Raise `UntrustedRedirectError` unless `url` keeps the host, and TLS if there was TLS."""
    # A client sends its tokens to the address that it is redirected to. A faulty or hostile server
    # could otherwise have the tokens sent to a host that the user never chose.
    start = f"{current.scheme}://{current.netloc}"
    try:
        target = urlsplit(url)
        host, _ = target.hostname, target.port
    except ValueError:
        raise UntrustedRedirectError(
            f"{start} redirects to {url[:200]!r}, which is not an address"
        ) from None
    if target.scheme not in ("ws", "wss") or not host:
        raise UntrustedRedirectError(
            f"{start} redirects to {url[:200]!r}, which is not a ws:// or wss:// address"
        )
    if host != current.hostname:
        raise UntrustedRedirectError(
            f"{start} redirects to another host, {host!r}, and tokens are not sent there. "
            "If you trust that host, connect to it directly"
        )
    if (current.scheme, target.scheme) == ("wss", "ws"):
        raise UntrustedRedirectError(
            f"{start} redirects to {target.netloc!r} without TLS, and tokens are not sent there"
        )


def reconnect_delays(rng: random.Random) -> Iterator[float]:
    """Yield the seconds to wait before each connection attempt, without end.

    The upper limit of the delay doubles from `FIRST_DELAY` to `MAX_DELAY`.
    """
    limit = FIRST_DELAY
    while True:
        limit = min(2 * limit, MAX_DELAY)
        # All delays are random, even the longest. Otherwise, all clients of a restarted server
        # would always arrive at the same time.
        yield limit * rng.uniform(0.5, 1.0)
