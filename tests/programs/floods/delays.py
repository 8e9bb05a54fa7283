"""Players of delayed seats who act as fast as the server reads.

The server holds the actions of such a seat back, and evaluates all that are due at the same time.
"""

from __future__ import annotations

import select
import time
from contextlib import suppress

from tests.programs.floods.client import CHUNK, connect, message, read_until, text_after

__all__ = ["DelayFlood"]

SEATS = 4
DELAY_MS = 1000
"""Delay with which as many actions wait as may wait."""
BURST = 64
"""Actions that are sent together, so that they are due together."""
ACTS_A_SECOND = 190.0
"""Slightly less than the server's limit: above it, a player would be disconnected."""
GAME = {
    "type": "create",
    "task": "multi_agent/10",
    "seats": SEATS,
    "clock": "lockstep",
    "max_steps": 1_000_000,
    "move_budget": 0,
    "treatments": {f"robot{number}": {"delay_ms": DELAY_MS} for number in range(1, SEATS + 1)},
}


class _DelayedPlayer:
    """Player who sends bursts of actions. The server rejects most of them when they are due."""

    def __init__(self, port: int, name: str, code: str) -> None:
        self._connection = connect(port, name)
        self._connection.sendall(message(type="join", episode=code))
        joined = read_until(self._connection, b'"roster"')
        self._player = text_after(joined, "seat")
        self._seq = 0
        self._unsent = b""
        self._next = time.monotonic()

    def start(self) -> None:
        """Send and receive without waiting from now on."""
        self._connection.setblocking(False)

    def push(self) -> None:
        """Read what is there, and send what is due."""
        with suppress(BlockingIOError):
            self._connection.recv(CHUNK)
        if not self._unsent and time.monotonic() >= self._next:
            self._next += BURST / ACTS_A_SECOND
            self._unsent = b"".join(self._act() for _ in range(BURST))
        with suppress(BlockingIOError):
            self._unsent = self._unsent[self._connection.send(self._unsent) :]

    def _act(self) -> bytes:
        self._seq += 1
        # Most are rejected: nobody stands there. The last action of a burst lets the step pass.
        walk = {"name": "move", "args": [self._player, "table1", "table2"]}
        action = walk if self._seq % BURST else None
        return message(type="act", seq=self._seq, action=action, reasoning="x" * 100)

    def fileno(self) -> int:
        return self._connection.fileno()


class DelayFlood:
    """Games in which all seats are delayed."""

    def __init__(self, port: int, players: int) -> None:
        self._players: list[_DelayedPlayer] = []
        for number in range(0, players, SEATS):
            host = connect(port, f"host {number}")
            host.sendall(message(**GAME))
            code = text_after(read_until(host, b'"created"'), "code")
            host.close()
            names = [f"eve {number} {seat}" for seat in range(SEATS)]
            self._players += [_DelayedPlayer(port, name, code) for name in names]

    def run(self) -> None:
        """Flood the server until the process is killed."""
        for player in self._players:
            player.start()
        while True:
            select.select(self._players, [], [], 0.01)
            for player in self._players:
                player.push()
