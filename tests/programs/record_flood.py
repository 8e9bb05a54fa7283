"""Floods over TLS: tiny records, changes of keys, and handshakes.

A record of 23 bytes can contain one byte, or a request to change the keys (RFC 8446, section
4.6.3). The server spends a decryption on it, as on a record of 16 KiB, or an answer with new keys.
A handshake costs the server a signature, which takes milliseconds with an RSA key.
"""

from __future__ import annotations

import hmac
import json
import select
import socket
import ssl
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Literal

from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from tests.programs.honest_game import HELLO, SUBPROTOCOL
from tests.support.fuzzing.wire import TEXT, frame, request

__all__ = ["Kind", "RecordFlood"]

Kind = Literal["bytes", "keys", "handshakes"]
AT_FIRST, AT_ONCE = 6_000, 2_000
"""Records that a connection prepares before the flood, and later for each write."""
CHUNK = 256 * 1024
MESSAGE = b" " * 60_000
"""Message that is still incomplete after the records prepared before the flood."""
CIPHER, HASH, KEY_BYTES, IV_BYTES = "TLS_AES_256_GCM_SHA384", "sha384", 32, 12
KEY_UPDATE = bytes.fromhex("180000010116")
"""Message that changes the sender's keys and requests the same, with its type."""


class _Connection:
    """Encrypted connection that sends what a subclass prepares."""

    def __init__(self, port: int) -> None:
        self._received, self._encrypted = ssl.MemoryBIO(), ssl.MemoryBIO()
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        self.context.check_hostname, self.context.verify_mode = False, ssl.CERT_NONE
        self._address = ("127.0.0.1", port)
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
        self.context.minimum_version = ssl.TLSVersion.TLSv1_3
        with tempfile.NamedTemporaryFile() as log:
            self.context.keylog_filename = log.name
            super()._shake_hands()
            lines = [line.split() for line in Path(log.name).read_text().splitlines()]
        assert CIPHER in (self.tls.cipher() or ())
        self._secret = next(
            bytes.fromhex(line[2]) for line in lines if line[0] == "CLIENT_TRAFFIC_SECRET_0"
        )

    def records(self, count: int) -> bytes:
        return b"".join(self._record() for _ in range(count))

    def _record(self) -> bytes:
        key, iv = self._expand(b"key", KEY_BYTES), self._expand(b"iv", IV_BYTES)
        self._secret = self._expand(b"traffic upd", len(self._secret))
        # Each key encrypts one record only, so the sequence number in the nonce is 0.
        head = b"\x17\x03\x03" + (len(KEY_UPDATE) + 16).to_bytes(2, "big")
        return head + AESGCM(key).encrypt(iv, KEY_UPDATE, head)

    def _expand(self, label: bytes, size: int) -> bytes:
        # HKDF-Expand-Label of RFC 8446, section 7.1. All results fit into one block.
        label = b"tls13 " + label
        info = size.to_bytes(2, "big") + bytes((len(label),)) + label + b"\0\1"
        return hmac.digest(self._secret, info, HASH)[:size]


class _Handshake(_Connection):
    """Stranger that begins one handshake after the other."""

    def open(self) -> None:
        self.socket = socket.create_connection(self._address, timeout=20)
        self.socket.setblocking(False)
        with suppress(ssl.SSLWantReadError):
            self.context.wrap_bio(self._received, self._encrypted).do_handshake()
        self.socket.send(self._encrypted.read())

    def push(self) -> bool:
        """Start again as soon as the server has signed."""
        with suppress(BlockingIOError):
            self.socket.recv(CHUNK)
            self.socket.close()
            self.open()
            return True
        return False


KINDS: dict[Kind, Callable[[int], _Connection]] = {
    "bytes": _Bytes,
    "keys": _Keys,
    "handshakes": _Handshake,
}


class RecordFlood:
    """Connections that are prepared at once, and flood the server in `run`."""

    def __init__(self, port: int, connections: int, kind: Kind) -> None:
        self._open = [KINDS[kind](port) for _ in range(connections)]

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
