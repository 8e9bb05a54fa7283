"""A WebSocket to a server, what its address is made of, and why there is none."""

from __future__ import annotations

import socket
import ssl
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import InvalidMessage, InvalidStatus, InvalidURI
from websockets.uri import WebSocketURI, parse_uri

from robotouille_client.errors import ConnectionFailedError, StrangerError
from robotouille_client.sansio.addresses import check_host

__all__ = ["open_socket", "server_uri", "why_not"]


class open_socket(connect):  # noqa: N801
    """`connect` of websockets, which follows HTTP redirects to the same host only."""

    def process_redirect(self, exc: Exception) -> Exception | str:
        """Where to go on; an error in place of a host that our tokens do not go to."""
        try:
            target = super().process_redirect(exc)
        except ValueError as error:
            raise StrangerError(f"{self.uri} sends us to what is no address: {error}") from None
        if isinstance(target, str):
            check_host(urlsplit(self.uri), target)
        return target


def why_not(error: Exception, url: str) -> str:
    """That a connection could not be made, why, and what to do."""
    if _is_refused(error):
        return f"nobody answers at {url}: is a server running there?"
    return f"cannot connect to {url}: {_reason(error, url)}"


def _is_refused(error: Exception) -> bool:
    """Whether nothing listens at any of a host's addresses, or nothing has come back."""
    several = isinstance(error, OSError) and str(error).startswith("Multiple exceptions:")
    return several or isinstance(error, ConnectionRefusedError | TimeoutError)


def _reason(error: Exception, url: str) -> str:
    if isinstance(error, InvalidStatus) and error.response.body:
        said = error.response.body.decode(errors="replace").strip().partition("\n")[0][:300]
        return "that is no Robotouille server, but a web page" if said.startswith("<") else said
    if isinstance(error, InvalidMessage) and url.startswith("ws:"):
        return f"{error}. If it speaks TLS, it is at wss://"
    if isinstance(error, ssl.SSLCertVerificationError):
        if "not valid for" in error.verify_message:
            return f"{error.verify_message} Say --url with a name that is in it"
        return (
            f"its certificate is not trusted here ({error.verify_message}); "
            "SSL_CERT_FILE=FILE names the file of the authority that signed it, which must exist"
        )
    reset = isinstance(error, ConnectionResetError) and url.startswith("wss:")
    if isinstance(error, ssl.SSLError) or reset:
        reason = getattr(error, "reason", None) or "the handshake was cut off"
        return f"{reason}. Does the server speak TLS? If not, it is at ws://"
    if isinstance(error, socket.gaierror):
        return f"there is no host {urlsplit(url).hostname!r}"
    return f"{error}. Is robotouille-server running there?"


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
