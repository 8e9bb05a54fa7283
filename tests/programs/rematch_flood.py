"""Players who end their games at once and ask for rematches, as fast as the server answers.

Each rematch opens a room and a recording, and the ended rooms stay for the grace of the game.
"""

from __future__ import annotations

import json
import select
import socket
import time
from contextlib import suppress

from tests.support.fuzzing.wire import TEXT, frame, request

__all__ = ["RematchFlood", "RematchPlayer"]

SUBPROTOCOL = "robotouille.v1.json"
ELSEWHERE = "X-Forwarded-For: 203.0.113.9\r\n"
"""Header of a proxy, so that the server treats the connection as a player's, not a host's."""
CHUNK = 1024 * 1024
RETRY_SECONDS = 0.11
"""Time after which a refused request is repeated: less often than the limit of messages allows."""
GAME = {
    "type": "create",
    "task": "synchronous/01",
    "clock": "lockstep",
    "absence": "end",
    "grace": 3600,
}


def _message(**fields: object) -> bytes:
    return frame(json.dumps(fields).encode(), TEXT)


def _connect(port: int, name: str, more: str = "") -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), timeout=20)
    hello = _message(type="hello", protocol=1, name=name, kind="bot")
    connection.sendall(request(SUBPROTOCOL, more=more) + hello)
    _answer(connection, b'"welcome"')
    return connection


def _answer(connection: socket.socket, mark: bytes) -> bytes:
    data = b""
    while mark not in data:
        data += connection.recv(CHUNK)
    return data


def _code_in(data: bytes) -> str:
    return data.split(b'"code":"')[1].split(b'"')[0].decode()


class RematchPlayer:
    """Player of a game for one who ends it, and then its rematches.

    Attributes:
        code: The code of the first game. All requests name it, so its spectators receive all codes.
    """

    def __init__(self, port: int, name: str) -> None:
        host = _connect(port, f"host of {name}")
        host.sendall(frame(json.dumps(GAME).encode(), TEXT))
        self.code = _code_in(_answer(host, b'"created"'))
        host.close()
        self._connection = _connect(port, name, ELSEWHERE)
        self._received = b""
        self._pause_until = 0.0

    def start(self) -> None:
        """End the first game."""
        self._connection.setblocking(False)
        self._play(self.code)

    def fileno(self) -> int:
        return self._connection.fileno()

    def push(self) -> None:
        """Read what is there, and send what is due."""
        with suppress(BlockingIOError):
            self._received += self._connection.recv(CHUNK)
        if self._pause_until and time.monotonic() >= self._pause_until:
            self._ask()
        elif b'"type":"created"' in self._received:
            self._play(_code_in(self._received.split(b'"type":"created"')[1]))
        elif b'"type":"left"' in self._received:
            self._ask()
        elif b'"type":"error"' in self._received and not self._pause_until:
            self._pause_until = time.monotonic() + RETRY_SECONDS

    def _ask(self) -> None:
        self._received, self._pause_until = b"", 0.0
        self._connection.send(_message(type="create", rematch=self.code))

    def _play(self, code: str) -> None:
        self._received = b""
        self._connection.send(_message(type="join", episode=code) + _message(type="leave"))


class RematchFlood:
    """Players in games of their own."""

    def __init__(self, port: int, players: int) -> None:
        self._players = [RematchPlayer(port, f"eve {number}") for number in range(players)]

    def run(self) -> None:
        """Flood the server until the process is killed."""
        for player in self._players:
            player.start()
        while True:
            select.select(self._players, [], [], RETRY_SECONDS / 2)
            for player in self._players:
                player.push()
