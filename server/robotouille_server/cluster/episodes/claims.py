"""Taking episodes over from nodes that are gone, or that hand them over."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restoration, Restored
from robotouille.world.world import shared_world
from robotouille_server.cluster.bus import Append, Bus, BusError, ConflictError, Stored
from robotouille_server.cluster.episodes.closing import Closing
from robotouille_server.cluster.episodes.directory import Directory, EpisodeRecord
from robotouille_server.cluster.episodes.journal import (
    JournalEnd,
    JournalKeeper,
    ReplicatedJournal,
    assembled,
)
from robotouille_server.rooms.recording.archive import ArchivedEpisode, in_turns
from robotouille_server.rooms.recording.journal import name_in
from robotouille_server.runtime.logs import get_logger

CLAIMS_AT_A_TIME = 3
"""Episodes taken over at a time. With more, all come back late, because they share a processor."""
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
    """

    adopt: Callable[[ArchivedEpisode], object]
    wall: Callable[[], float]
    now: Callable[[], float]
    patience: float


@dataclass(frozen=True, slots=True)
class Prepared:
    """Journal that was read before its episode is handed over, and the episode until then."""

    stored: list[Stored]
    restoration: Restoration


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
        self._limit = asyncio.Semaphore(CLAIMS_AT_A_TIME)
        self._count = 0

    def under_way(self, episode: str) -> bool:
        """Return whether an episode is being claimed."""
        return episode in self._under_way

    async def prepare(self, record: EpisodeRecord) -> None:
        """Restore most of an episode that will be handed over soon, while it is played.

        Raises:
            RobotouilleError: That is not possible.
        """
        stored = await self._bus.read(record.episode)
        recording = Recording(assembled(stored), record.file)
        restoration = Restoration(recording, self._continuation.now(), shared_world)
        await in_turns(restoration.replay(but_last=HELD_BACK))
        self._prepared[record.episode] = Prepared(stored, restoration)
        while len(self._prepared) > MAX_PREPARED:
            del self._prepared[next(iter(self._prepared))]

    async def claim(self, record: EpisodeRecord, *, handed_over: bool = False) -> str:
        """Take an episode over; return why that was not possible, or an empty text.

        Args:
            record: The episode.
            handed_over: True if its node lives and gives it up.
        """
        if record.episode in self._under_way:
            return "it is being claimed already"
        self._under_way.add(record.episode)
        try:
            async with self._limit:
                return await self._continue(record, handed_over=handed_over)
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

    async def _continue(self, record: EpisodeRecord, *, handed_over: bool) -> str:
        # The copy of the directory may be behind, and the episode in good hands.
        if await self._has_changed(record):
            return "another node was first"
        last = await self._bus.last(record.episode)
        if last is None:
            # Its node has died after it had deleted the journal, or an operator has deleted it.
            await self._directory.remove(record)
            return "it has no journal"
        prepared = self._prepared.pop(record.episode, None)
        stored = await self._fence(record, last.sequence, prepared)
        content, sequence = assembled(stored), stored[-1].sequence
        try:
            recording, restored = await self._restored(content, record, prepared)
        except RecordingError:
            # Another node may have stored the whole recording, and be deleting the journal.
            if await self._has_changed(record):
                return "another node was first"
            raise
        if restored.complete:
            await self._closing.finish(record.episode, record.file, kept=True, content=content)
            return "it has ended"
        # While a node hands its episodes over, NATS has confirmed what they wrote.
        keep = restored.kept if handed_over else max(0, restored.kept - RESTATED)
        sequence = await self._restate(record, sequence, content, restored, keep)
        mine = record.model_copy(update={"node": self._keeper.name, "claim": sequence})
        if not await self._directory.replace(mine):
            return "another node was first"
        now = asyncio.get_running_loop().time
        world, frames = restored.episode.world, recording.count
        recorder = Recorder(world, self._continuation.wall, now, frames)
        end = JournalEnd(sequence, restored.kept + len(restored.missing))
        journal = ReplicatedJournal(self._keeper, record.episode, record.file, recorder, end=end)
        found = ArchivedEpisode(recording.header, restored, recorder, journal)
        self._continuation.adopt(found)
        return ""

    async def _has_changed(self, record: EpisodeRecord) -> bool:
        """Read a record again, and return whether another node has the episode, or it is over."""
        await self._directory.look(record.code)
        current = self._directory.find(record.episode)
        known = (record.node, record.claim, record.ended)
        return current is None or (current.node, current.claim, current.ended) != known

    async def _restored(
        self, content: bytes, record: EpisodeRecord, prepared: Prepared | None
    ) -> tuple[Recording, Restored]:
        recording = Recording(content, record.file)
        # Anybody who can write to the bucket chooses this name, and a file of that name would be
        # replaced or deleted.
        if (file := name_in(recording.header)) != record.file:
            raise RecordingError(f"the journal is that of {file}, and not of {record.file!r}")
        if recording.header["episode"] != record.episode:
            raise RecordingError("the journal is that of another episode")
        try:
            restoration = prepared.restoration if prepared is not None else None
            if restoration is None or not restoration.continue_with(recording):
                restoration = Restoration(recording, self._continuation.now(), shared_world)
            await in_turns(restoration.replay())
            now, patience = self._continuation.now(), self._continuation.patience
            return recording, restoration.finish(now, patience)
        except RecordingError as error:
            raise RecordingError(f"the journal cannot be continued: {error}") from None

    async def _fence(
        self, record: EpisodeRecord, last: int, prepared: Prepared | None
    ) -> list[Stored]:
        """Take a journal over from its former owner, and return its messages.

        NATS compares the expected sequence number when a message arrives, but not when it stores
        the message. So it may store a write of the former owner that was under way at the time of
        the claim, before or after it, and the former owner goes on. A second message shows that
        nothing came after the claim, and then nothing can come any more.

        Raises:
            ConflictError: The former owner, or a third node, has written.
        """
        claim = await self._append(record, last)
        fence = await self._append(record, claim)
        known = prepared.stored if prepared is not None else []
        stored = known + await self._bus.read(record.episode, known[-1].sequence if known else 0)
        if [message.sequence for message in stored[-2:]] != [claim, fence]:
            raise ConflictError("another node has written to the journal")
        return stored

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
