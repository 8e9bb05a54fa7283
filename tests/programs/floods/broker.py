"""MQTT broker over TLS that floods the server.

    python -m tests.programs.floods.broker packets PORT PEM

With `packets`, its TLS records end within packets, so after each packet the server has decrypted
data pending. The first connections receive packets as fast as the server reads, and later ones stay
just below the server's limit, so that it does not close them. With `keys`, it changes the keys of
the connection again and again.
"""

from __future__ import annotations

import os
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Literal

from robotouille_server.mqtt.client import PACKETS_A_SECOND
from tests.mqtt.lying import CONNACK, PINGRESP, packet
from tests.programs.key_changes import KeyChanges, logged_keys

__all__ = ["BrokerFlood", "flooding_broker"]

BrokerFlood = Literal["packets", "keys"]

UNLIMITED = 3
PIECES_A_SECOND = 10
SUBSCRIBE, PRESENCE = 0x82, 0x33
"""First bytes of packets. Presence is a retained message of QoS 1."""


@contextmanager
def flooding_broker(kind: BrokerFlood, pem: Path) -> Iterator[str]:
    """Run the broker in another process with this key and certificate, and yield its URL."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "tests.programs.floods.broker", kind, str(port), str(pem)]
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


def _bring_online(connection: ssl.SSLSocket) -> int:
    """Answer until the server is online; return the number of answers."""
    stream, first, answers = connection.makefile("rb"), 0, 0
    while first != PRESENCE:
        first, body = _received(stream)
        if first == PRESENCE:
            at = 2 + int.from_bytes(body[:2], "big")
            connection.sendall(packet(0x40, body[at : at + 2]))
        elif first == SUBSCRIBE:
            connection.sendall(packet(0x90, body[:2] + b"\0\1"))
        else:
            connection.sendall(CONNACK)
        answers += 1
    return answers


def _send_packets(connection: ssl.SSLSocket, *, limited: bool) -> None:
    """Send pongs until the server closes the connection."""
    connection.sendall(PINGRESP[:1])
    count = round(0.8 * PACKETS_A_SECOND / PIECES_A_SECOND) if limited else 8192
    while True:
        connection.sendall(PINGRESP[1:] + PINGRESP * (count - 1) + PINGRESP[:1])
        if limited:
            time.sleep(1 / PIECES_A_SECOND)


def _send_keys(connection: ssl.SSLSocket, log: Path, answers: int) -> None:
    """Change the keys until the server closes the connection."""
    changes = KeyChanges(log, "SERVER", answers)
    with socket.socket(fileno=os.dup(connection.fileno())) as plain:
        plain.setblocking(True)
        while True:
            plain.sendall(changes.records(500))
            with suppress(BlockingIOError):
                plain.recv(1 << 20, socket.MSG_DONTWAIT)


def main() -> None:
    """Serve one connection after the other until the process is killed."""
    kind, port, pem = sys.argv[1:]
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(pem)
    # Tickets would be records, which count for the next change of keys.
    tls.num_tickets = 0
    accepted = 0
    with socket.create_server(("127.0.0.1", int(port))) as listening, logged_keys(tls) as log:
        while True:
            plain, _ = listening.accept()
            with suppress(OSError), tls.wrap_socket(plain, server_side=True) as connection:
                accepted += 1
                answers = _bring_online(connection)
                if kind == "keys":
                    _send_keys(connection, log, answers)
                _send_packets(connection, limited=accepted > UNLIMITED)


if __name__ == "__main__":
    main()
