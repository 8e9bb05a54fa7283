"""Machines of a simulated cluster: one process after another with a real lobby and a real node."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotouille.episode import Event
from robotouille_server import ServerSettings
from robotouille_server.app import Surroundings
from robotouille_server.auth import Credentials
from robotouille_server.cluster.bus import Append, Bucket, BusError, Entry
from robotouille_server.cluster.members import NodeReport
from robotouille_server.cluster.node import ClusterNode, NodeParts
from robotouille_server.rooms.lobby import Lobby
from robotouille_server.rooms.participants.sessions import Sessions
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.substitutes.bot_worker import ThreadBotWorker
from robotouille_server.rooms.substitutes.bots import Bots
from robotouille_server.runtime.metrics import ClusterMetrics, Metrics
from robotouille_server.transport import LoopBudget
from tests.programs.simulation.disk import Disk
from tests.programs.simulation.loop import Process
from tests.programs.simulation.machine import KITCHENS
from tests.support.buses import SimulatedBus, SimulatedNats
from tests.support.executors import ImmediateExecutor

if TYPE_CHECKING:
    from tests.programs.simulation.cluster import ClusterSimulation

__all__ = ["NodeMachine"]

REBOOT_SECONDS = (0.2, 6.0)
RECOVERY_SECONDS = 3.0


@cache
def _settings() -> ServerSettings:
    return ServerSettings(
        recordings=Path("simulated"),
        signing_keys="simulated:" + "A" * 43,
        recovery_seconds=RECOVERY_SECONDS,
    )


@cache
def _metrics() -> Metrics:
    """Return the metrics of all nodes, because nothing depends on them."""
    return Metrics()


class WatchedBus(SimulatedBus):
    """Bus that reports when its node begins to claim an episode.

    Attributes:
        read_at: When the node last asked for the record of each episode, by the record's key.
    """

    def __init__(self, nats: SimulatedNats, name: str, claims: Callable[[str], None]) -> None:
        super().__init__(nats, name)
        self.read_at: dict[str, float] = {}
        self._claims = claims

    async def get(self, bucket: Bucket, key: str) -> Entry | None:
        if bucket is Bucket.EPISODES:
            self.read_at[key] = self._nats.loop.time()
        return await super().get(bucket, key)

    def append(self, message: Append, done: Callable[[int | BusError], None]) -> None:
        if ".claim." in message.id:
            self._claims(message.subject)
        super().append(message, done)


class InOrder(dict[Any, None]):
    """Set in the order of insertion, which is the same in every run."""

    def add(self, item: Any) -> None:
        self[item] = None

    def discard(self, item: Any) -> None:
        self.pop(item, None)


class NodeMachine:
    """A machine with a supervisor that restarts its process, and with a folder for recordings.

    Attributes:
        process: The process that runs, or has just died.
        node: The node of this process, once it has joined.
        lobby: Its rooms.
        sessions: Its sessions.
    """

    def __init__(self, sim: ClusterSimulation, number: int) -> None:
        self.sim = sim
        self.number = number
        self.starts = 0
        self.disk = Disk(random.Random(0))
        self.process: Process
        self.bus: WatchedBus
        self.node: ClusterNode | None = None
        self.lobby: Lobby | None = None
        self.sessions: Sessions | None = None
        self._rooms: dict[str, Room] = {}

    @property
    def name(self) -> str:
        return f"n{self.number}x{self.starts}"

    @property
    def url(self) -> str:
        return f"ws://{self.name}"

    def boot(self) -> None:
        """Start a process."""
        self.starts += 1
        sim = self.sim
        process = self.process = Process(self.name, sim.loop)
        sim.processes.append(process)
        self.bus = process.call(WatchedBus, sim.nats, self.name, self._claims)
        process.on_death.append(partial(self._died, process, self.bus))
        process.start(self._main())

    def _died(self, process: Process, bus: SimulatedBus) -> None:
        self.sim.trace("death", process.name)
        bus.close()
        self._rooms.clear()
        self.node = self.lobby = self.sessions = None
        if not self.sim.ending:
            delay = self.sim.chance.uniform(*REBOOT_SECONDS)
            self.sim.loop.call_later(delay, self.boot, context=self.sim.context)

    async def _main(self) -> None:
        sim, settings = self.sim, _settings()
        randomness = random.Random(f"{sim.seed}/{self.name}")
        wall = lambda: 1_700_000_000 + sim.loop.time()  # noqa: E731
        parts = NodeParts(self.disk, ClusterMetrics(), wall, RECOVERY_SECONDS)
        node = ClusterNode(self.bus, NodeReport(name=self.name, url=""), parts)
        node._journals = InOrder()  # type: ignore[assignment]
        around = Surroundings(
            randomness=randomness,
            timestamp=lambda: f"20260101T{int(sim.loop.time()):06d}Z",
            storage=self.disk,
            wall=wall,
            worker=node.slot,
            bot_worker=lambda: ThreadBotWorker(ImmediateExecutor(), Bots(KITCHENS)),
            cluster=node,
        )
        metrics = _metrics()
        sessions = Sessions(settings, metrics, Credentials.load(settings, wall), randomness)
        lobby = Lobby(settings, metrics, sessions, LoopBudget(sim.loop), around)
        lobby.observe(self)
        try:
            await self.bus.prepare()
            await node.join()
            await node.serve(lobby, self.url)
        except BusError:
            self.process.kill()  # A server that cannot join ends with an error.
            return
        self.node, self.lobby, self.sessions = node, lobby, sessions

    def _claims(self, journal: str) -> None:
        record = self.node.directory.find(journal) if self.node is not None else None
        if record is not None:
            read_at = self.bus.read_at.get(record.key, inf)
            self.sim.oracle.claims(self.name, journal, record.node, read_at)

    # Observer of the rooms

    def opened(self, room: Room) -> None:
        self.sim.trace("room", self.name, room.id)
        earlier, self._rooms[room.id] = self._rooms.get(room.id), room
        if earlier is not None and any(member.room is earlier for member in earlier.members):
            self.sim.oracle.counts["rooms that replace a living one"] += 1

    def published(self, room: Room, events: list[Event]) -> None:
        for event in events:
            self.sim.trace("publishes", self.name, room.id, type(event).__name__)
        self.sim.oracle.published(self.name, room.id, events)

    # Faults

    def leave(self) -> bool:
        """Stop the process as an operator does."""
        if self.node is None or self.lobby is None or self.name in self.sim.oracle.leaving:
            return False
        self.sim.oracle.leaving.add(self.name)
        self.process.start(self._leave(self.node, self.lobby))
        return True

    async def _leave(self, node: ClusterNode, lobby: Lobby) -> None:
        await node.leave()
        lobby.drain()
        for room in list(lobby.rooms.values()):
            if not room.episode.ended:
                lobby.suspend(room.id)
        await node.settled()
        await lobby.closed()
        await lobby.stop()
        await node.close()
        self.process.kill()

    @property
    def ready(self) -> bool:
        """Return whether the process answers that clients may come."""
        running = not self.process.dead and not self.process.suspended
        return running and self.node is not None and self.node.ready

    @property
    def live(self) -> Iterator[Room]:
        """Rooms whose episodes this node continues."""
        rooms = self.lobby.rooms.values() if self.lobby is not None else ()
        return (room for room in rooms if not room.episode.ended)
