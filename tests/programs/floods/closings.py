"""Games with long recordings that all end at once.

At its end, a recording is checked, compressed and moved to its place, which takes far longer than
any message to which a server replies.
"""

from __future__ import annotations

import socket
import time
from contextlib import suppress

from tests.programs.floods.client import CHUNK, ELSEWHERE, connect, message, read_until
from tests.programs.floods.rematches import all_rematches
from tests.support.fuzzing.wire import PONG, frame

__all__ = ["ClosingFlood"]

SEATS = 4
GAME: dict[str, object] = {
    "task": "multi_agent/10",
    "seats": SEATS,
    "clock": "lockstep",
    "absence": "end",
}
FILL_SECONDS = 20.0
NOTES_A_SECOND = 175
"""Slightly less than the server's limit for messages of a connection."""
NOTE = message(type="note", topic="a", text="b")


class ClosingFlood:
    """Players of several rematches of one game, who have filled its recordings with notes."""

    def __init__(self, port: int, games: int) -> None:
        codes = all_rematches(port, GAME)[:games]
        self._players = [_player(port, code, seat) for code in codes for seat in range(SEATS)]
        begun, sent = time.monotonic(), 0
        while (passed := time.monotonic() - begun) < FILL_SECONDS:
            due = int(passed * NOTES_A_SECOND)
            for player in self._players:
                _send_notes(player, due - sent)
            sent = due
            time.sleep(0.02)

    def run(self) -> None:
        """End all games at once, and wait until the process is killed."""
        for player in self._players:
            with suppress(OSError):
                player.setblocking(True)
                player.sendall(message(type="leave"))
        time.sleep(3600)


def _player(port: int, code: str, seat: int) -> socket.socket:
    player = connect(port, f"eve {seat}", ELSEWHERE)
    player.sendall(message(type="join", episode=code, view="text", seat=f"robot{seat + 1}"))
    read_until(player, b'"joined"')
    player.setblocking(False)
    return player


def _send_notes(player: socket.socket, count: int) -> None:
    # A note is sent as a whole or not at all, in practice.
    with suppress(BlockingIOError):
        for _ in range(count):
            player.send(NOTE)
    with suppress(BlockingIOError):
        # The server closes connections without pongs.
        _, ping, payload = player.recv(CHUNK).partition(b"\x89\x04")
        if ping:
            player.sendall(frame(payload[:4], PONG))
