"""Connections over TLS that send each byte in a record of its own.

A record of one byte has 23 bytes on the wire. The server spends a decryption and a call on it, as
on a record of 16 KiB. One read of the server takes thousands of these records.
"""

from __future__ import annotations

import json
import select
import socket
import ssl
from collections.abc import Iterator
from contextlib import suppress
from itertools import cycle

from tests.programs.honest_game import HELLO, SUBPROTOCOL
from tests.support.fuzzing.wire import TEXT, frame, request

__all__ = ["RecordFlood"]

AT_FIRST, AT_ONCE = 6_000, 2_000
"""Records that a connection prepares before the flood, and later for each write."""
CHUNK = 256 * 1024
MESSAGE = b" " * 60_000
"""Message that is still incomplete after the records prepared before the flood."""


class _Connection:
    """Encrypted connection that sends one long message after the other."""

    def __init__(self, port: int) -> None:
        self._received, self._encrypted = ssl.MemoryBIO(), ssl.MemoryBIO()
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        self._tls = context.wrap_bio(self._received, self._encrypted)
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self._shake_hands()
        self._tls.write(request(SUBPROTOCOL))
        self._read_until(b"\r\n\r\n")
        self._tls.write(frame(json.dumps(HELLO).encode(), TEXT))
        self._read_until(b'"welcome"')
        self.socket.setblocking(False)
        self._plain: Iterator[int] = cycle(frame(MESSAGE, TEXT))
        self._unsent = memoryview(self._records(AT_FIRST))

    def push(self) -> bool:
        """Send what is possible; return False if nothing was.

        Raises:
            OSError: The connection is closed.
        """
        with suppress(BlockingIOError):
            if not self.socket.recv(CHUNK):
                raise ConnectionResetError
        with suppress(BlockingIOError):
            self._unsent = self._unsent or memoryview(self._records(AT_ONCE))
            sent = self.socket.send(self._unsent)
            self._unsent = self._unsent[sent:]
            return True
        return False

    def _records(self, count: int) -> bytes:
        for _ in range(count):
            self._tls.write(bytes((next(self._plain),)))
        return self._encrypted.read()

    def _shake_hands(self) -> None:
        while True:
            try:
                return self._tls.do_handshake()
            except ssl.SSLWantReadError:
                self._exchange()

    def _read_until(self, mark: bytes) -> None:
        data = b""
        while mark not in data:
            try:
                data += self._tls.read(CHUNK)
            except ssl.SSLWantReadError:
                self._exchange()

    def _exchange(self) -> None:
        self.socket.sendall(self._encrypted.read())
        data = self.socket.recv(CHUNK)
        if not data:
            raise ConnectionResetError
        self._received.write(data)


class RecordFlood:
    """Connections that are prepared at once, and flood the server in `run`."""

    def __init__(self, port: int, connections: int) -> None:
        self._port = port
        self._open = [_Connection(port) for _ in range(connections)]

    def run(self) -> None:
        """Send until the process is killed."""
        while True:
            moved = False
            for number, one in enumerate(self._open):
                try:
                    moved |= one.push()
                except OSError:
                    one.socket.close()
                    self._open[number] = _Connection(self._port)
            if not moved:
                select.select([], [one.socket for one in self._open], [], 0.05)
