"""Where a server is, and why it cannot be reached there."""

from __future__ import annotations

import ssl
from urllib.parse import urlsplit, urlunsplit

from websockets.exceptions import InvalidMessage, InvalidStatus

from robotouille.protocol import messages

__all__ = ["moved_url", "why_not"]


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
    """The address of the process that a server sends us to."""
    if moved.url:
        return moved.url
    parts = urlsplit(url)
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return urlunsplit(parts._replace(netloc=f"{host}:{moved.port}"))
