"""Hosts who open games and close them at once, as fast as the server answers."""

from __future__ import annotations

import select
from contextlib import suppress

from tests.programs.floods.client import CHUNK, connect, message, text_after

__all__ = ["OpeningFlood"]

GAME = {"type": "create", "task": "multi_agent/01", "clock": "lockstep"}


class _Host:
    """Host with one game at a time."""

    def __init__(self, port: int, name: str) -> None:
        self._connection = connect(port, name)
        self._connection.setblocking(False)
        self._received = b""

    def fileno(self) -> int:
        return self._connection.fileno()

    def open(self) -> None:
        """Open a game."""
        self._received = b""
        self._connection.send(message(**GAME))

    def push(self) -> None:
        """Close the game that the server has opened, or open another one."""
        with suppress(BlockingIOError):
            self._received += self._connection.recv(CHUNK)
        if b'"created"' in self._received:
            episode = text_after(self._received, "episode")
            self._received = b""
            self._connection.send(message(type="close", episode=episode))
        elif b'"closed"' in self._received or b'"error"' in self._received:
            self.open()


class OpeningFlood:
    """Hosts with a connection each."""

    def __init__(self, port: int, hosts: int) -> None:
        self._hosts = [_Host(port, f"host {number}") for number in range(hosts)]

    def run(self) -> None:
        """Flood the server until the process is killed."""
        for host in self._hosts:
            host.open()
        while True:
            for host in select.select(self._hosts, [], [])[0]:
                host.push()
