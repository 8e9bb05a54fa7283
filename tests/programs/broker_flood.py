"""MQTT broker over TLS that floods the server: `python -m tests.programs.broker_flood PORT PEM`.

Its TLS records end within packets, so after each packet the server has decrypted data pending. The
first connections receive packets as fast as the server reads, and later ones stay just below the
server's limit, so that it does not close them.
"""

from __future__ import annotations

import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from robotouille_server.mqtt.client import PACKETS_A_SECOND
from tests.mqtt.lying import CONNACK, PINGRESP, packet

__all__ = ["flooding_broker"]

UNLIMITED = 3
PIECES_A_SECOND = 10
SUBSCRIBE, PRESENCE = 0x82, 0x33
"""First bytes of packets. Presence is a retained message of QoS 1."""


@contextmanager
def flooding_broker(pem: Path) -> Iterator[str]:
    """Run the broker in another process with this key and certificate, and yield its URL."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "tests.programs.broker_flood", str(port), str(pem)]
    process = subprocess.Popen(command)
    try:
        yield f"mqtts://127.0.0.1:{port}"
    finally:
        process.kill()
        process.wait()


def _received(stream: BinaryIO) -> tuple[int, bytes]:
    """Return the first byte and the body of the next packet."""
    first, length, shift = stream.read(1), 0, 0
    while byte := stream.read(1):
        length, shift = length | (byte[0] & 127) << shift, shift + 7
        if byte[0] < 128:
            return first[0], stream.read(length)
    raise ConnectionResetError


def _serve(connection: ssl.SSLSocket, *, limited: bool) -> None:
    """Answer until the server is online, and then send pongs until it closes the connection."""
    stream, first = connection.makefile("rb"), 0
    while first != PRESENCE:
        first, body = _received(stream)
        if first == PRESENCE:
            at = 2 + int.from_bytes(body[:2], "big")
            connection.sendall(packet(0x40, body[at : at + 2]))
        elif first == SUBSCRIBE:
            connection.sendall(packet(0x90, body[:2] + b"\0\1"))
        else:
            connection.sendall(CONNACK)
    connection.sendall(PINGRESP[:1])
    count = round(0.8 * PACKETS_A_SECOND / PIECES_A_SECOND) if limited else 8192
    while True:
        connection.sendall(PINGRESP[1:] + PINGRESP * (count - 1) + PINGRESP[:1])
        if limited:
            time.sleep(1 / PIECES_A_SECOND)


def main() -> None:
    """Serve one connection after the other until the process is killed."""
    port, pem = sys.argv[1:]
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(pem)
    accepted = 0
    with socket.create_server(("127.0.0.1", int(port))) as listening:
        while True:
            plain, _ = listening.accept()
            with suppress(OSError), tls.wrap_socket(plain, server_side=True) as connection:
                accepted += 1
                _serve(connection, limited=accepted > UNLIMITED)


if __name__ == "__main__":
    main()
