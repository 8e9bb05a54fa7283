"""One node of a cluster: it reports itself, claims episodes and hands them over.

The cluster has no leader. Every node decides alone from what it sees, and the journals refuse the
writes of a node that sees too little (docs/decisions/0044).
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from robotouille.episode import Event
from robotouille.errors import RecordingError, RobotouilleError
from robotouille.protocol import messages
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restoring
from robotouille.world.world import shared_world
from robotouille_server.cluster.bus import (
    Append,
    Bucket,
    Bus,
    BusError,
    ConflictError,
    Entry,
    UnavailableError,
)
from robotouille_server.cluster.directory import ClusterSlot, Directory, EpisodeRecord
from robotouille_server.cluster.journal import JournalEnd, ReplicatedJournal, assembled
from robotouille_server.cluster.members import (
    MAX_REFUSED,
    RENEW_SECONDS,
    Members,
    NodeReport,
    parse_report,
)
from robotouille_server.rooms.archive import ArchivedEpisode, in_turns
from robotouille_server.rooms.journal import close_recording
from robotouille_server.rooms.room import Room, RoomObserver
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.storage import Storage
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import ClusterMetrics

LOOK_SECONDS = 0.1
"""Seconds between two looks at the writes under way."""
CLAIMS_AT_A_TIME = 8
HAND_OVERS_AT_A_TIME = 4
ADOPT_SECONDS = 5.0
"""Seconds that another node has to take an episode over."""
FINISH_RETRY_SECONDS = 1.0


class NodeRooms(Protocol):
    """Rooms of a node; see `Lobby`."""

    @property
    def rooms(self) -> dict[str, Room]: ...

    @property
    def seats_in_use(self) -> int: ...

    def adopt(self, found: ArchivedEpisode) -> Room: ...

    def give_up(self, episode: str) -> list[Session]: ...

    def observe(self, observer: RoomObserver) -> None: ...


@dataclass(frozen=True, slots=True)
class NodeParts:
    """What a node needs besides the bus.

    Attributes:
        storage: The folder for closed recordings.
        metrics: The metrics of the server.
        wall: Returns the seconds since 1970.
        recovery_seconds: The seconds for which claimed episodes wait for their players.
        every_second: Called once a second, for the secrets that nodes share.
    """

    storage: Storage
    metrics: ClusterMetrics
    wall: Callable[[], float] = time.time
    recovery_seconds: float = 10.0
    every_second: Callable[[], Awaitable[None]] | None = None


class ClusterNode:
    """One node of a cluster.

    Attributes:
        bus: The connection to the other nodes.
        members: The nodes that are alive.
        directory: The node of each episode.
        slot: The position of the node, with which the lobby redirects clients.
    """

    def __init__(self, bus: Bus, report: NodeReport, parts: NodeParts) -> None:
        self._loop = asyncio.get_running_loop()
        self.bus = bus
        self.members = Members(report, self._loop.time())
        self.directory = Directory(bus)
        self.slot = ClusterSlot(directory=self.directory, members=self.members)
        self._parts = parts
        self._rooms: NodeRooms | None = None
        self._journals: set[ReplicatedJournal] = set()
        self._registering: dict[str, asyncio.Task[BusError | None]] = {}
        self._claiming: set[str] = set()
        self._claims = asyncio.Semaphore(CLAIMS_AT_A_TIME)
        self._refused: dict[str, str] = {}
        self._tasks: set[asyncio.Task[Any]] = set()
        self._count = 0

    # For journals

    @property
    def name(self) -> str:
        return self.members.own.name

    @property
    def lease_certain(self) -> bool:
        return self.members.certain(self._loop.time())

    def begun(self, journal: ReplicatedJournal) -> None:
        self._journals.add(journal)

    def released(self, journal: ReplicatedJournal) -> None:
        self._journals.discard(journal)

    def written(self, journal: ReplicatedJournal, seconds: float) -> None:
        self._parts.metrics.commit.observe(seconds)

    def fenced(self, journal: ReplicatedJournal) -> None:
        """Give an episode up that another node has taken over."""
        self._parts.metrics.fenced += 1
        get_logger().warning("another node has taken the episode over", episode=journal.episode)
        self._give_up(journal.episode)

    def journal(
        self, episode: str, name: str, recorder: Recorder, begin: bytes
    ) -> ReplicatedJournal:
        """Return the journal of a new episode."""
        journal = ReplicatedJournal(self, episode, name, recorder, begin=begin)
        journal.write()
        return journal

    def finish(self, journal: ReplicatedJournal, *, kept: bool) -> asyncio.Future[str]:
        work = self._finish(journal.episode, journal.name, kept=kept)
        return self._start(work)

    # Start

    async def join(self) -> None:
        """Learn about the other nodes and the episodes."""
        await self.bus.watch(Bucket.NODES, self._node_changed)
        await self.bus.watch(Bucket.EPISODES, self._episode_changed)

    async def serve(self, rooms: NodeRooms, url: str) -> None:
        """Begin to open episodes, to claim them and to take them over.

        Args:
            rooms: The rooms of this node.
            url: The address at which clients reach it.
        """
        self._rooms = rooms
        rooms.observe(self)
        self.members.own = self.members.own.model_copy(update={"url": url})
        await self.bus.answer(f"adopt.{self.name}", self._adopt)
        await self._renew()
        self._start(self._beat())
        self._start(self._look())

    def _start(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _node_changed(self, key: str, entry: Entry | None) -> None:
        if entry is None:
            self.members.left(key)
        elif (report := parse_report(entry.value)) is not None and report.name == key:
            self.members.heard(report, entry.revision)

    def _episode_changed(self, key: str, entry: Entry | None) -> None:
        self.directory.changed(key, entry)
        if entry is None or self._rooms is None:
            return
        record = self.directory.find(key)
        room = self._rooms.rooms.get(record.episode) if record is not None else None
        # This node may be idle, so that no write has told it that it has lost the episode.
        if record is not None and room is not None and record.node not in ("", self.name):
            journal = room.journal
            if isinstance(journal, ReplicatedJournal) and journal in self._journals:
                self.fenced(journal)

    # Rooms of this node

    def opened(self, room: Room) -> None:
        """Let all nodes know a new room, once its recording has begun."""
        record = self.directory.find(room.id)
        if record is None and isinstance(room.journal, ReplicatedJournal):
            registering = self._start(self._register(room, room.journal))
            self._registering[room.id] = registering
            registering.add_done_callback(lambda _: self._registering.pop(room.id, None))

    def published(self, room: Room, events: list[Event]) -> None:
        """Do nothing: the journal has the events."""

    async def _register(self, room: Room, journal: ReplicatedJournal) -> BusError | None:
        record = EpisodeRecord(
            episode=room.id,
            code=room.code,
            node=self.name,
            file=journal.name,
            owner=room.owner,
            reserved=room.reserved,
        )
        try:
            await journal.stored()
            await self.directory.add(record)
        except BusError as error:
            room.abort("its recording could not be begun")
            return error
        return None

    async def registered(self, episode: str) -> None:
        """Wait until all nodes know a new room; raise BusError if that is not possible."""
        registering = self._registering.get(episode)
        if registering is not None and (error := await asyncio.shield(registering)) is not None:
            raise error

    # Every second

    async def _beat(self) -> None:
        while True:
            await asyncio.sleep(RENEW_SECONDS)
            try:
                await self._renew()
                await self._tidy()
                if self._parts.every_second is not None:
                    await self._parts.every_second()
                self._claim_orphans()
            except BusError as error:
                get_logger().warning("the node's report was not stored", error=str(error))
                await self._repair()
            except Exception:
                get_logger().exception("the node's round failed")

    async def _repair(self) -> None:
        """Create buckets that somebody has deleted, and enter this node's episodes again."""

    async def _renew(self) -> None:
        load = self._rooms.seats_in_use if self._rooms is not None else 0
        refused = tuple(self._refused)[-MAX_REFUSED:]
        self.members.own = self.members.own.model_copy(update={"load": load, "refused": refused})
        begun = self._loop.time()
        value = self.members.own.model_dump_json(exclude_defaults=True).encode()
        await self.bus.put(Bucket.NODES, self.name, value)
        # The others count from when they hear the report, which is not before it was sent.
        self.members.renewed(begun)
        # A watch is silent for a while when the NATS server that serves it dies.
        for name in self.members.lapsing():
            if (entry := await self.bus.get(Bucket.NODES, name)) is not None:
                self._node_changed(name, entry)
        self._parts.metrics.nodes = len(self.members.alive())

    async def _tidy(self) -> None:
        """Remove the records of this node's episodes that nobody can come back to any more."""
        rooms = self._rooms.rooms if self._rooms is not None else {}
        nodes = set()
        for record in self.directory:
            nodes.add(record.node)
            mine = record.node == self.name or self.members.lapsed(record.node)
            if record.ended and mine and record.episode not in rooms:
                await self.directory.remove(record)
        self.members.forget_lapsed(nodes)

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(LOOK_SECONDS)
            now = self._loop.time()
            late = 0
            for journal in list(self._journals):
                journal.look(now)
                late += bool(journal.problem)
            self._parts.metrics.uncommitted = late
            self._parts.metrics.lease_age = self.members.lease_age(now)

    # Claiming

    def _claim_orphans(self) -> None:
        orphans = {
            record.episode: record.node
            for record in self.directory
            if not record.ended
            and self.members.lapsed(record.node)
            and record.episode not in self._claiming
        }
        for episode in self.members.share(orphans):
            record = self.directory.find(episode)
            if record is not None:
                self._start(self._claim(record))

    async def _claim(self, record: EpisodeRecord) -> str:
        """Take an episode over; return why that was not possible, or an empty text."""
        if record.episode in self._claiming:
            return "it is being claimed already"
        self._claiming.add(record.episode)
        try:
            async with self._claims:
                return await self._continue(record)
        except ConflictError:
            return "another node was first"
        except BusError as error:
            return str(error)
        except RobotouilleError as error:
            self._refuse(record, str(error))
        except Exception as error:
            get_logger().exception("episode not taken over", episode=record.episode)
            self._refuse(record, f"internal error: {error!r}")
        finally:
            self._claiming.discard(record.episode)
        return self._refused[record.episode]

    def _refuse(self, record: EpisodeRecord, why: str) -> None:
        self._refused[record.episode] = why
        get_logger().error("episode not taken over", episode=record.episode, error=why)

    async def _continue(self, record: EpisodeRecord) -> str:
        stored = await self.bus.read(record.episode)
        if not stored:
            # Its first node has died before anything was stored, or after the journal was deleted.
            await self.directory.remove(record)
            return "it has no journal"
        content = assembled(stored)
        recording, restored = await self._restored(content, record)
        if restored.complete:
            await self._take(record, stored[-1].sequence, b"", None)
            await self._finish(record.episode, record.file, kept=True)
            return "it has ended"
        keep = restored.kept if restored.kept < len(content) else None
        sequence = await self._take(record, stored[-1].sequence, restored.missing, keep)
        record = record.model_copy(update={"node": self.name, "claim": sequence})
        if not await self.directory.replace(record) or self._rooms is None:
            return "another node was first"
        world, frames = restored.episode.world, recording.count
        recorder = Recorder(world, self._parts.wall, self._loop.time, frames)
        end = JournalEnd(sequence, restored.kept + len(restored.missing))
        journal = ReplicatedJournal(self, record.episode, record.file, recorder, end=end)
        self._rooms.adopt(ArchivedEpisode(recording.header, restored, recorder, journal))
        self._parts.metrics.takeovers += 1
        return ""

    async def _restored(self, content: bytes, record: EpisodeRecord) -> tuple[Recording, Restored]:
        try:
            recording = Recording(content, record.file)
            patience = self._parts.recovery_seconds
            work = restoring(recording, self._loop.time(), patience, shared_world)
            return recording, await in_turns(work)
        except RecordingError as error:
            raise RecordingError(f"the journal cannot be continued: {error}") from None

    async def _take(self, record: EpisodeRecord, last: int, data: bytes, keep: int | None) -> int:
        """Write to a journal as its new owner; return the sequence number of the write.

        Raises:
            ConflictError: The journal has a later message than `last`.
        """
        self._count += 1
        name = f"{record.episode}.{self.name}.claim.{self._count}"
        result: asyncio.Future[int] = self._loop.create_future()

        def done(answer: int | BusError) -> None:
            if result.done():
                return
            if isinstance(answer, int):
                result.set_result(answer)
            else:
                result.set_exception(answer)

        self.bus.append(Append(record.episode, data, last, name, keep), done)
        return await result

    # Handing over

    async def leave(self) -> None:
        """Hand all episodes over to other nodes, before the process stops."""
        self.members.own = self.members.own.model_copy(update={"leaving": True})
        if self._rooms is None:
            return
        try:
            await self._renew()
        except BusError as error:
            get_logger().warning("the others do not know that this node leaves", error=str(error))
        limit = asyncio.Semaphore(HAND_OVERS_AT_A_TIME)

        async def hand_over(room: Room) -> None:
            async with limit:
                await self._hand_over(room)

        rooms = [room for room in self._rooms.rooms.values() if not room.episode.ended]
        await asyncio.gather(*map(hand_over, rooms))

    async def _hand_over(self, room: Room) -> None:
        journal, target = room.journal, self.members.other(room.id)
        if target is None or not isinstance(journal, ReplicatedJournal):
            return
        try:
            await journal.stored()
            if room.episode.ended or self._rooms is None:
                return
            room.suspend()
            subject = f"adopt.{target.name}.{room.id}"
            refusal = (await self.bus.request(subject, b"", ADOPT_SECONDS)).decode()
        except BusError as error:
            refusal = str(error)
        if refusal:
            get_logger().warning("episode not handed over", episode=room.id, reason=refusal)
        # If it failed, another node claims the episode when this one is gone.
        self._give_up(room.id, target)

    async def _adopt(self, episode: str, data: bytes) -> bytes:
        """Take an episode over from a node that leaves."""
        if self.members.own.leaving:
            return b"this node leaves, too"
        record = self.directory.find(episode)
        if record is None:
            return b"it is unknown"
        return (await self._claim(record)).encode()

    def _give_up(self, episode: str, target: NodeReport | None = None) -> None:
        """Send the participants of an episode to the node that has it."""
        if self._rooms is None:
            return
        if target is None:
            record = self.directory.find(episode)
            target = self.members.find(record.node) if record is not None else None
        for session in self._rooms.give_up(episode):
            peer, session.peer = session.peer, None
            if peer is None:
                continue
            if target is not None and target.name != self.name:
                peer.send(messages.Moved(episode=episode, port=0, url=target.url))
            text = "another node has taken the episode over"
            peer.close("server/restart", text, retry=True, status=1012)

    # The end of episodes

    async def _finish(self, episode: str, name: str, *, kept: bool) -> str:
        """Store a complete journal as a file, and delete the journal."""
        while True:
            try:
                return await self._finished(episode, name, kept=kept)
            except BusError as error:
                get_logger().warning("recording not stored yet", file=name, error=str(error))
            except (OSError, RecordingError) as error:
                get_logger().error("recording not closed", file=name, error=str(error))
                return ""
            await asyncio.sleep(FINISH_RETRY_SECONDS)

    async def _finished(self, episode: str, name: str, *, kept: bool) -> str:
        whole = ""
        stored = await self.bus.read(episode) if kept else []
        if stored:
            content = assembled(stored)
            storage = self._parts.storage
            close = self._loop.run_in_executor
            size = len(content)
            whole = await close(None, close_recording, storage, name, content, size)
            compressed = await close(None, storage.read, whole)
            await self.bus.store(whole, compressed)
        record = self.directory.find(episode)
        if record is not None and kept:
            await self.directory.replace(record.model_copy(update={"ended": True}))
        elif record is not None:
            await self.directory.remove(record)
        # The journal goes last: until then, another node can do all of this again.
        await self.bus.purge(episode)
        return whole

    # Stop

    async def settled(self) -> None:
        """Wait until everything that can be written is written."""
        for journal in list(self._journals):
            try:
                await journal.stored()
            except UnavailableError as error:
                get_logger().error("not written", file=journal.name, error=str(error))

    async def close(self) -> None:
        """Leave the cluster."""
        for task in list(self._tasks):
            task.cancel()
        try:
            for record in self.directory:
                if record.node == self.name and not record.ended:
                    await self.directory.replace(record.model_copy(update={"node": ""}))
            await self.bus.delete(Bucket.NODES, self.name)
        except BusError as error:
            get_logger().warning("the others do not know that this node left", error=str(error))


def other_nodes(members: Iterable[NodeReport], own: NodeReport) -> list[str]:
    """Return the addresses of the other nodes."""
    return [report.url for report in members if report.name != own.name]
