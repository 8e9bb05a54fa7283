"""Spectators that reset their connections all at once and resume their sessions, again and again.

A resumed spectator costs the server a handshake, a check of a signed token and a snapshot. Clients
behind one failing router come back at the same time, so honest ones do the same.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from contextlib import suppress

from tests.support.fuzzing.wire import TEXT, frame, request

__all__ = ["ResumeStorm"]

SUBPROTOCOL = "robotouille.v1.json"
CHUNK = 256 * 1024
BURST_SECONDS = 2.0
"""Time after which the spectators of a burst that have no answer are reset, too."""
RESUME, SNAPSHOT = b'"resume":"', b'"snapshot"'


class _Spectator:
    """One spectator, which keeps the resume token of its latest connection."""

    def __init__(self, port: int, code: str, number: int) -> None:
        self._address = ("127.0.0.1", port)
        self._hello = {"type": "hello", "protocol": 1, "name": f"eve {number}", "kind": "bot"}
        self._join = {"type": "join", "episode": code, "role": "spectator"}
        self._token = ""
        self._received = b""
        self.socket: socket.socket | None = None

    def come(self) -> None:
        """Connect, and resume the session or join the episode."""
        joins = frame(json.dumps(self._join).encode(), TEXT) if not self._token else b""
        hello = {**self._hello, "resume": self._token} if self._token else self._hello
        self._received = b""
        with suppress(OSError):
            self.socket = socket.create_connection(self._address, timeout=2)
            first = frame(json.dumps(hello).encode(), TEXT)
            self.socket.sendall(request(SUBPROTOCOL) + first + joins)
            self.socket.setblocking(False)

    def read(self) -> bool:
        """Read what has come, and return whether the spectator watches or was refused."""
        assert self.socket is not None
        try:
            found = self.socket.recv(CHUNK)
        except BlockingIOError:
            return False
        except OSError:
            found = b""
        self._received += found
        if not found:
            self._token = ""  # Refused, for example because the token has expired.
        return not found or SNAPSHOT in self._received

    def vanish(self) -> None:
        """Keep the token, and reset the connection."""
        if RESUME in self._received:
            self._token = self._received.split(RESUME)[-1].split(b'"')[0].decode()
        if self.socket is not None:
            linger = struct.pack("ii", 1, 0)
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            self.socket.close()
            self.socket = None


class ResumeStorm:
    """Spectators of one episode, ready to vanish and come back in bursts.

    Args:
        port: The port of the server.
        code: The episode's code.
    """

    def __init__(self, port: int, code: str, spectators: int) -> None:
        self._spectators = [_Spectator(port, code, number) for number in range(spectators)]

    def run(self) -> None:
        """Flood the server until the process is killed."""
        while True:
            self.burst()

    def burst(self) -> None:
        """Let all spectators come, wait until they watch, and let all vanish at once."""
        for spectator in self._spectators:
            spectator.come()
        waiting = [each for each in self._spectators if each.socket is not None]
        end = time.monotonic() + BURST_SECONDS
        while waiting and time.monotonic() < end:
            # `select` has no room for more than 1,024 descriptors, which is enough.
            sockets = [each.socket for each in waiting if each.socket is not None]
            ready = select.select(sockets, [], [], 0.05)[0]
            waiting = [each for each in waiting if each.socket not in ready or not each.read()]
        for spectator in self._spectators:
            spectator.vanish()
