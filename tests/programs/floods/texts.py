"""Players who take all seats of real-time games and read the text of each.

With `declared`, each action has the longest thinking time, so that the steps of the whole game are
due at once. With `rematches`, sight is limited, and players open rematches of rematches of one game
as long as the server allows it. With `fast`, these rematches take sixty steps a second, and each
seat has a player of its own who acts and asks for snapshots. With `idle`, nobody acts in several
such games of a host.
"""

from __future__ import annotations

import select
import socket
import time
from contextlib import suppress
from typing import Literal

from tests.programs.floods.client import (
    CHUNK,
    ELSEWHERE,
    code_of_new_game,
    connect,
    join_all_seats,
    message,
    read_until,
)
from tests.programs.floods.rematches import all_rematches

__all__ = ["TextFlood", "TextFloodKind"]

TextFloodKind = Literal["declared", "rematches", "fast", "idle"]

SEATS = 4
LONGEST_MS = 86_400_000
GAME: dict[str, object] = {"task": "multi_agent/10", "seats": SEATS, "clock": "realtime"}
DECLARED = {**GAME, "thinking": "declared", "max_steps": 5000}
SIGHT = {
    **GAME,
    "step_rate": 20,
    "max_steps": 1_000_000,
    "absence": "end",
    "sight": 2,
    "sight_blocked": True,
}
FAST = {**SIGHT, "task": "shifts/06_rush_hour", "step_rate": 60, "sight": 4}
ACT_SECONDS, ACTS_PER_SNAPSHOT = 0.03, 4


class _DeclaredPlayer:
    """Player of one game after another, each in a connection of its own."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._received = b""
        self._connection = self._begun()

    def fileno(self) -> int:
        return self._connection.fileno()

    def push(self) -> None:
        """Read what is there; play again after the end."""
        # The last bytes before may contain the beginning of the type.
        self._received = self._received[-20:]
        with suppress(BlockingIOError):
            self._received += self._connection.recv(CHUNK)
        if b'"type":"ended"' in self._received:
            self._connection.close()
            self._received = b""
            self._connection = self._begun()

    def _begun(self) -> socket.socket:
        code = code_of_new_game(self._port, DECLARED)
        connection = connect(self._port, "eve", ELSEWHERE)
        join_all_seats(connection, code)
        for number in range(1, SEATS + 1):
            act = {"type": "act", "seq": 1, "action": None, "think_ms": LONGEST_MS}
            connection.sendall(message(**act, seat=f"robot{number}"))
        connection.setblocking(False)
        return connection


class _Reader:
    """Player who only reads."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        connection.setblocking(False)

    def fileno(self) -> int:
        return self._connection.fileno()

    def push(self) -> None:
        with suppress(BlockingIOError):
            self._connection.recv(CHUNK)


class _Actor(_Reader):
    """Player of one seat who acts, with some misspelt actions, and asks for snapshots."""

    def __init__(self, connection: socket.socket) -> None:
        super().__init__(connection)
        self._seq, self._next_at = 0, 0.0

    def push(self) -> None:
        super().push()
        if time.monotonic() < self._next_at:
            return
        self._next_at = time.monotonic() + ACT_SECONDS
        self._seq += 1
        name = f"Move robot{self._seq % SEATS + 1} from table1 to table{self._seq % 3 + 1}"
        data = message(type="act", seq=self._seq, action=name)
        if self._seq % ACTS_PER_SNAPSHOT == 0:
            data += message(type="resync")
        with suppress(BlockingIOError):
            self._connection.send(data)


def _readers(port: int, code: str) -> list[_Reader]:
    player = connect(port, "eve", ELSEWHERE)
    join_all_seats(player, code)
    return [_Reader(player)]


def _actors(port: int, code: str) -> list[_Reader]:
    players: list[_Reader] = []
    for number in range(SEATS):
        player = connect(port, f"eve {number}", ELSEWHERE)
        player.sendall(message(type="join", episode=code, view="both", partial=True))
        read_until(player, b'"joined"')
        players.append(_Actor(player))
    return players


class TextFlood:
    """Games whose players read the text of all seats."""

    def __init__(self, port: int, kind: TextFloodKind, games: int) -> None:
        self._players: list[_DeclaredPlayer] | list[_Reader]
        if kind == "declared":
            self._players = [_DeclaredPlayer(port) for _ in range(games)]
            return
        if kind == "idle":
            codes = [code_of_new_game(port, FAST) for _ in range(games)]
            self._players = [player for code in codes for player in _readers(port, code)]
            return
        rules, players = (FAST, _actors) if kind == "fast" else (SIGHT, _readers)
        codes = [code for _ in range(games) for code in all_rematches(port, rules)]
        self._players = [player for code in codes for player in players(port, code)]

    def run(self) -> None:
        """Flood the server until the process is killed."""
        while True:
            select.select(self._players, [], [], ACT_SECONDS)
            for player in self._players:
                player.push()
