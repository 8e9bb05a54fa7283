"""Explanations of failed connections."""

from __future__ import annotations

import socket
import ssl

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidMessage, InvalidStatus
from websockets.http11 import Response

from robotouille_client.errors import UntrustedRedirectError
from robotouille_client.sockets import connection_error, open_socket

HERE, SAFE = "ws://127.0.0.1:8765", "wss://kitchen.example"


def refused(body: bytes) -> InvalidStatus:
    return InvalidStatus(Response(503, "Service Unavailable", Headers(), body))


def untrusted(message: str) -> ssl.SSLCertVerificationError:
    error = ssl.SSLCertVerificationError(1, message)
    error.verify_message = message
    return error


@pytest.mark.parametrize(
    ("error", "url", "words"),
    [
        (refused(b"the server is full\nmore"), HERE, "the server is full"),
        (refused(b"<html>"), HERE, "it is a web page, not a Robotouille server"),
        (InvalidMessage("no HTTP response"), HERE, "If the server uses TLS, connect to wss://"),
        (untrusted("self-signed certificate"), SAFE, "SSL_CERT_FILE=FILE"),
        (untrusted("IP address mismatch, not valid for 'x'."), SAFE, "Use --url with a name"),
        (ConnectionResetError(), SAFE, "the handshake was cut off. If the server does not use TLS"),
        (ssl.SSLError(1, "wrong version"), SAFE, "connect to ws://"),
        (ConnectionRefusedError("refused"), HERE, f"no answer from {HERE}. Is a server running"),
        (OSError("Multiple exceptions: [Errno 111]"), HERE, f"no answer from {HERE}."),
        (TimeoutError(), HERE, f"no answer from {HERE}."),
        (socket.gaierror(-2, "unknown"), "ws://kitchn:1", "unknown host 'kitchn'"),
        (OSError("no route"), HERE, f"cannot connect to {HERE}: no route. Is robotouille-server"),
    ],
)
def test_connection_errors_are_explained(error: Exception, url: str, words: str) -> None:
    assert words in connection_error(error, url)


@pytest.mark.parametrize("there", ["ws://127.0.0.1:99999/", "ws://[::1/"])
def test_http_redirect_to_an_invalid_address_is_refused(there: str) -> None:
    moved = InvalidStatus(Response(302, "Found", Headers(Location=there)))
    with pytest.raises(UntrustedRedirectError, match="redirects to an invalid address"):
        open_socket(HERE).process_redirect(moved)
