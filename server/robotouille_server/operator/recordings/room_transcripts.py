"""Recent events of rooms, read from their recordings."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Container, Iterable

from robotouille.errors import RecordingError
from robotouille_server.operator.load import HeavyJobs
from robotouille_server.operator.models import LogLine
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.operator.recordings.store import NewFrames, ReadableStorage, Transcript
from robotouille_server.operator.rows import recording_name
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.logs import get_logger

MAX_TRANSCRIPTS = 256


class RoomTranscript:
    """Recent events of one room's recording, shared by everyone who watches the room."""

    def __init__(self, room: Room, storage: ReadableStorage, jobs: HeavyJobs) -> None:
        self._room = room
        self._storage = storage
        self._jobs = jobs
        self._transcript = Transcript(lambda row: room.world.action(*row).sentence)
        self._read = ("", 0)
        self._reading = asyncio.Lock()

    @property
    def lines(self) -> Iterable[LogLine]:
        """Lines for the events, oldest first."""
        return self._transcript.lines

    async def catch_up(self) -> None:
        """Read the new frames of the recording.

        If the recording cannot be read, the lines stay as they are. The room reports the problem.

        Raises:
            RequestRefusedError: There are no lines yet, and too many other jobs wait.
        """
        async with self._reading:
            room = self._room
            name, size = recording_name(room), room.journal.size if room.journal is not None else 0
            if not name or (name, size) == self._read:
                return
            try:
                new = await self._jobs.run(self._new_frames, name)
            except (OSError, RecordingError) as error:
                get_logger().debug("recording not read", file=name, error=str(error))
                return
            except RequestRefusedError:
                if not self._read[0]:
                    raise
                return
            self._transcript.add(new)
            self._read = name, size

    def _new_frames(self, name: str) -> NewFrames:
        with self._storage.open(name) as file:
            return self._transcript.new_frames(file)


class RoomTranscripts:
    """Transcripts of the rooms that were watched last."""

    def __init__(self, storage: ReadableStorage, jobs: HeavyJobs) -> None:
        self._storage = storage
        self._jobs = jobs
        self._kept: OrderedDict[str, RoomTranscript] = OrderedDict()

    def of(self, room: Room) -> RoomTranscript:
        """Return the transcript of a room."""
        found = self._kept.pop(room.id, None) or RoomTranscript(room, self._storage, self._jobs)
        self._kept[room.id] = found
        if len(self._kept) > MAX_TRANSCRIPTS:
            self._kept.popitem(last=False)
        return found

    def forget(self, rooms: Container[str]) -> None:
        """Forget the rooms that no longer exist; `rooms` contains those that do."""
        for gone in [name for name in self._kept if name not in rooms]:
            del self._kept[gone]
