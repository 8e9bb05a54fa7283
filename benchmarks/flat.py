"""Measure the server's memory over millions of steps, in simulated time and without a network.

Bots play on a complete server. Recordings are kept in memory and dropped when they are closed.
Episodes end and begin all the time, as on a server that runs for months.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import json
import selectors
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, BinaryIO

import msgpack
import psutil

from robotouille.protocol.codec import MSGPACK
from robotouille_client.loadtest.players import back_and_forth
from robotouille_server import Server, ServerSettings
from robotouille_server.app import Surroundings
from robotouille_server.auth.visitors import CountedConnection, Visitor
from robotouille_server.conversation import Conversation
from robotouille_server.rooms.recording.storage import FileCondition
from robotouille_server.runtime.logs import configure_logs
from robotouille_server.transport.peer import Peer

ROOMS, RATE = 50, 20
TASK = "multi_agent/01"
CHECKS = 40
"""Number of memory samples."""


@dataclass(frozen=True)
class Growth:
    """Median bytes of memory in the second and in the last quarter, and the number of steps."""

    first: float
    last: float
    steps: int

    @property
    def flat(self) -> bool:
        """True if memory grew by less than 5 %, about one byte per step over 10 million steps."""
        return self.last < 1.05 * self.first


class SimulatedSelector(selectors.DefaultSelector):
    """Selector without input that advances simulated time instead of waiting."""

    now = 1000.0

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout:
            self.now += timeout
        return []


class SimulatedLoop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self._simulated = SimulatedSelector()
        super().__init__(self._simulated)

    def time(self) -> float:
        return self._simulated.now


class Memory:
    """In-memory storage that drops closed recordings."""

    def __init__(self) -> None:
        self.files: dict[str, bytearray] = {}

    def names(self) -> list[str]:
        return sorted(self.files)

    def read(self, name: str) -> bytes:
        return bytes(self.files[name])

    def open(self, name: str) -> BinaryIO:
        return io.BytesIO(self.read(name))

    def create(self, name: str) -> Growing:
        return Growing(self.files.setdefault(name, bytearray()))

    def resume(self, name: str) -> Growing:
        return Growing(self.files[name])

    def replace(self, name: str, content: bytes) -> None:
        """Drop the content, because closed recordings are not read."""

    def free_space(self) -> int:
        return 2**40

    def remove(self, name: str) -> None:
        del self.files[name]


class Growing:
    """File of `Memory`."""

    def __init__(self, content: bytearray) -> None:
        self._content = content

    def append(self, data: bytes) -> None:
        self._content += data

    def cut(self, size: int) -> None:
        del self._content[size:]

    def read(self) -> bytes:
        return bytes(self._content)

    def condition(self) -> FileCondition:
        return FileCondition.WHOLE

    def close(self) -> None:
        pass


class Wire:
    """Connection without a network that passes the server's messages to `heard`."""

    def __init__(self, heard: Callable[[dict[str, Any]], None]) -> None:
        self.transport = self
        self.open = True
        self.latency = 0.0
        self.loop = asyncio.get_running_loop()
        self._heard = heard

    def write(self, frame: bytes) -> None:
        start = {126: 4, 127: 10}.get(frame[1], 2)
        message = msgpack.unpackb(frame[start:])
        self.loop.call_soon(self._heard, message)

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return False

    def say_goodbye(self, status: int, reason: str) -> None:
        raise AssertionError(f"the server closes: {status} {reason}")

    def give_way(self) -> None:
        """Do nothing: at most one message arrives in each turn of the event loop."""

    def share_turns(self, group: str | None) -> None:
        """Do nothing, for the same reason."""

    def accept_long_messages(self) -> None:
        """Do nothing: all messages are short."""

    def abort(self) -> None:
        raise AssertionError("the server drops the connection")


HERE = CountedConnection(Visitor("127.0.0.1", True, "local"), lambda: None)


class Bot:
    """Bot that plays one episode after another. The first of a pair opens them and acts."""

    def __init__(self, server: Server, partner: Bot | None = None, length: int = 0) -> None:
        self.partner = partner
        self.length = length
        self.steps = 0
        self._seq = 0
        self._moves = back_and_forth(TASK, "robot1")
        peer = Peer(Wire(self.heard), MSGPACK, server.metrics, 15.0)  # type: ignore[arg-type]
        self._conversation = Conversation(server.services, peer, HERE)
        self.say(type="hello", protocol=1, name="bot", kind="bot")
        if partner is not None:
            self.open()

    def say(self, **message: Any) -> None:
        self._conversation.receive(msgpack.packb(message))

    def open(self) -> None:
        self.say(type="create", task=TASK, clock="realtime", timing="benchmark", step_rate=RATE,
                 max_steps=self.length)  # fmt: skip

    def heard(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "delta":
            self.steps += 1
            self.act()
        elif kind == "created" and self.partner is not None:
            self._seq = 0
            self.say(type="join", episode=message["code"])
            self.partner.say(type="join", episode=message["code"])
        elif kind == "ended":
            self.say(type="leave")
        elif kind == "left" and self.partner is not None:
            self.open()
        elif kind in ("error", "bye"):
            raise AssertionError(message)

    def act(self) -> None:
        if self.partner is not None:
            self._seq += 1
            self.say(type="act", seq=self._seq, action=self._moves[(self._seq - 1) % 2])


async def play(steps: int) -> tuple[int, list[int]]:
    """Return the number of steps taken, and the memory in bytes at regular intervals."""
    process = psutil.Process()
    with tempfile.TemporaryDirectory() as folder:
        settings = ServerSettings(
            recordings=Path(folder) / "recordings", max_episodes=10_000, messages_per_second=1000
        )
        server = Server(settings, Surroundings(storage=Memory()))
        bots = []
        for number in range(ROOMS):
            bots.append(Bot(server, Bot(server), length=500 + 60 * number))
            await asyncio.sleep(1 / RATE / ROOMS)
        done, seen = 0, list[int]()
        for _ in range(CHECKS):
            await asyncio.sleep(steps / CHECKS / ROOMS / RATE)
            seen.append(process.memory_info().rss)
            done = sum(bot.steps for bot in bots)
            print(f"  {done:,} steps, {seen[-1] / 2**20:.1f} MiB", file=sys.stderr, flush=True)
        return done, seen


def memory_over_steps(steps: int) -> Growth:
    """Play about `steps` steps in a separate process."""
    command = [sys.executable, "-m", "benchmarks.flat", "--steps", str(steps)]
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, cwd=root)
    taken, seen = json.loads(done.stdout)
    quarter = len(seen) // 4
    return Growth(median(seen[quarter : 2 * quarter]), median(seen[-quarter:]), taken)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=10_000_000)
    steps = parser.parse_args().steps
    configure_logs("error", "console")
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        print(json.dumps(runner.run(play(steps))))


if __name__ == "__main__":
    main()
