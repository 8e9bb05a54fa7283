"""Taking episodes over from nodes that are gone, or that hand them over."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restoration, Restored
from robotouille.world.world import shared_world
from robotouille_server.cluster.bus import Append, Bus, BusError, ConflictError, Stored
from robotouille_server.cluster.episodes.closing import Closing
from robotouille_server.cluster.episodes.directory import Directory, EpisodeRecord
from robotouille_server.cluster.episodes.handing_over import Offer
from robotouille_server.cluster.episodes.journal import (
    JournalEnd,
    JournalKeeper,
    ReplicatedJournal,
    assembled,
)
from robotouille_server.cluster.episodes.journal_turns import SHORT_JOURNAL, JournalTurns
from robotouille_server.rooms.recording.archive import ArchivedEpisode
from robotouille_server.rooms.recording.journal import name_in
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.work_in_turns import in_turns

MAX_PREPARED = 16
"""Episodes in memory that were restored in advance."""
RESTATED = 128 * 1024
"""Last bytes of a journal that its new owner writes again. It has a second of steps many times."""
HELD_BACK = 2
"""Frames that are not restored in advance: the last step may lack its keyframe."""


@dataclass(frozen=True, slots=True)
class Continuation:
    """Settings and callbacks for episodes that continue on this node.

    Attributes:
        adopt: Makes a room of an episode.
        wall: Returns the seconds since 1970, for new events.
        now: Returns the time of the rooms, which excludes the time in which the process was
            suspended.
        patience: The seconds for which an episode waits for its players.
        abandoned: Returns whether no other node has an episode.
    """

    adopt: Callable[[ArchivedEpisode], object]
    wall: Callable[[], float]
    now: Callable[[], float]
    patience: float
    abandoned: Callable[[EpisodeRecord], bool]


@dataclass(frozen=True, slots=True)
class Prepared:
    """Journal that was read before its episode is handed over, and the episode until then."""

    stored: list[Stored]
    restoration: Restoration


@dataclass(frozen=True, slots=True)
class _Taken:
    """Journal that this node has taken over.

    Attributes:
        content: Its bytes.
        sequence: The number of its last message.
        prepared: The part that was read and restored before, if any.
    """

    content: bytes
    sequence: int
    prepared: Prepared | None


class Claims:
    """Episodes that this node takes over.

    Attributes:
        refused: Episodes that it could not continue, with the reasons.
    """

    def __init__(
        self,
        bus: Bus,
        directory: Directory,
        keeper: JournalKeeper,
        closing: Closing,
        continuation: Continuation,
    ) -> None:
        self.refused: dict[str, str] = {}
        self._bus = bus
        self._directory = directory
        self._keeper = keeper
        self._closing = closing
        self._continuation = continuation
        self._under_way: set[str] = set()
        self._prepared: dict[str, Prepared] = {}
        self._turns = JournalTurns()
        self._count = 0

    def under_way(self, episode: str) -> bool:
        """Return whether an episode is being claimed."""
        return episode in self._under_way

    async def prepare(self, record: EpisodeRecord) -> None:
        """Restore most of an episode that will be handed over soon, while it is played.

        Raises:
            RobotouilleError: That is not possible.
        """
        async with self._turns.reading():
            size, stored = await self._read_if_short(record.episode)
            if stored is not None:
                await self._prepare(record, stored)
                return
        async with self._turns.replaying_long(size):
            await self._prepare(record, await self._bus.read(record.episode))

    async def _read_if_short(self, episode: str) -> tuple[int, list[Stored] | None]:
        """Return the bytes of a journal, and its messages unless it is long.

        Long ones would fill the memory while they wait for their turns.
        """
        stored = await self._bus.read(episode)
        size = sum(len(message.data) for message in stored)
        return size, stored if size <= SHORT_JOURNAL else None

    async def _prepare(self, record: EpisodeRecord, stored: list[Stored]) -> None:
        recording = await _recording(assembled(stored), record)
        restoration = Restoration(recording, self._continuation.now(), shared_world)
        await in_turns(restoration.replay(but_last=HELD_BACK))
        self._prepared[record.episode] = Prepared(stored, restoration)
        while len(self._prepared) > MAX_PREPARED:
            del self._prepared[next(iter(self._prepared))]

    async def claim(self, record: EpisodeRecord, offer: Offer | None = None) -> str:
        """Take an episode over; return why that was not possible, or an empty text.

        Args:
            record: The episode.
            offer: The offer of its node, if that lives and gives it up.
        """
        if record.episode in self._under_way:
            return "it is being claimed already"
        self._under_way.add(record.episode)
        try:
            return await self._in_turn(record, offer)
        except ConflictError:
            return "another node was first"
        except BusError as error:
            return str(error)
        except RobotouilleError as error:
            return self._refuse(record, str(error))
        except Exception as error:
            get_logger().exception("episode not taken over", episode=record.episode)
            return self._refuse(record, f"internal error: {error!r}")
        finally:
            self._under_way.discard(record.episode)

    def _refuse(self, record: EpisodeRecord, why: str) -> str:
        self.refused[record.episode] = why
        get_logger().error("episode not taken over", episode=record.episode, error=why)
        return why

    async def _in_turn(self, record: EpisodeRecord, offer: Offer | None) -> str:
        # If the episode is prepared, there is little left to do.
        if offer is not None and record.episode in self._prepared:
            return await self._continue(record, offer)
        async with self._turns.reading():
            if record.episode in self._prepared:
                return await self._continue(record, offer)
            # A claim here would end the game at its node, long before the turn of a long journal.
            size, known = await self._read_if_short(record.episode)
            if known is not None:
                return await self._continue(record, offer, known)
        async with self._turns.replaying_long(size):
            if offer is None and not self._continuation.abandoned(record):
                return "its node has come back"
            return await self._continue(record, offer)

    async def _continue(
        self, record: EpisodeRecord, offer: Offer | None, known: Sequence[Stored] = ()
    ) -> str:
        taken = await self._take(record, offer, known)
        content, sequence = taken.content, taken.sequence
        try:
            recording, restored = await self._restored(content, record, taken.prepared)
        except RecordingError:
            # Another node may have stored the whole recording, and be deleting the journal.
            if await self._has_changed(record):
                return "another node was first"
            raise
        if restored.complete:
            await self._closing.finish(record.episode, record.file, kept=True, content=content)
            return "it has ended"
        # While a node hands its episodes over, NATS has confirmed what they wrote.
        keep = restored.kept if offer is not None else max(0, restored.kept - RESTATED)
        sequence = await self._restate(record, sequence, content, restored, keep)
        mine = record.model_copy(update={"node": self._keeper.name, "claim": sequence})
        if not await self._directory.replace(mine):
            return "another node was first"
        now = asyncio.get_running_loop().time
        world, wall = restored.episode.world, self._continuation.wall
        recorder = Recorder(world, wall, now, copy(recording.totals))
        end = JournalEnd(sequence, restored.kept + len(restored.missing))
        journal = ReplicatedJournal(self._keeper, record.episode, record.file, recorder, end=end)
        found = ArchivedEpisode(recording.header, restored, recorder, journal)
        self._continuation.adopt(found)
        return ""

    async def _take(
        self, record: EpisodeRecord, offer: Offer | None, known: Sequence[Stored]
    ) -> _Taken:
        """Take a journal over.

        Args:
            record: The episode.
            offer: The offer of its node, if that lives and gives it up.
            known: The first messages of the journal, if they were read before.

        Raises:
            ConflictError: Another node has the episode.
            BusError: The journal is missing, or NATS does not answer.
        """
        prepared = self._prepared.pop(record.episode, None)
        if offer is not None and (found := _offered(offer, prepared)) is not None:
            content, last_known = found
            # The journal ends as its owner says if the claim names that message as the last one.
            _, fence = await self._fence(record, last_known)
            return _Taken(content, fence, prepared)
        # The copy of the directory may be behind, and the episode in good hands.
        if await self._has_changed(record):
            raise ConflictError("the record has changed")
        last = await self._bus.last(record.episode)
        if last is None:
            # Its node has died after it had deleted the journal, or an operator has deleted it.
            await self._directory.remove(record)
            raise BusError("it has no journal")
        claim, fence = await self._fence(record, last.sequence)
        if prepared is not None:
            known = prepared.stored
        after = known[-1].sequence if known else 0
        stored = [*known, *await self._bus.read(record.episode, after)]
        if [message.sequence for message in stored[-2:]] != [claim, fence]:
            raise ConflictError("another node has written to the journal")
        return _Taken(assembled(stored), fence, prepared)

    async def _has_changed(self, record: EpisodeRecord) -> bool:
        """Read a record again, and return whether another node has the episode, or it is over."""
        await self._directory.look(record.code)
        current = self._directory.find(record.episode)
        known = (record.node, record.claim, record.ended)
        return current is None or (current.node, current.claim, current.ended) != known

    async def _restored(
        self, content: bytes, record: EpisodeRecord, prepared: Prepared | None
    ) -> tuple[Recording, Restored]:
        restoration = prepared.restoration if prepared is not None else None
        if restoration is None:
            recording = await _recording(content, record)
        else:
            recording = await in_turns(restoration.recording.extending(content))
        # Anybody who can write to the bucket chooses this name, and a file of that name would be
        # replaced or deleted.
        if (file := name_in(recording.header)) != record.file:
            raise RecordingError(f"the journal is that of {file}, and not of {record.file!r}")
        if recording.header["episode"] != record.episode:
            raise RecordingError("the journal is that of another episode")
        try:
            if restoration is None or not restoration.continue_with(recording):
                restoration = Restoration(recording, self._continuation.now(), shared_world)
            await in_turns(restoration.replay())
            now, patience = self._continuation.now(), self._continuation.patience
            return recording, restoration.finish(now, patience)
        except RecordingError as error:
            raise RecordingError(f"the journal cannot be continued: {error}") from None

    async def _fence(self, record: EpisodeRecord, last: int) -> tuple[int, int]:
        """Write twice to a journal as its new owner; return the sequence numbers.

        NATS compares the expected sequence number when a message arrives, but not when it stores
        the message. So it may store a write of the former owner that was under way at the time of
        the claim, before or after it, and the former owner goes on. If nothing came between the
        claim and the second message, nothing can come any more.

        Raises:
            ConflictError: The former owner, or a third node, has written.
        """
        claim = await self._append(record, last)
        return claim, await self._append(record, claim)

    async def _restate(
        self,
        record: EpisodeRecord,
        sequence: int,
        content: bytes,
        restored: Restored,
        keep: int,
    ) -> int:
        """Write a journal after its first `keep` bytes as it was read; return its last number.

        After a loss of power, the servers of NATS may differ for a while: messages that have not
        been acknowledged appear after they were read, or disappear. From now on the journal is what
        this node has read.
        """
        data = content[keep : restored.kept] + restored.missing
        if not data and keep == len(content):
            return sequence
        return await self._append(record, sequence, data, keep)

    async def _append(
        self, record: EpisodeRecord, last: int, data: bytes = b"", keep: int | None = None
    ) -> int:
        """Write to a journal as its new owner; return the sequence number of the write.

        Raises:
            ConflictError: The journal has a later message than `last`.
        """
        self._count += 1
        name = f"{record.episode}.{self._keeper.name}.claim.{self._count}"
        result: asyncio.Future[int] = asyncio.get_running_loop().create_future()

        def done(answer: int | BusError) -> None:
            if result.done():
                return
            if isinstance(answer, int):
                result.set_result(answer)
            else:
                result.set_exception(answer)

        self._bus.append(Append(record.episode, data, last, name, keep), done)
        return await result


async def _recording(content: bytes, record: EpisodeRecord) -> Recording:
    """Read a journal. Other games take turns, because a long one takes a tenth of a second."""
    return await in_turns(Recording.opening(content, record.file, closed=False))


def _offered(offer: Offer, prepared: Prepared | None) -> tuple[bytes, int] | None:
    """Return the journal of an offered episode and the number of its last message.

    None if this node must read it.
    """
    tail = offer.tail
    if tail is None or prepared is None:
        return None
    known = prepared.restoration.recording.stream
    # If a write was under way when this node read the journal, its bytes are in the tail, too.
    overlap = known[tail.start :]
    if len(known) < tail.start or not tail.data.startswith(overlap):
        return None
    return known + tail.data[len(overlap) :], tail.sequence
