"""Rooms full of spectators, whose players act and chat as fast as the server reads.

What a player sends in such a room is sent on to hundreds of spectators, so it costs the server far
more than it costs the player.
"""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Sequence
from contextlib import suppress

from tests.programs.floods.client import CHUNK, connect, message, read_until, text_after
from tests.programs.floods.rematches import RematchPlayer

__all__ = ["AudienceFlood"]

SPECTATORS = 200
MESSAGES_A_SECOND = 190.0
"""Slightly less than the server's limit: above it, a player would be disconnected."""
RESYNCS_A_SECOND = 20.0
"""Slightly less than the server's limit for messages with so long an answer."""
MIXED_A_SECOND, SAY_EVERY, RESYNC_EVERY = 100.0, 50, 20
"""Rate of messages that contain as much chat as a player may send, five requests for snapshots a
second, and actions."""


def _room(port: int, name: str, task: str, view: str) -> tuple[list[socket.socket], int]:
    """Return the connections of a room, and how many of them play. Players come first."""
    host = connect(port, name)
    host.sendall(message(type="create", task=task, clock="lockstep", max_steps=1_000_000))
    code = text_after(read_until(host, b'"created"'), "code")
    players = [host]
    host.sendall(message(type="join", episode=code, view=view))
    joined = read_until(host, b'"roster"')
    for number in range(2, 1 + joined.split(b'"roster"')[-1].count(b'"player":')):
        players.append(connect(port, f"{name} {number}"))
        players[-1].sendall(message(type="join", episode=code, view=view))
        read_until(players[-1], b'"roster"')
    return players + _spectators(port, name, code, view), len(players)


def _spectators(port: int, name: str, code: str, view: str) -> list[socket.socket]:
    watch = message(type="join", episode=code, role="spectator", view=view)
    spectators = [connect(port, f"{name} w{i}") for i in range(SPECTATORS)]
    for spectator in spectators:
        spectator.sendall(watch)
    return spectators


class _Sender:
    """Player that acts, chats or does everything, or spectator that asks for snapshots.

    It sends as fast as it may.
    """

    def __init__(self, connection: socket.socket, kind: str) -> None:
        self._connection = connection
        self._kind = kind
        rates = {"resync": RESYNCS_A_SECOND, "mixed": MIXED_A_SECOND}
        self._rate = rates.get(kind, MESSAGES_A_SECOND)
        self._seq = 0
        self._began = time.monotonic()

    def push(self) -> None:
        """Send what is due."""
        due = int((time.monotonic() - self._began) * self._rate)
        if self._seq == 0:
            self._began, due = time.monotonic(), 1
        # Short messages are sent as a whole or not at all, in practice.
        with suppress(BlockingIOError):
            while self._seq < due:
                self._seq += 1
                self._connection.send(self._message())

    def _message(self) -> bytes:
        mixed = self._kind == "mixed"
        if self._kind == "say" or (mixed and self._seq % SAY_EVERY == 0):
            return message(type="say", text="x")
        if self._kind == "resync" or (mixed and self._seq % RESYNC_EVERY == 1):
            return message(type="resync")
        return message(type="act", seq=self._seq, action=None)


class AudienceFlood:
    """Rooms full of spectators, ready to be flooded.

    Args:
        port: The port of the server.
        rooms: The task and the view of each room.
        players: The messages of the players: `act`, `say`, or `mixed` for everything.
        resyncs: True if the spectators ask for snapshots.
        rematches: True for one more room full of spectators, whose player asks for rematches.
    """

    def __init__(
        self,
        port: int,
        rooms: Sequence[tuple[str, str]],
        *,
        players: str,
        resyncs: bool = False,
        rematches: bool = False,
    ) -> None:
        self._senders: list[_Sender] = []
        self._again = RematchPlayer(port, "eve again") if rematches else None
        self._connections: dict[int, socket.socket] = {}
        for number, (task, view) in enumerate(rooms):
            members, playing = _room(port, f"eve {number}", task, view)
            self._senders += [_Sender(one, players) for one in members[:playing]]
            if resyncs:
                self._senders += [_Sender(one, "resync") for one in members[playing:]]
            self._connections |= {one.fileno(): one for one in members}
        if self._again is not None:
            watching = _spectators(port, "eve again", self._again.code, "both")
            self._connections |= {one.fileno(): one for one in watching}

    def run(self) -> None:
        """Flood the server until the process is killed."""
        poll = select.epoll()
        for number, connection in self._connections.items():
            connection.setblocking(False)
            poll.register(number, select.EPOLLIN)
        if self._again is not None:
            self._again.start()
        while True:
            if self._again is not None:
                self._again.push()
            for sender in self._senders:
                sender.push()
            for number, _ in poll.poll(0.01):
                with suppress(BlockingIOError):
                    if not self._connections[number].recv(CHUNK):
                        poll.unregister(number)
