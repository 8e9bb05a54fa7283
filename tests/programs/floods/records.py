"""Floods over TLS: tiny records, changes of keys, and handshakes.

A record of 23 bytes can contain one byte, or a request to change the keys (RFC 8446, section
4.6.3). The server spends a decryption on it, as on a record of 16 KiB, or an answer with new keys.
A handshake costs the server a signature, which takes milliseconds with an RSA key. Above the limit
for an address, each handshake that begins ends another one.
"""

from __future__ import annotations

import json
import select
import socket
import ssl
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import cycle
from typing import Literal

from tests.programs.floods.honest_game import HELLO, SUBPROTOCOL
from tests.programs.key_changes import CIPHER, KeyChanges, logged_keys
from tests.support.client_hello import slow_hello
from tests.support.fuzzing.wire import TEXT, frame, request

__all__ = ["Kind", "RecordFlood"]

Kind = Literal["bytes", "keys", "handshakes", "groups", "displaced"]
AT_FIRST, AT_ONCE = 6_000, 2_000
"""Records that a connection prepares before the flood, and later for each write."""
CHUNK = 256 * 1024
MESSAGE = b" " * 60_000
"""Message that is still incomplete after the records prepared before the flood."""


class _Connection:
    """Encrypted connection that sends what a subclass prepares."""

    def __init__(self, host: str, port: int) -> None:
        self._received, self._encrypted = ssl.MemoryBIO(), ssl.MemoryBIO()
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        self.context.check_hostname, self.context.verify_mode = False, ssl.CERT_NONE
        self._address = (host, port)
        self.open()

    def open(self) -> None:
        """Connect, shake hands and prepare the first records."""
        self.socket = socket.create_connection(self._address, timeout=20)
        self._shake_hands()
        self.socket.setblocking(False)
        self._unsent = memoryview(self.records(AT_FIRST))

    def records(self, count: int) -> bytes:
        """Return the next records."""
        raise NotImplementedError

    def push(self) -> bool:
        """Send what is possible; return False if nothing was.

        Raises:
            OSError: The connection is closed.
        """
        with suppress(BlockingIOError):
            if not self.socket.recv(CHUNK):
                raise ConnectionResetError
        with suppress(BlockingIOError):
            self._unsent = self._unsent or memoryview(self.records(AT_ONCE))
            sent = self.socket.send(self._unsent)
            self._unsent = self._unsent[sent:]
            return True
        return False

    def _shake_hands(self) -> None:
        self.tls = self.context.wrap_bio(self._received, self._encrypted)
        while True:
            try:
                self.tls.do_handshake()
                return self.socket.sendall(self._encrypted.read())
            except ssl.SSLWantReadError:
                self.exchange()

    def exchange(self) -> None:
        """Send what is encrypted, and wait for an answer."""
        self.socket.sendall(self._encrypted.read())
        data = self.socket.recv(CHUNK)
        if not data:
            raise ConnectionResetError
        self._received.write(data)


class _Bytes(_Connection):
    """Participant that sends long messages, each byte in a record of its own."""

    def open(self) -> None:
        self._plain: Iterator[int] = cycle(frame(MESSAGE, TEXT))
        super().open()

    def _shake_hands(self) -> None:
        super()._shake_hands()
        self.tls.write(request(SUBPROTOCOL))
        self._read_until(b"\r\n\r\n")
        self.tls.write(frame(json.dumps(HELLO).encode(), TEXT))
        self._read_until(b'"welcome"')

    def _read_until(self, mark: bytes) -> None:
        data = b""
        while mark not in data:
            try:
                data += self.tls.read(CHUNK)
            except ssl.SSLWantReadError:
                self.exchange()

    def records(self, count: int) -> bytes:
        for _ in range(count):
            self.tls.write(bytes((next(self._plain),)))
        return self._encrypted.read()


class _Keys(_Connection):
    """Stranger that changes the keys of the connection with each record."""

    def _shake_hands(self) -> None:
        with logged_keys(self.context) as log:
            super()._shake_hands()
            self._changes = KeyChanges(log, "CLIENT")
        assert CIPHER in (self.tls.cipher() or ())

    def records(self, count: int) -> bytes:
        return self._changes.records(count)


class _Handshake(_Connection):
    """Stranger that begins one handshake after the other."""

    def open(self) -> None:
        self.socket = socket.create_connection(self._address, timeout=20)
        self.socket.setblocking(False)
        self.socket.send(self._hello())

    def _hello(self) -> bytes:
        with suppress(ssl.SSLWantReadError):
            self.context.wrap_bio(self._received, self._encrypted).do_handshake()
        return self._encrypted.read()

    def push(self) -> bool:
        """Start again as soon as the server has signed."""
        with suppress(BlockingIOError):
            self.socket.recv(CHUNK)
            self.socket.close()
            self.open()
            return True
        return False


class _SlowGroup(_Handshake):
    """Stranger that offers only a group whose computation takes 0.2 s."""

    def _hello(self) -> bytes:
        return slow_hello()


class _Displaced(_Handshake):
    """Stranger that begins handshakes, and ends none before another one takes its place."""

    def push(self) -> bool:
        """Begin again, whether the server has answered or not."""
        self.socket.close()
        self.open()
        return True


KINDS: dict[Kind, Callable[[str, int], _Connection]] = {
    "bytes": _Bytes,
    "keys": _Keys,
    "handshakes": _Handshake,
    "groups": _SlowGroup,
    "displaced": _Displaced,
}


class RecordFlood:
    """Connections that are prepared at once, and flood the server in `run`."""

    def __init__(self, host: str, port: int, connections: int, kind: Kind) -> None:
        self._open = [KINDS[kind](host, port) for _ in range(connections)]

    def run(self) -> None:
        """Send until the process is killed."""
        while True:
            moved = False
            for one in self._open:
                try:
                    moved |= one.push()
                except OSError:
                    one.socket.close()
                    with suppress(OSError):
                        one.open()
            if not moved:
                reading = [one.socket for one in self._open if one.socket.fileno() >= 0]
                select.select(reading, [], [], 0.05)
