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
from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille.replay.recorder import Recorder
from robotouille.terminal import printable
from robotouille_server.cluster.bus import (
    Bucket,
    Bus,
    BusError,
    Entry,
    UnavailableError,
    until_available,
)
from robotouille_server.cluster.episodes.claims import Claims, Continuation
from robotouille_server.cluster.episodes.closing import Closing
from robotouille_server.cluster.episodes.directory import ClusterSlot, Directory, EpisodeRecord
from robotouille_server.cluster.episodes.handing_over import HandingOver, Offer
from robotouille_server.cluster.episodes.journal import ReplicatedJournal
from robotouille_server.cluster.episodes.strays import Strays
from robotouille_server.cluster.members import (
    LEASE_SECONDS,
    MAX_REFUSED,
    RENEW_SECONDS,
    Members,
    NodeReport,
    parse_report,
)
from robotouille_server.cluster.readiness import is_ready
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.recording.archive import ArchivedEpisode
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.rooms.room import Room, RoomObserver
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import ClusterMetrics
from robotouille_server.runtime.task_folder import TaskFolder

MAX_NAMED, MAX_URL = 8, 200
"""Nodes that a line of the log names, and characters of each address."""
LOOK_SECONDS = 0.1
"""Seconds between two looks at the writes under way."""
RETRY_SECONDS = 0.25
"""Seconds after which a report is sent again that was not stored."""
REPAIR_SECONDS = 5.0
"""Seconds without an answer after which the buckets may have been deleted."""
DIFFERENCES = {
    "keys": "other nodes sign tokens with other keys",
    "tasks": "other nodes have other tasks, so this node opens no new episodes there",
    "release": "other nodes run another version, so this node opens no new episodes there",
    "protocol": "other nodes speak another version of the protocol, so clients cannot follow there",
}
"""Log messages for facts in the reports of nodes that must be equal."""


class NodeRooms(Protocol):
    """Rooms of a node; see `Lobby`."""

    @property
    def rooms(self) -> dict[str, Room]: ...

    @property
    def seats_in_use(self) -> int: ...

    @property
    def tasks(self) -> TaskFolder: ...

    def now(self) -> float: ...

    def adopt(self, found: ArchivedEpisode) -> Room: ...

    def give_up(self, episode: str) -> list[Session]: ...

    def observe(self, observer: RoomObserver) -> None: ...


@dataclass(frozen=True, slots=True)
class NodeParts:
    """Parts of a server that its node needs.

    Attributes:
        storage: The folder for closed recordings.
        metrics: The metrics of the server.
        wall: Returns the seconds since 1970.
        recovery_seconds: The seconds for which claimed episodes wait for their players.
        every_second: Called once a second, for the secrets that nodes share.
        restore: Called after an operator may have deleted these secrets in NATS.
        keys: Returns a digest of the keys that sign tokens.
    """

    storage: Storage
    metrics: ClusterMetrics
    wall: Callable[[], float] = time.time
    recovery_seconds: float = 10.0
    every_second: Callable[[], Awaitable[None]] | None = None
    restore: Callable[[], Awaitable[None]] | None = None
    keys: Callable[[], str] = str


class ClusterNode:
    """One node of a cluster.

    Attributes:
        bus: The connection to the other nodes.
        members: The nodes that are alive.
        directory: The node of each episode.
        slot: The position of the node, with which the lobby redirects clients.
        claims: The episodes that it takes over.
        cut_off: True while only this node cannot reach NATS.
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
        self._closing = Closing(bus, self.directory, parts.storage)
        continuation = Continuation(
            self._adopted, parts.wall, self._now, parts.recovery_seconds, self._abandoned
        )
        self.claims = Claims(bus, self.directory, self, self._closing, continuation)
        self._handing_over = HandingOver(self)
        self._tasks: set[asyncio.Task[Any]] = set()
        self._count = 0
        self._lost_since: float | None = None
        self._late_since = self._loop.time()
        self._reserved: set[str] = set()
        self._suspect = False
        self._unrepaired = ""
        self._different: dict[str, list[str]] = {}
        self.cut_off = False

    # For journals

    @property
    def name(self) -> str:
        return self.members.own.name

    @property
    def ready(self) -> bool:
        """True while clients should come to this node."""
        return not self.members.own.leaving and self.lease_certain

    @property
    def lease_certain(self) -> bool:
        return self.members.certain(self._loop.time())

    @property
    def certain_since(self) -> float:
        return self.members.certain_since

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
        self.give_up(journal.episode)

    def journal(
        self, episode: str, name: str, recorder: Recorder, begin: bytes
    ) -> ReplicatedJournal:
        """Return the journal of a new episode."""
        journal = ReplicatedJournal(self, episode, name, recorder, begin=begin)
        journal.write()
        return journal

    def finish(self, journal: ReplicatedJournal, *, kept: bool) -> asyncio.Future[str]:
        return self._start(self._closing.finish(journal.episode, journal.name, kept=kept))

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
        own = {"url": url, "tasks": rooms.tasks.digest}
        self.members.own = self.members.own.model_copy(update=own)
        await self.bus.answer(f"prepare.{self.name}", self._prepare)
        await self.bus.answer(f"adopt.{self.name}", self._adopt)
        await until_available(self._renew)
        self._start(self._beat())
        self._start(self._maintain())
        self._start(self._inspect())
        self._start(self._share())
        self._start(self._look())
        self._start(Strays(self.bus, self.directory).run(self._is_first))

    def _start(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task[Any]:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _is_first(self) -> bool:
        """Return whether this node does what one node should do for all."""
        return self.name == min(report.name for report in self.members.alive())

    def _node_changed(self, key: str, entry: Entry | None) -> None:
        if entry is None:
            self.members.left(key)
        elif (report := parse_report(entry.value)) is not None and report.name == key:
            self.members.heard(report, report.beat)

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
        """Let all nodes know that the first participant has come to a reserved room."""
        self._handing_over.published(room, events)
        if room.id in self._reserved and not room.reserved:
            self._reserved.discard(room.id)
            self._start(self._note_first_participant(room.id))

    async def _note_first_participant(self, episode: str) -> None:
        record = self.directory.find(episode)
        try:
            if record is not None and record.node == self.name:
                await self.directory.replace(record.model_copy(update={"reserved": False}))
        except BusError as error:
            get_logger().warning("limits of other nodes are late", error=str(error))

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
            # A node that is cut off gives its rooms up, also those that are not stored yet.
            if not journal.settled:
                raise UnavailableError("this node was cut off before the episode was stored")
            await self.directory.add(record)
            if record.reserved:
                self._reserved.add(room.id)
        except BusError as error:
            room.abort("its recording could not be begun")
            self._suspect = True
            return error
        return None

    def _now(self) -> float:
        return self._rooms.now() if self._rooms is not None else self._loop.time()

    def _adopted(self, found: ArchivedEpisode) -> None:
        """Make a room of an episode that this node has taken over."""
        if self._rooms is not None:
            self._rooms.adopt(found)
            self._parts.metrics.takeovers += 1

    async def registered(self, episode: str) -> None:
        """Wait until all nodes know a new room; raise BusError if that is not possible."""
        registering = self._registering.get(episode)
        if registering is not None and (error := await asyncio.shield(registering)) is not None:
            raise error

    # Every second

    async def _beat(self) -> None:
        pause = RENEW_SECONDS
        while True:
            await asyncio.sleep(pause)
            pause = RENEW_SECONDS
            try:
                await self._renew()
                self._claim_orphans()
                if self._lost_since is not None:
                    get_logger().info("the node's report is stored again")
                self._lost_since = None
            except BusError as error:
                # The others count the silence of a node from their own first report on.
                pause = RETRY_SECONDS
                await self._without_bus_safely(error)
            except Exception:
                get_logger().exception("the node's round failed")

    async def _maintain(self) -> None:
        """Repair and tidy the buckets. Leases must not wait for this."""
        while True:
            await asyncio.sleep(RENEW_SECONDS)
            try:
                if self._suspect:
                    await self._repair()
                if self.members.own.leaving:
                    await self._release_given_up()
                await self._tidy()
            except BusError as error:
                get_logger().debug("the cluster's buckets not tidied", error=str(error))
            except Exception:
                get_logger().exception("the cluster's buckets not tidied")

    async def _inspect(self) -> None:
        """Notice that an operator has deleted streams or buckets."""
        while True:
            await asyncio.sleep(REPAIR_SECONDS)
            try:
                if not await self.bus.intact():
                    get_logger().error("streams or buckets of the cluster were deleted")
                    self._suspect = True
            except BusError as error:
                get_logger().debug("the cluster's buckets not inspected", error=str(error))
            except Exception:
                get_logger().exception("the cluster's buckets not inspected")
            self._suspect |= bool(self._unrepaired)

    async def _without_bus_safely(self, error: BusError) -> None:
        try:
            await self._without_bus(error)
        except Exception:
            # The node must report itself again when NATS is back, whatever has failed.
            get_logger().exception("the node cannot deal with the loss of NATS")

    async def _without_bus(self, error: BusError) -> None:
        """Log a failure once; enter everything again if an operator has deleted the buckets."""
        now = self._loop.time()
        if self._lost_since is None:
            self._lost_since = now
            get_logger().error("the node's report was not stored", error=str(error))
        if self.members.lease_age(now) > LEASE_SECONDS + RENEW_SECONDS and not self.cut_off:
            await self._notice_if_cut_off()
        if now - self._lost_since < REPAIR_SECONDS or not self.bus.connected:
            return
        self._lost_since = now
        self._suspect = True

    async def _repair(self) -> None:
        """Create what an operator has deleted, and enter what this node knows again."""
        self._suspect = False
        try:
            await self.bus.prepare()
            await self.join()
            if self._parts.restore is not None:
                await self._parts.restore()
            for record in self.directory:
                if record.node == self.name:
                    await self.directory.replace(record)
        except RobotouilleError as error:
            if self._unrepaired != (unrepaired := str(error)):
                get_logger().error("the cluster's buckets cannot be used", error=unrepaired)
            self._unrepaired = unrepaired
        else:
            self._unrepaired = ""

    async def _notice_if_cut_off(self) -> None:
        """Send the participants away if other nodes still have a quorum.

        If NATS has failed for all, they stay, and the games wait for it.
        """
        others = [report.url for report in self.members.last_known()]
        if not any(await asyncio.gather(*map(is_ready, others))):
            return
        self.cut_off = True
        get_logger().error("this node is cut off from NATS, and other nodes take its episodes over")
        for room in list(self._rooms.rooms.values()) if self._rooms is not None else ():
            if not room.episode.ended:
                self.give_up(room.id)

    async def _renew(self) -> None:
        load = self._rooms.seats_in_use if self._rooms is not None else 0
        changes = {
            "beat": self.members.own.beat + 1,
            "load": load,
            "refused": tuple(self.claims.refused)[-MAX_REFUSED:],
            "keys": self._parts.keys(),
        }
        self.members.own = self.members.own.model_copy(update=changes)
        begun = self._loop.time()
        value = self.members.own.model_dump_json(exclude_defaults=True).encode()
        await self.bus.put(Bucket.NODES, self.name, value)
        # The others count from when they hear the report, which is not before it was sent.
        self.members.renewed(begun)
        self.cut_off = False
        # A watch is silent for a while when the NATS server that serves it dies.
        for name in self.members.lapsing():
            if (entry := await self.bus.get(Bucket.NODES, name)) is not None:
                self._node_changed(name, entry)
            else:
                self.members.missing(name)
        self._parts.metrics.nodes = len(self.members.alive())

    async def _tidy(self) -> None:
        """Remove the records of this node's episodes that nobody can come back to any more."""
        rooms = self._rooms.rooms if self._rooms is not None else {}
        nodes = set()
        for record in self.directory:
            nodes.add(record.node)
            lapsed = self.members.lapsed(record.node)
            if not record.ended or record.episode in rooms:
                continue
            if lapsed:
                # Its node may have died before it deleted the journal, which is stored as a file.
                await self.bus.purge(record.episode)
            if lapsed or record.node == self.name:
                await self.directory.remove(record)
        self.members.forget_lapsed(nodes)

    async def _share(self) -> None:
        """Share secrets that have changed. Leases must not wait for this."""
        share = self._parts.every_second
        while share is not None:
            await asyncio.sleep(RENEW_SECONDS)
            try:
                await share()
            except BusError as error:
                get_logger().debug("secrets not shared", error=str(error))
            except Exception:
                get_logger().exception("secrets not shared")
            self._compare_nodes()

    def _compare_nodes(self) -> None:
        """Log which nodes differ from this one, whenever that changes."""
        members = self.members
        for fact, event in DIFFERENCES.items():
            own = getattr(members.own, fact)
            others = sorted(r.url for r in members.alive() if getattr(r, fact) != own)
            if others and others != self._different.get(fact):
                more = f" and {len(others) - MAX_NAMED} more" if len(others) > MAX_NAMED else ""
                # Anyone who can write to NATS can report any nodes.
                named = printable(", ".join(url[:MAX_URL] for url in others[:MAX_NAMED]))
                get_logger().error(event, nodes=named + more)
            self._different[fact] = others

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(LOOK_SECONDS)
            now = self._loop.time()
            late = 0
            for journal in list(self._journals):
                journal.look(now)
                late += bool(journal.problem)
            self._parts.metrics.uncommitted = late
            if not late or not self.bus.connected:
                self._late_since = now
            elif now - self._late_since > REPAIR_SECONDS:
                self._suspect, self._late_since = True, now
            self._parts.metrics.lease_age = self.members.lease_age(now)

    def _claim_orphans(self) -> None:
        orphans = {
            record.episode: record.node
            for record in self.directory
            if not record.ended and self.members.lapsed(record.node)
        }
        claimed = [self.directory.find(episode) for episode in self.members.share(orphans)]
        if not self.members.own.leaving:
            claimed += self._given_up()
        for record in claimed:
            if record is not None and not self.claims.under_way(record.episode):
                self._start(self.claims.claim(record))

    def _abandoned(self, record: EpisodeRecord) -> bool:
        """Return whether no other node has an episode."""
        return record.node == self.name or self.members.lapsed(record.node)

    def _given_up(self) -> list[EpisodeRecord]:
        """Return the records of this node's episodes that it no longer plays.

        It gives them up while it is cut off or leaves, and perhaps no other node has claimed them.
        """
        rooms = self._rooms.rooms if self._rooms is not None else {}
        return [
            record
            for record in self.directory
            if record.node == self.name and not record.ended and record.episode not in rooms
        ]

    async def _release_given_up(self) -> None:
        """Let other nodes claim what this one gives up while it leaves, before it has stopped."""
        for record in self._given_up():
            if not self.claims.under_way(record.episode):
                await self._release(record)

    async def _release(self, record: EpisodeRecord) -> None:
        await self.directory.replace(record.model_copy(update={"node": ""}))

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
        rooms = [room for room in self._rooms.rooms.values() if not room.episode.ended]
        await self._handing_over.hand_over(rooms)

    def has(self, room: Room) -> bool:
        """Return whether a room is still one of this node's rooms."""
        return self._rooms is not None and self._rooms.rooms.get(room.id) is room

    async def _prepare(self, episode: str, data: bytes) -> bytes:
        """Get ready for an episode that another node is about to hand over."""
        record = self.directory.find(episode)
        try:
            if record is not None:
                await self.claims.prepare(record)
        except RobotouilleError as error:
            return str(error).encode()
        return b""

    async def _adopt(self, episode: str, data: bytes) -> bytes:
        """Take an episode over from a node that leaves.

        Args:
            episode: The episode's id.
            data: The offer of the node that leaves.
        """
        if self.members.own.leaving:
            return b"this node leaves, too"
        record = self.directory.find(episode)
        if record is None:
            return b"it is unknown"
        # The request may come late, or from a node that does not know yet that it has lost the
        # episode. A claim would take the episode from a node that is alive.
        offer = Offer.decode(data)
        if offer.node != record.node:
            return b"another node has it"
        return (await self.claims.claim(record, offer)).encode()

    def give_up(self, episode: str, target: NodeReport | None = None) -> None:
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
                    await self._release(record)
            await self.bus.delete(Bucket.NODES, self.name)
        except BusError as error:
            get_logger().warning("the others do not know that this node left", error=str(error))


def other_nodes(members: Iterable[NodeReport], own: NodeReport) -> list[str]:
    """Return the addresses of the other nodes."""
    return [report.url for report in members if report.name != own.name]
