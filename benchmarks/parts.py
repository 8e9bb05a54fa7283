"""Cost of each part of a step, and of opening a room, without a network.

    python -m benchmarks.parts --rooms 200 --steps 30

The messages go through the server's own connections, but the sockets drop what is sent. The costs
of the kernel and of the event loop are therefore missing; `benchmarks.server` includes them. Times
are the least of all rounds, because other programs only make them longer. Each named part is
measured in rounds of its own, so that timing one part does not slow down another. Connections never
give way to others, because all messages are processed in one turn of the event loop.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import msgpack
from rich.console import Console
from rich.table import Table
from tests.support.fuzzing.wire import request

from robotouille.episode import Episode
from robotouille.protocol.codec import Codec
from robotouille.protocol.frames import BINARY, FIN, pack_frame
from robotouille.replay.recorder import Recorder
from robotouille_server.app import Server, serve
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.recording.journal import Journal
from robotouille_server.runtime.logs import configure_logs
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.transport import Connection, LoopBudget

TASK, RATE = "multi_agent/01", 5.0
SUBPROTOCOL = "robotouille.v1.msgpack"
HANDSHAKE = request(SUBPROTOCOL)
PARTS: dict[str, tuple[type, str]] = {
    "decode an action": (Codec, "decode_client"),
    "simulate a step": (Episode, "tick"),
    "encode it for the recording": (Recorder, "record"),
    "write it to the file": (Journal, "write"),
    "encode and send the delta": (Broadcaster, "publish_step"),
}


class Deaf(asyncio.Transport):
    """Transport that remembers the last frame and sends nothing."""

    def __init__(self, protocol: asyncio.BaseProtocol) -> None:
        super().__init__()
        self._protocol = protocol
        self.last = b""

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return ("127.0.0.1", 1) if name == "peername" else default

    def is_closing(self) -> bool:
        return False

    def get_write_buffer_size(self) -> int:
        return 0

    def write(self, data: bytes | bytearray | memoryview[Any]) -> None:
        self.last = bytes(data)

    def answer(self) -> dict[str, Any]:
        """Return the last message."""
        start = {126: 4, 127: 10}.get(self.last[1], 2)
        answer: dict[str, Any] = msgpack.unpackb(self.last[start:])
        return answer

    def pause_reading(self) -> None:
        """Do nothing: the benchmark decides what arrives when."""

    def resume_reading(self) -> None:
        """Do nothing."""

    def can_write_eof(self) -> bool:
        return False

    def close(self) -> None:
        self.abort()

    def abort(self) -> None:
        asyncio.get_running_loop().call_soon(self._protocol.connection_lost, None)


class Player:
    """Participant on a connection without a network."""

    def __init__(self, server: Server) -> None:
        server.admission.admit()
        self._connection = Connection(server.connections, server.admission)
        self.wire = Deaf(self._connection)
        self._connection.connection_made(self.wire)
        self._connection.data_received(HANDSHAKE)

    def say(self, **message: Any) -> None:
        self.receive(packed(message))

    def receive(self, frame: bytes) -> None:
        """Let a frame arrive at the server."""
        self._connection.data_received(frame)


def packed(message: dict[str, Any]) -> bytes:
    """Return a message as a client's frame."""
    return pack_frame(FIN | BINARY, msgpack.packb(message), b"\1\2\3\4")


class Bench:
    """Rooms of two players, and the least time of each round."""

    def __init__(self, server: Server) -> None:
        self._server = server
        self._pairs: list[tuple[Player, Player]] = []
        self.steps = 0
        self.opening = float("inf")

    async def open(self, rooms: int) -> None:
        """Open rooms in groups of ten, and note the time per room of the fastest group."""
        for _ in range(max(1, rooms // 10)):
            begun = time.perf_counter()
            self._pairs += [await self._opened() for _ in range(10)]
            self.opening = min(self.opening, (time.perf_counter() - begun) / 10)
            await asyncio.sleep(0)

    async def _opened(self) -> tuple[Player, Player]:
        ada, bob = Player(self._server), Player(self._server)
        for player in (ada, bob):
            player.say(type="hello", protocol=1, name="bot", kind="bot")
        ada.say(type="create", task=TASK, clock="realtime", step_rate=RATE)
        # The first episode of a task is created after its plan has been simulated in a thread.
        while "code" not in (created := ada.wire.answer()):  # noqa: ASYNC110
            await asyncio.sleep(0.001)
        code = created["code"]
        for player in (ada, bob):
            player.say(type="join", episode=code)
        return ada, bob

    def round(self) -> tuple[float, float]:
        """Take one step in all rooms; return the seconds per action and per step."""
        self.steps += 1
        act = packed({"type": "act", "seq": self.steps, "action": None, "basis": self.steps - 1})
        begun = time.perf_counter()
        for pair in self._pairs:
            for player in pair:
                player.receive(act)
        acted = time.perf_counter()
        rooms = list(self._server.lobby.rooms.values())
        for room in rooms:
            room.episode.tick(room.episode.due() or 0.0)
            room.driver.flush()
        return (acted - begun) / len(rooms) / 2, (time.perf_counter() - acted) / len(rooms)


@contextmanager
def timed(owner: type, name: str) -> Iterator[Callable[[], float]]:
    """Measure the seconds spent in a method; yields a function that returns and resets them."""
    original, spent, clock = getattr(owner, name), 0.0, time.perf_counter

    def wrapper(*arguments: Any, **options: Any) -> Any:
        nonlocal spent
        begun = clock()
        try:
            return original(*arguments, **options)
        finally:
            spent += clock() - begun

    def take() -> float:
        nonlocal spent
        taken, spent = spent, 0.0
        return taken

    setattr(owner, name, wrapper)
    try:
        yield take
    finally:
        setattr(owner, name, original)


async def measure(rooms: int, rounds: int, folder: Path) -> list[tuple[str, float]]:
    """Return the parts and their seconds, per room and step."""
    settings = ServerSettings(
        port=0, recordings=folder, max_connections=10**5, max_episodes=10**4,
        messages_per_second=1000.0, countdown=0.0,
    )  # fmt: skip
    with (
        patch.object(LoopBudget, "start", lambda self: True),
        patch.object(LoopBudget, "over", False),
        patch.object(LoopBudget, "wait", lambda self, resume, group=None: resume()),
    ):
        return await _measured(settings, rooms, rounds)


async def _measured(settings: ServerSettings, rooms: int, rounds: int) -> list[tuple[str, float]]:
    async with serve(settings) as server:
        bench = Bench(server)
        await bench.open(rooms)
        acts, steps = zip(*(bench.round() for _ in range(rounds)), strict=True)
        rows = [
            ("open a room, two players join", bench.opening),
            ("an action", min(acts)),
            ("a step", min(steps)),
        ]
        for what, (owner, name) in PARTS.items():
            with timed(owner, name) as take:
                least = min((bench.round(), take())[1] for _ in range(rounds))
            times = len(server.lobby.rooms) * (2 if owner is Codec else 1)
            rows.append((f"  {what}", least / times))
        return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.parts", description=__doc__)
    parser.add_argument("--rooms", type=int, default=200)
    parser.add_argument("--steps", type=int, default=30, help="steps of each measurement")
    given = parser.parse_args(arguments)
    configure_logs("error", "console")
    with tempfile.TemporaryDirectory() as folder:
        rows = asyncio.run(measure(given.rooms, given.steps, Path(folder)))
    table = Table("part", "µs", title=f"{given.rooms} rooms of two, without network")
    for what, seconds in rows:
        table.add_row(what, f"{seconds * 1e6:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
