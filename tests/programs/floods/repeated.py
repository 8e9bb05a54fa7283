"""Connections that repeat a message as fast as the server reads, or that stay silent."""

from __future__ import annotations

import select
import socket
import struct
import time
from contextlib import suppress
from typing import Literal

from tests.programs.floods.client import ELSEWHERE, message
from tests.programs.floods.honest_game import HELLO, SUBPROTOCOL
from tests.support.fuzzing.wire import request

__all__ = ["Repeated", "Silence", "get", "handshake", "watching"]

BLOB = 256 * 1024
HURRY = 0.04

End = Literal["never", "answered", "hurried"]
"""When a connection is reset: once its first messages are answered, or closed after 40 ms."""


def get(page: str) -> bytes:
    """Return a request for a page."""
    return f"GET {page} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()


def handshake(
    *messages: dict[str, object], subprotocol: str = SUBPROTOCOL, elsewhere: bool = False
) -> bytes:
    """Return the upgrade request of a client, with its first messages.

    With `elsewhere`, the client is remote to the server.
    """
    upgrade = request(subprotocol, more=ELSEWHERE if elsewhere else "")
    return upgrade + b"".join(message(**each) for each in messages)


def watching(code: str) -> tuple[dict[str, object], dict[str, object]]:
    """Return the first messages of a spectator."""
    return HELLO, {"type": "join", "episode": code, "role": "spectator"}


class Repeated:
    """Connections that repeat a piece, and reconnect whenever they are closed.

    Args:
        opening: The first bytes of each connection.
        piece: The bytes that are repeated.
        reads: True to read the answers.
        ends: The time at which a connection is ended and opened again.
    """

    def __init__(
        self,
        port: int,
        opening: bytes,
        piece: bytes = b"",
        *,
        connections: int = 4,
        reads: bool = True,
        ends: End = "never",
    ) -> None:
        # Each piece is repeated up to the size of one read.
        blob = piece * max(1, BLOB // max(1, len(piece)))
        self._reads, self._hurries = reads, ends == "hurried"
        self._connections = [
            _Connection(port, opening, blob, reads=reads, ends=ends) for _ in range(connections)
        ]

    def run(self) -> None:
        """Flood the server until the process is killed."""
        while True:
            if self._hurries:
                # All at once: the server accepts sockets faster than it answers them.
                for each in self._connections:
                    each.push()
                time.sleep(0.001)
                continue
            if any(each.push() for each in self._connections):
                continue
            waiting = [each for each in self._connections if each.fileno() >= 0]
            reading = waiting if self._reads else []
            writing = [each for each in waiting if each.sends]
            select.select(reading, writing, [], 0.05)


class _Connection:
    """One connection of a flood."""

    def __init__(self, port: int, opening: bytes, blob: bytes, *, reads: bool, ends: End) -> None:
        self._address = ("127.0.0.1", port)
        self._opening, self._blob = opening, blob
        self._reads, self._ends = reads, ends
        self._socket: socket.socket | None = None
        self._unsent = memoryview(b"")
        self._opened = 0.0

    def push(self) -> bool:
        """Send and read what is possible; return False if neither was."""
        if self._socket is None and not self._open():
            return False
        assert self._socket is not None
        try:
            if self._ends != "never" and not self._unsent:
                return self._end()
            done = self._read() if self._reads else False
            self._unsent = self._unsent or memoryview(self._blob)
            sent = self._socket.send(self._unsent)
            self._unsent = self._unsent[sent:]
            return sent > 0 or done
        except BlockingIOError:
            return False
        except OSError:
            self._socket.close()
            self._socket = None
            return False

    def _end(self) -> bool:
        """Reset the connection once the server has answered, or close it after a while."""
        assert self._socket is not None
        if self._ends == "hurried":
            if time.monotonic() < self._opened + HURRY:
                raise BlockingIOError
            raise ConnectionResetError
        if not self._socket.recv(BLOB):
            raise ConnectionResetError
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        raise ConnectionResetError

    def _open(self) -> bool:
        try:
            self._socket = socket.create_connection(self._address, timeout=2)
        except OSError:
            return False
        self._socket.setblocking(False)
        self._unsent = memoryview(self._opening)
        self._opened = time.monotonic()
        return True

    def _read(self) -> bool:
        assert self._socket is not None
        with suppress(BlockingIOError):
            if not self._socket.recv(BLOB):
                raise ConnectionResetError
            return True
        return False

    @property
    def sends(self) -> bool:
        """True if there is something to send."""
        return bool(self._unsent or self._blob)

    def fileno(self) -> int:
        return self._socket.fileno() if self._socket is not None else -1


class Silence:
    """Connections that send nothing after their opening and are opened again when closed."""

    def __init__(self, port: int, connections: int, opening: bytes = b"") -> None:
        self._port, self._count, self._opening = port, connections, opening

    def run(self) -> None:
        """Keep the connections open until the process is killed."""
        held: list[socket.socket] = []
        while True:
            while len(held) < self._count:
                with suppress(OSError):
                    held.append(socket.create_connection(("127.0.0.1", self._port), timeout=1))
                    held[-1].sendall(self._opening)
                    held[-1].setblocking(False)
                    continue
                time.sleep(0.05)
            time.sleep(0.2)
            held = [one for one in held if not _is_closed(one)]


def _is_closed(held: socket.socket) -> bool:
    try:
        over = not held.recv(BLOB)
    except BlockingIOError:
        return False
    except OSError:
        over = True
    if over:
        held.close()
    return over
