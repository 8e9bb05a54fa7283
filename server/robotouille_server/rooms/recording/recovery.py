"""Recovery of episodes that another process has left, from their recordings."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from typing import Generic, TypeVar

from robotouille.errors import RecordingError, RobotouilleError
from robotouille.protocol.join_codes import plain_code
from robotouille.replay.container import MAGIC, read_frames
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restore
from robotouille.world.world import shared_world
from robotouille_server.rooms.recording.archive import Archive, ArchivedEpisode
from robotouille_server.rooms.recording.folder_lister import FolderLister, episode_of
from robotouille_server.rooms.recording.journal import (
    Journal,
    RecordedRoom,
    close_recording,
    name_in,
)
from robotouille_server.rooms.recording.storage import Appender, Storage
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import WorkerSlot

RoomT = TypeVar("RoomT", bound=RecordedRoom)

RETRY_SECONDS = 0.5
"""Seconds between two attempts to take over episodes that another process still has."""
FORGET_SECONDS = 60.0
"""Seconds between two checks whether recordings that cannot be continued are still there."""


class Recovery(Generic[RoomT]):
    """Finds recordings that are not closed, and continues them.

    Args:
        storage: Where recordings are kept.
        worker: Decides which recordings belong to this process.
        return_seconds: The seconds that players have to come back.
        adopt: Makes a room of an episode.
        now: Returns the time of the rooms.
        wall: Returns the seconds since 1970, for new events.

    Attributes:
        archive: The recordings of ended episodes.
    """

    def __init__(
        self,
        storage: Storage,
        worker: WorkerSlot,
        return_seconds: float,
        adopt: Callable[[ArchivedEpisode], RoomT],
        now: Callable[[], float],
        wall: Callable[[], float],
    ) -> None:
        self._given_up: dict[str, str] = {}
        self._delayed: dict[str, str] = {}
        self._storage = storage
        self._worker = worker
        self._return_seconds = return_seconds
        self._adopt = adopt
        self._now = now
        self._wall = wall
        self._foreign: dict[str, str] = {}
        self._lister = FolderLister(storage, self._take_over_all)
        self.archive = Archive(storage, self._lister, adopt)
        self._rooms: Mapping[str, RoomT] = {}
        self._knows_folder = False
        self._seated: dict[str, RoomT] = {}
        self._retry_timer: asyncio.TimerHandle | None = None
        self._stopped = False

    def scan(self, rooms: Mapping[str, RoomT]) -> None:
        """Continue every recording that is not closed.

        This lists the folder at once, so call it only when a server starts. Recordings that another
        process still writes are taken over when it releases them.

        Args:
            rooms: The rooms of this process.
        """
        self._rooms = rooms
        try:
            self._lister.list_at_once()
        except OSError as error:
            get_logger().error("recordings not listed", error=str(error))
            self._retry_later()

    def _take_over_all(self, names: list[str]) -> None:
        """Continue the recordings that are not closed, which have these names."""
        if self._stopped:
            return
        self._knows_folder, there = True, set(names)
        self._foreign = {name: code for name, code in self._foreign.items() if name in there}
        self._delayed = {name: why for name, why in self._delayed.items() if name in there}
        self._given_up = {name: why for name, why in self._given_up.items() if name in there}
        for name in names:
            episode = episode_of(name)
            # Each worker restores only the episodes whose ids begin with its number, whoever wrote
            # them (docs/decisions/0017).
            if name in self._given_up or not self._worker.owns(episode):
                continue
            room = self._rooms.get(episode)
            if room is None:
                self._take_over(name)
            # If two files have the same episode id, continuing both would give two rooms the same
            # seats and tokens.
            elif room.journal is not None and room.journal.name != name:
                self._give_up(name, f"a copy of {room.journal.name}")
        self._retry_later()

    def _retry_later(self) -> None:
        """Retry soon, if another process may still have recordings that belong to this one.

        Otherwise, check after a while whether recordings that were given up are still there.
        """
        if self._retry_timer is not None:
            self._retry_timer.cancel()
            self._retry_timer = None
        if self._foreign or not self._knows_folder:
            seconds = RETRY_SECONDS
        elif self._given_up:
            seconds = FORGET_SECONDS
        else:
            return
        self._retry_timer = asyncio.get_running_loop().call_later(seconds, self._retry)

    def _retry(self) -> None:
        # The files are polled, because waiting for a lock would block the event loop. The folder
        # may have 100,000 files, so a thread lists it, less often.
        for name in self._locked(self._foreign):
            self._take_over(name)
        if self._foreign or self._given_up or not self._knows_folder:
            self._lister.schedule()
        self._retry_later()

    def _locked(self, names: Iterable[str]) -> list[str]:
        """Return those of the names that wait for nothing but their lock.

        The others have failed. An attempt may simulate the whole episode, so they wait for the next
        listing.
        """
        return [name for name in names if name not in self._delayed]

    def stop(self) -> None:
        """Take over no more recordings."""
        self._stopped = True
        if self._retry_timer is not None:
            self._retry_timer.cancel()

    async def close(self) -> None:
        """Cancel all searches in the archive and all listings of the folder."""
        self.stop()
        await self.archive.stop()
        await self._lister.stop()

    # Finding

    @property
    def unrestored(self) -> dict[str, str]:
        """Files that could not be continued (yet), with the reasons."""
        return {**self._given_up, **self._delayed}

    def seated(self, session: str) -> RoomT | None:
        """Return the room in which a session held seats in an earlier process, and still does."""
        room = self._seated.get(session)
        return room if room is not None and room.players_of(session) else None

    def elsewhere(self, name: str) -> bool:
        """Return whether another process still has the episode with an id or code.

        If the process has just released the episode, it is taken over. Anyone can send wrong codes,
        so other files are not touched.
        """
        code = plain_code(name)
        files = [
            file
            for file, known in self._foreign.items()
            if (known and known == code) or episode_of(file) == name
        ]
        for file in self._locked(files):
            self._take_over(file)
        return any(file in self._foreign for file in files)

    def forget(self, room: RoomT) -> None:
        """Forget a room that is closed."""
        self._seated = {name: home for name, home in self._seated.items() if home is not room}

    # Taking over

    def _take_over(self, name: str) -> None:
        try:
            file = self._storage.resume(name)
        except FileNotFoundError:
            self._foreign.pop(name, None)
            self._delayed.pop(name, None)
            return
        # Another process holds the lock. The episode's code is read once, so that clients that send
        # it get `server/handover` instead of "unknown episode".
        except BlockingIOError:
            if name not in self._foreign:
                self._foreign[name] = self._code_of(name)
            return
        except OSError as error:
            self._try_later(name, error)
            return
        self._foreign.pop(name, None)
        kept = False
        try:
            kept = self._continue(name, file)
            self._delayed.pop(name, None)
        except FileNotFoundError:  # The other process has just closed the recording.
            self._delayed.pop(name, None)
        except OSError as error:
            self._try_later(name, error)
        except RobotouilleError as error:
            self._give_up(name, str(error))
        except Exception as error:
            # An invalid recording must not keep the server from restoring the others.
            get_logger().exception("episode not restored", file=name)
            self._give_up(name, f"internal error: {error!r}")
        finally:
            if not kept:
                file.close()

    def _continue(self, name: str, file: Appender) -> bool:
        """Make a room of a file; return whether the room keeps the file open."""
        content = self._storage.read(name)
        if _has_no_header(content):
            # Nothing was published before the header was complete (write-ahead rule), so nothing is
            # lost.
            self._storage.remove(name)
            return False
        recording = Recording(content, name)
        # A renamed copy has the header, and therefore the episode id, of its original.
        if (original := name_in(recording.header)) != name:
            raise RecordingError(f"a copy of {original}")
        restored = self._restored(recording)
        # A torn end is kept next to the file: it is the only evidence of what was lost
        # (docs/decisions/0021).
        self._cut(name, file, content, restored.kept)
        if restored.missing:
            file.append(restored.missing)
        size = restored.kept + len(restored.missing)
        # If the recording is complete, the process died after the footer, before it closed the
        # file.
        if restored.complete:
            closed = close_recording(self._storage, name, file.read(), size)
            self._lister.add_closed(closed)
            return False
        world, totals = restored.episode.world, copy(recording.totals)
        recorder = Recorder(world, self._wall, self._now, totals)
        journal = Journal(self._storage, name, recorder, found=file, size=size)
        room = self._adopt(ArchivedEpisode(recording.header, restored, recorder, journal))
        for seat in restored.episode.seats.values():
            if seat.taken:
                # Tokens from before the join do not name the episode, but they name the session.
                self._seated[seat.session] = room
        return True

    def _cut(self, name: str, file: Appender, content: bytes, kept: int) -> None:
        """Cut an incomplete end off a file, and keep it in another file."""
        torn = content[kept:]
        if not torn:
            return
        names, cut_name, number = self._storage.names(), f"{name}.cut", 1
        while cut_name in names:
            number += 1
            cut_name = f"{name}.cut{number}"
        self._storage.replace(cut_name, torn)
        file.cut(kept)
        get_logger().warning(
            "recording was incomplete", file=name, at=kept, bytes=len(torn), kept_in=cut_name
        )

    def _restored(self, recording: Recording) -> Restored:
        return restore(recording, self._now(), self._return_seconds, shared_world)

    def _code_of(self, name: str) -> str:
        try:
            head = next(read_frames(self._storage.read(name)), {})
        except (OSError, RecordingError):
            head = {}
        return plain_code(str(head.get("code", "")))

    def _try_later(self, name: str, error: OSError) -> None:
        """Retry later, for example after a full disk, as if another process had the episode."""
        problem = f"not restored yet: {error.strerror or error}"
        if self._delayed.get(name) != problem:
            get_logger().error("episode not restored yet", file=name, error=problem)
        # A full disk or missing permission is temporary. Giving up would end the episode for good.
        self._delayed[name] = problem
        self._foreign[name] = self._code_of(name)

    def _give_up(self, name: str, reason: str) -> None:
        self._delayed.pop(name, None)
        self._given_up[name] = reason
        get_logger().error("episode not restored", file=name, error=reason)


def _has_no_header(content: bytes) -> bool:
    """Return whether a file ends before its first frame is complete."""
    if len(content) < len(MAGIC):
        return MAGIC.startswith(content)
    return content[:4] == MAGIC[:4] and next(read_frames(content), None) is None
