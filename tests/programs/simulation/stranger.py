"""A client that plays nothing and sends far more than the limits allow."""

from __future__ import annotations

import asyncio
import json
import random

from tests.programs.simulation.loop import Process, SimulatedLoop
from tests.support.fuzzing.wire import CONTINUATION, PING, PONG, TEXT, frame, request

__all__ = ["FLOODS", "Stranger"]

HELLO = {"type": "hello", "protocol": 1, "name": "eve", "kind": "bot"}
CODE = "AAAAA-AAAAA"
"""Placeholder for an episode's code."""
WATCH = {"type": "join", "episode": CODE, "role": "spectator"}
STAYS = 8.0
"""Seconds after which a stranger leaves if the server has not disconnected it."""


def _message(message: dict[str, object]) -> bytes:
    return frame(json.dumps(message).encode(), TEXT)


_FIELDS = _message({"type": "hello", **{f"{i:x}": 0 for i in range(900)}})
_PARTS = frame(b"", CONTINUATION, fin=False) * 250

FLOODS = {
    "pings": frame(b"", PING) * 1000,
    "pongs": _message(HELLO) + frame(b"", PONG) * 1000,
    "parts": _message(HELLO) + frame(b"", TEXT, fin=False) + _PARTS,
    "fields": _FIELDS * 200,
    "lists": _message(HELLO) + _message({"type": "list"}) * 500,
    "resyncs": _message(HELLO) + _message(WATCH) + _message({"type": "resync"}) * 500,
    "in and out": _message(HELLO) + (_message(WATCH) + _message({"type": "leave"})) * 300,
    "codes": _message(HELLO) + _message({"type": "join", "episode": "AAAAA-AAAAB"}) * 400,
    "long": _message(HELLO) + frame(b" " * 60_000, TEXT) * 60,
    "silence": b"",
}
"""Bytes that follow the handshake."""


class Stranger(asyncio.Protocol):
    """One connection from its own machine. `code` belongs to an episode that it can watch.
    `cut_off` is true if the server disconnected it.
    """

    def __init__(
        self, name: str, loop: SimulatedLoop, chance: random.Random, code: str | None
    ) -> None:
        self.process = Process(name, loop)
        self.process.on_death.append(lambda: loop.network.close_all(self.process))
        self.flood = chance.choice(sorted(FLOODS))
        self.cut_off = False
        self._stream = FLOODS[self.flood].replace(CODE.encode(), (code or CODE).encode())
        self._loop = loop
        self._chance = chance
        self._transport: asyncio.Transport | None = None

    def start(self, port: int) -> None:
        """Connect, send the flood, and leave."""
        self.process.start(self._attack(port))

    async def _attack(self, port: int) -> None:
        try:
            await self._loop.create_connection(lambda: self, "127.0.0.1", port)
        except OSError:
            return
        stream = request("robotouille.v1.json") + self._stream
        size = self._chance.choice((1000, 10_000, len(stream)))
        for at in range(0, len(stream), size):
            if self._transport is None:
                break
            self._transport.write(stream[at : at + size])
            await asyncio.sleep(0.001)
        await asyncio.sleep(STAYS)
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        self.cut_off = True
