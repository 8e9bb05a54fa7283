"""Where a server is, and why it cannot be reached there."""

from __future__ import annotations

import ssl
from urllib.parse import SplitResult, urlsplit, urlunsplit

from websockets.asyncio.client import connect
from websockets.exceptions import InvalidMessage, InvalidStatus

from robotouille.protocol import messages
from robotouille_client.errors import StrangerError

__all__ = ["moved_url", "open_socket", "why_not"]


class open_socket(connect):  # noqa: N801
    """`connect` of websockets, which follows HTTP redirects to the same host only."""

    def process_redirect(self, exc: Exception) -> Exception | str:
        """Where to go on; an error in place of a host that our tokens do not go to."""
        target = super().process_redirect(exc)
        if isinstance(target, str):
            _check_host(urlsplit(self.uri), target)
        return target


def why_not(error: Exception, url: str) -> str:
    """Why a connection could not be made, and what to do."""
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
    return f"{error}. Is robotouille-server running there?"


def moved_url(url: str, moved: messages.Moved) -> str:
    """The address of the process that a server sends us to.

    Raises StrangerError where that is another host, or one without TLS after one with: whoever
    speaks for the server that we were told to trust could collect tokens there.
    """
    parts = urlsplit(url)
    if moved.url:
        _check_host(parts, moved.url)
        return moved.url
    if not 0 < moved.port < 2**16:
        raise StrangerError(f"{url} sends us to port {moved.port}, which is none")
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return urlunsplit(parts._replace(netloc=f"{host}:{moved.port}"))


def _check_host(here: SplitResult, url: str) -> None:
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
