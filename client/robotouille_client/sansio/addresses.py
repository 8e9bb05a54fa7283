"""Where a server may send us."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit, urlunsplit

from robotouille.protocol import messages
from robotouille_client.errors import StrangerError

__all__ = ["check_host", "moved_url"]


def moved_url(url: str, moved: messages.Moved) -> str:
    """The address of the process that a server sends us to.

    Raises StrangerError where that is another host, or one without TLS after one with: whoever
    speaks for the server that we were told to trust could collect tokens there.
    """
    parts = urlsplit(url)
    if moved.url:
        check_host(parts, moved.url)
        return moved.url
    if not 0 < moved.port < 2**16:
        raise StrangerError(f"{url} sends us to port {moved.port}, which is none")
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return urlunsplit(parts._replace(netloc=f"{host}:{moved.port}"))


def check_host(here: SplitResult, url: str) -> None:
    """Whether we may go to `url`: the same host, and TLS where there was TLS before."""
    start = f"{here.scheme}://{here.netloc}"
    try:
        there = urlsplit(url)
        host, _ = there.hostname, there.port
    except ValueError:
        raise StrangerError(f"{start} sends us to {url[:200]!r}, which is no address") from None
    if there.scheme not in ("ws", "wss") or not host:
        raise StrangerError(f"{start} sends us to {url[:200]!r}, which is no ws:// or wss://")
    if host != here.hostname:
        reason = "another host: tokens are not sent there. If that is right, connect to it"
        raise StrangerError(f"{start} sends us to {host!r}, {reason}")
    if (here.scheme, there.scheme) == ("wss", "ws"):
        reason = "without TLS: tokens are not sent there"
        raise StrangerError(f"{start} sends us to {there.netloc!r} {reason}")
