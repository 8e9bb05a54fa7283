"""Why there is no connection, in words that say what to do."""

from __future__ import annotations

import socket
import ssl

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidMessage, InvalidStatus
from websockets.http11 import Response

from robotouille_client.errors import StrangerError
from robotouille_client.sockets import open_socket, why_not

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
        (refused(b"<html>"), HERE, "that is no Robotouille server, but a web page"),
        (InvalidMessage("no HTTP response"), HERE, "If it speaks TLS, it is at wss://"),
        (untrusted("self-signed certificate"), SAFE, "SSL_CERT_FILE=FILE"),
        (untrusted("IP address mismatch, not valid for 'x'."), SAFE, "Say --url with a name"),
        (ConnectionResetError(), SAFE, "the handshake was cut off. Does the server speak TLS?"),
        (ssl.SSLError(1, "wrong version"), SAFE, "If not, it is at ws://"),
        (ConnectionRefusedError("refused"), HERE, f"nobody answers at {HERE}: is a server running"),
        (OSError("Multiple exceptions: [Errno 111]"), HERE, f"nobody answers at {HERE}:"),
        (TimeoutError(), HERE, f"nobody answers at {HERE}:"),
        (socket.gaierror(-2, "unknown"), "ws://kitchn:1", "there is no host 'kitchn'"),
        (OSError("no route"), HERE, f"cannot connect to {HERE}: no route. Is robotouille-server"),
    ],
)
def test_what_is_wrong_is_said(error: Exception, url: str, words: str) -> None:
    assert words in why_not(error, url)


@pytest.mark.parametrize("there", ["ws://127.0.0.1:99999/", "ws://[::1/"])
def test_a_redirect_to_what_is_no_address_is_not_followed(there: str) -> None:
    moved = InvalidStatus(Response(302, "Found", Headers(Location=there)))
    with pytest.raises(StrangerError, match="sends us to what is no address"):
        open_socket(HERE).process_redirect(moved)
