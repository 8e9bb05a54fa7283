"""Game of two honest players on a server that is flooded."""

from __future__ import annotations

import json
import ssl
import time
from contextlib import ExitStack, suppress

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.support.server_process import ServerProcess

__all__ = ["HELLO", "SUBPROTOCOL", "HonestGame"]

SUBPROTOCOL = Subprotocol("robotouille.v1.json")
HELLO: dict[str, object] = {"type": "hello", "protocol": 1, "name": "eve", "kind": "bot"}


class HonestGame:
    """Two players in real time who measure the gaps between deltas, on a server with `rooms` other
    waiting episodes. `tls` is for the connections, if the server uses TLS.
    """

    def __init__(
        self, server: ServerProcess, rooms: int, tls: ssl.SSLContext | None = None
    ) -> None:
        self._tls = tls
        self._open = ExitStack()
        for number in range(rooms):
            if number % 30 == 0:
                host = self._player(server, f"host {number}")
            self._ask(host, {"type": "create", "task": "multi_agent/01"}, "created")
        self._players = [self._player(server, f"player {i}") for i in (1, 2)]
        order = {"type": "create", "clock": "realtime", "step_rate": 20}
        created = self._ask(self._players[0], order, "created")
        self.code = str(created["code"])
        for player in self._players:
            self._ask(player, {"type": "join", "episode": self.code}, "joined")

    def _player(self, server: ServerProcess, name: str) -> ClientConnection:
        player = self._open.enter_context(
            connect(
                server.url,
                subprotocols=[SUBPROTOCOL],
                compression=None,
                ssl=self._tls,
                # No one reads between two runs, so the client would miss the answers to its pings.
                ping_interval=None,
            )
        )
        self._ask(player, {**HELLO, "name": name}, "welcome")
        return player

    @staticmethod
    def _ask(player: ClientConnection, message: dict[str, object], kind: str) -> dict[str, object]:
        player.send(json.dumps(message))
        while True:
            answer: dict[str, object] = json.loads(player.recv(timeout=20))
            if answer["type"] == kind:
                return answer
            assert answer["type"] != "error", answer

    def longest_gap(self, seconds: float) -> float:
        """Return the longest gap between two deltas, in seconds."""
        end = time.monotonic() + seconds
        last, longest = time.monotonic(), 0.0
        while time.monotonic() < end:
            for player in self._players[1:]:
                with suppress(TimeoutError):
                    while player.recv(timeout=0):
                        pass
            answer = json.loads(self._players[0].recv(timeout=60))
            if answer["type"] == "delta":
                now = time.monotonic()
                last, longest = now, max(longest, now - last)
        return longest

    def close(self) -> None:
        self._open.close()
