"""WebSocket connections to a server, checks of its address, and explanations of failures."""

from __future__ import annotations

import socket
import ssl
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidHandshake, InvalidMessage, InvalidStatus, InvalidURI
from websockets.typing import Subprotocol
from websockets.uri import WebSocketURI, parse_uri

from robotouille.protocol.codec import Codec
from robotouille_client.errors import ConnectionFailedError, UntrustedRedirectError
from robotouille_client.sansio.addresses import check_redirect

# Seconds between two pings, and until an unanswered one ends the connection. A machine that loses
# power closes no connection. If there are other nodes, a slow one is better left.
PING_SECONDS, PONG_SECONDS = 20.0, 60.0
NODE_PING_SECONDS, NODE_PONG_SECONDS = 2.0, 5.0

MAX_UNSENT_BYTES = 1024 * 1024
"""Bytes that wait for the server to read them, after which the connection is cut."""


class GameConnection(ClientConnection):
    """Connection that is cut if the server sends pings and reads no pongs.

    The library would keep any number of pongs. It waits until other messages are sent.
    """

    def data_received(self, data: bytes) -> None:
        """Process data, and answer the pings in it."""
        super().data_received(data)
        if self.transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            self.transport.abort()


class open_socket(connect):  # noqa: N801
    """`connect` of websockets that follows HTTP redirects to trusted hosts only.

    Attributes:
        named: Addresses that the user named. Their hosts are trusted.
    """

    named: tuple[str, ...] = ()

    def process_redirect(self, exc: Exception) -> Exception | str:
        """Return the redirect's target, or the error.

        Raises:
            UntrustedRedirectError: Tokens must not be sent to the target.
        """
        try:
            target = super().process_redirect(exc)
        except ValueError as error:
            raise UntrustedRedirectError(
                f"{self.uri} redirects to an invalid address: {error}"
            ) from None
        if isinstance(target, str):
            check_redirect(urlsplit(self.uri), target, self.named)
        return target


async def open_game_socket(
    url: str, codec: Codec, seconds: float, named: tuple[str, ...]
) -> ClientConnection:
    """Connect to a server.

    Args:
        seconds: Time limit.
        named: Addresses that the user named.

    Raises:
        ConnectionFailedError: The connection failed; the message explains why.
    """
    server_uri(url)
    opening = open_socket(
        url,
        subprotocols=[Subprotocol(codec.name)],
        # Messages are small and frequent: compressing them costs more than it saves.
        compression=None,
        max_size=8 * 1024 * 1024,
        open_timeout=seconds,
        ping_interval=PING_SECONDS,
        ping_timeout=PONG_SECONDS,
        close_timeout=2,
        create_connection=GameConnection,
    )
    opening.named = named
    try:
        return await opening
    except (OSError, InvalidHandshake, InvalidURI, TimeoutError) as error:
        raise ConnectionFailedError(connection_error(error, url)) from None


def ping_often(connection: ClientConnection) -> None:
    """Notice sooner that the server has fallen silent, since the client has other addresses."""
    connection.ping_interval = NODE_PING_SECONDS
    connection.ping_timeout = NODE_PONG_SECONDS
    # The task sleeps until the end of the longer interval, so it is started again.
    if connection.keepalive_task is not None:
        connection.keepalive_task.cancel()
    connection.start_keepalive()


def connection_error(error: Exception, url: str) -> str:
    """Return why a connection could not be made, and what to do about it."""
    # asyncio reports a host with several addresses in one error, whatever each attempt raised.
    several = isinstance(error, OSError) and str(error).startswith("Multiple exceptions:")
    if several or isinstance(error, ConnectionRefusedError | TimeoutError):
        return f"no answer from {url}. Is a server running there?"
    return f"cannot connect to {url}: {_reason(error, url)}"


def _reason(error: Exception, url: str) -> str:
    if isinstance(error, InvalidStatus) and error.response.body:
        text = error.response.body.decode(errors="replace").strip().partition("\n")[0][:300]
        return "it is a web page, not a Robotouille server" if text.startswith("<") else text
    if isinstance(error, InvalidMessage) and url.startswith("ws:"):
        return f"{error}. If the server uses TLS, connect to wss://"
    if isinstance(error, ssl.SSLCertVerificationError):
        if "not valid for" in error.verify_message:
            return f"{error.verify_message} Use --url with a name that the certificate contains"
        return (
            f"its certificate is not trusted here ({error.verify_message}); set "
            "SSL_CERT_FILE=FILE to an existing file with the certificate of the authority that "
            "signed it"
        )
    # A server without TLS answers the handshake by closing the connection.
    reset = isinstance(error, ConnectionResetError) and url.startswith("wss:")
    if isinstance(error, ssl.SSLError) or reset:
        reason = getattr(error, "reason", None) or "the handshake was cut off"
        return f"{reason}. If the server does not use TLS, connect to ws://"
    if isinstance(error, socket.gaierror):
        return f"unknown host {urlsplit(url).hostname!r}"
    return f"{error}. Is robotouille-server running there?"


def server_uri(url: str) -> WebSocketURI:
    """Parse a server's address.

    Raises:
        ConnectionFailedError: The address is invalid; the message explains why on one line.
    """
    try:
        fault = _fault(url)
        if not fault:
            return parse_uri(url)
    except (ValueError, InvalidURI) as error:
        fault = str(error)
    raise ConnectionFailedError(f"{url!r} is not a WebSocket URL like ws://host:8765: {fault}")


def _fault(url: str) -> str:
    # The libraries' own messages for these mistakes do not help a user. They raise ValueError
    # for the others.
    parts = urlsplit(url)
    if parts.scheme not in ("ws", "wss"):
        near = f", as in ws://{parts.netloc} or, with TLS, wss://{parts.netloc}"
        return f"it must begin with ws:// or wss://{near if parts.netloc else ''}"
    try:
        port = parts.port
    except ValueError:
        port = 0
    if port == 0:
        brackets = " (put an IPv6 address in brackets)" if parts.netloc.count(":") > 1 else ""
        return f"a port is a number from 1 to 65535{brackets}"
    host = parts.hostname or ""
    try:
        host.encode("idna")
    except UnicodeError:
        return f"{host!r} is not a host name"
    return "" if host.isprintable() else f"{host!r} is not a host name"
