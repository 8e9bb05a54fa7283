"""Players who end their games at once and ask for rematches, as fast as the server answers.

Each rematch opens a room and a recording, and the ended rooms stay for the grace of the game.
"""

from __future__ import annotations

import select
import time
from contextlib import suppress

from tests.programs.flood_client import CHUNK, connect, message, read_until, text_after

__all__ = ["RematchFlood", "RematchPlayer"]

ELSEWHERE = "X-Forwarded-For: 203.0.113.9\r\n"
"""Header of a proxy, so that the server treats the connection as a player's, not a host's."""
RETRY_SECONDS = 0.11
"""Time after which a refused request is repeated: less often than the limit of messages allows."""
GAME = {
    "type": "create",
    "task": "synchronous/01",
    "clock": "lockstep",
    "absence": "end",
    "grace": 3600,
}


class RematchPlayer:
    """Player of a game for one who ends it, and then its rematches.

    Attributes:
        code: The code of the first game. All requests name it, so its spectators receive all codes.
    """

    def __init__(self, port: int, name: str) -> None:
        host = connect(port, f"host of {name}")
        host.sendall(message(**GAME))
        self.code = text_after(read_until(host, b'"created"'), "code")
        host.close()
        self._connection = connect(port, name, ELSEWHERE)
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
            self._play(text_after(self._received.split(b'"type":"created"')[1], "code"))
        elif b'"type":"left"' in self._received:
            self._ask()
        elif b'"type":"error"' in self._received and not self._pause_until:
            self._pause_until = time.monotonic() + RETRY_SECONDS

    def _ask(self) -> None:
        self._received, self._pause_until = b"", 0.0
        self._connection.send(message(type="create", rematch=self.code))

    def _play(self, code: str) -> None:
        self._received = b""
        self._connection.send(message(type="join", episode=code) + message(type="leave"))


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
