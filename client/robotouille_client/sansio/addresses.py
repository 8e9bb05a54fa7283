"""What a server's address is made of, and where a server may send us."""

from __future__ import annotations

from urllib.parse import SplitResult, urlsplit, urlunsplit

from websockets.exceptions import InvalidURI
from websockets.uri import WebSocketURI, parse_uri

from robotouille.protocol import messages
from robotouille_client.errors import ConnectionFailedError, StrangerError

__all__ = ["check_host", "moved_url", "server_uri"]


def server_uri(url: str) -> WebSocketURI:
    """A server's address, taken apart.

    Raises:
        ConnectionFailedError: It is none; what is wrong with it is said in a line.
    """
    try:
        fault = _fault(url)
        if not fault:
            return parse_uri(url)
    except (ValueError, InvalidURI) as error:
        fault = str(error)
    raise ConnectionFailedError(f"{url!r} is no WebSocket URL like ws://host:8765: {fault}")


def _fault(url: str) -> str:
    """What is wrong with a server's address that can be said better than by the libraries, which
    raise ValueError for the rest."""
    parts = urlsplit(url)
    if parts.scheme not in ("ws", "wss"):
        near = f", as in ws://{parts.netloc} or, with TLS, wss://{parts.netloc}"
        return f"it begins with ws:// or wss://{near if parts.netloc else ''}"
    try:
        port = parts.port
    except ValueError:
        port = 0
    if port == 0:
        brackets = " (an IPv6 address stands in brackets)" if parts.netloc.count(":") > 1 else ""
        return f"a port is a number from 1 to 65535{brackets}"
    host = parts.hostname or ""
    try:
        host.encode("idna")
    except UnicodeError:
        return f"no host can be called {host!r}"
    return "" if host.isprintable() else f"no host can be called {host!r}"


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
