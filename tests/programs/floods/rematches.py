"""Players who end their games at once and ask for rematches, as fast as the server answers.

Each rematch opens a room and a recording, and the ended rooms stay for the grace of the game.
"""

from __future__ import annotations

import select
import socket
import time
from contextlib import suppress

from tests.programs.floods.client import (
    CHUNK,
    ELSEWHERE,
    code_of_new_game,
    connect,
    join_all_seats,
    message,
    read_until,
    text_after,
)

__all__ = ["RematchFlood", "RematchPlayer", "all_rematches"]

ROUNDS = 3
"""Rounds in which each ended game is played again. Each round could double their number."""
RETRY_SECONDS = 0.11
"""Time after which a refused request is repeated: less often than the limit of messages allows."""
GAME: dict[str, object] = {
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
        self.code = code_of_new_game(port, GAME)
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


def all_rematches(port: int, rules: dict[str, object]) -> list[str]:
    """Return the codes of all rematches that the server allows of one new game."""
    code = code_of_new_game(port, rules)
    ended = [(code, _leave_at_once(port, code))]
    codes: list[str] = []
    for number in range(ROUNDS + 1):
        for code, asker in list(ended):
            # The second request is always refused, the first one only at the server's limit.
            asker.sendall(message(type="create", rematch=code) + message(type="resync"))
            answer = read_until(asker, b'"error"')
            if b'"created"' not in answer:
                continue
            again = text_after(answer.split(b'"created"')[1], "code")
            if number < ROUNDS:
                ended.append((again, _leave_at_once(port, again)))
            else:
                codes.append(again)
    return codes


def _leave_at_once(port: int, code: str) -> socket.socket:
    """End a game by leaving all its seats; return the connection of its player."""
    player = connect(port, "eve", ELSEWHERE)
    join_all_seats(player, code)
    player.sendall(message(type="leave"))
    read_until(player, b'"type":"left"')
    return player
