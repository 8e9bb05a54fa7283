"""Episodes that another process has left: taken up from their recordings."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

from robotouille.errors import RecordingError, RobotouilleError
from robotouille.replay.container import MAGIC, VERSIONS, magic, read_frames
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restore
from robotouille.world.world import shared_world
from robotouille_server.rooms.recordings.archive import Archive, ArchivedEpisode, episode_of
from robotouille_server.rooms.recordings.journal import (
    OPEN,
    Journal,
    RecordedRoom,
    close_recording,
    name_in,
)
from robotouille_server.rooms.recordings.storage import Appender, Storage
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import WorkerSlot, plain_code

__all__ = ["Recovery"]

RoomT = TypeVar("RoomT", bound=RecordedRoom)

LOOK_AGAIN_SECONDS = 0.5
"""Between two looks at the episodes that another process still has."""


class Recovery(Generic[RoomT]):
    """Looks for recordings that are not closed. `adopt` makes a room of one.

    `unrestored` are files that cannot be gone on with, `problems` those that cannot yet, and why.
    The `archive` has the recordings that are closed. `now` is the rooms' time, `wall` the seconds
    since 1970, for what is recorded from here on.
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
        self.unrestored: dict[str, str] = {}
        self.problems: dict[str, str] = {}
        self._storage = storage
        self._worker = worker
        self._return_seconds = return_seconds
        self._adopt = adopt
        self._now = now
        self._wall = wall
        self._foreign: dict[str, str] = {}
        self.archive = Archive(storage, adopt)
        self._seated: dict[str, RoomT] = {}
        self._looking: asyncio.TimerHandle | None = None
        self._stopped = False

    def look(self, known: Mapping[str, RoomT]) -> None:
        """Go on with every recording that is not closed; those that another process still writes
        are taken over when it lets go. `known` are the episodes that are here already."""
        if self._stopped:
            return
        try:
            names = self._storage.names()
        except OSError as error:
            get_logger().error("recordings not listed", error=str(error))
            self._again(known)
            return
        self._foreign = {name: code for name, code in self._foreign.items() if name in names}
        self.archive.list(names)
        for name in names:
            episode = episode_of(name)
            mine = name.endswith(OPEN) and self._worker.owns(episode)
            if not mine or name in self.unrestored:
                continue
            room = known.get(episode)
            if room is None:
                self._take_over(name)
            elif room.journal is not None and room.journal.name != name:
                self._give_up(name, f"a copy of {room.journal.name}")
        if self._foreign:
            self._again(known)

    def _again(self, known: Mapping[str, RoomT]) -> None:
        if self._looking is None:
            loop = asyncio.get_running_loop()
            self._looking = loop.call_later(LOOK_AGAIN_SECONDS, self._look_again, known)

    def _look_again(self, known: Mapping[str, RoomT]) -> None:
        self._looking = None
        self.look(known)

    def stop(self) -> None:
        """Look no more."""
        self._stopped = True
        if self._looking is not None:
            self._looking.cancel()

    # Whom to find where

    def seated(self, session: str) -> RoomT | None:
        """The room in which a session had seats when its process stopped, and still has."""
        room = self._seated.get(session)
        return room if room is not None and room.players_of(session) else None

    def elsewhere(self, name: str, known: Mapping[str, RoomT]) -> bool:
        """Whether the episode of an id or code is still with another process."""
        if self._foreign:
            self.look(known)
        codes = {plain_code(code) for code in self._foreign.values() if code}
        episodes = {episode_of(file) for file in self._foreign}
        return name in episodes or plain_code(name) in codes

    def forget(self, room: RoomT) -> None:
        """A room is closed."""
        self._seated = {name: home for name, home in self._seated.items() if home is not room}

    # Taking over

    def _take_over(self, name: str) -> None:
        try:
            file = self._storage.resume(name)
        except FileNotFoundError:
            self._foreign.pop(name, None)
            return
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
            kept = self._go_on(name, file)
            self.problems.pop(name, None)
        except FileNotFoundError:
            pass  # Whoever had it has just closed the recording.
        except OSError as error:
            self._try_later(name, error)
        except RobotouilleError as error:
            self._give_up(name, str(error))
        except Exception as error:
            # A fault in one recording must not keep the others from going on.
            get_logger().exception("episode not restored", file=name)
            self._give_up(name, f"internal error: {error!r}")
        finally:
            if not kept:
                file.close()

    def _go_on(self, name: str, file: Appender) -> bool:
        """Make a room of a file; whether the room keeps it open."""
        content = self._storage.read(name)
        if _has_no_header(content):
            self._storage.remove(name)  # Torn in its header: nothing of it was published.
            return False
        recording = Recording(content, name)
        if (its_own := name_in(recording.header)) != name:
            raise RecordingError(f"a copy of {its_own}")
        restored = self._restored(recording)
        self._cut(name, file, content, restored.kept)
        if restored.missing:
            file.append(restored.missing)
        size = restored.kept + len(restored.missing)
        if restored.complete:
            closed = close_recording(self._storage, name, file.read(), size)
            self.archive.add(closed)
            return False
        recorder = Recorder(restored.episode.world, recording.version, self._wall)
        journal = Journal(self._storage, name, recorder, found=file, size=size)
        room = self._adopt(ArchivedEpisode(recording.header, restored, recorder, journal))
        for seat in restored.episode.seats.values():
            if seat.taken:
                self._seated[seat.session] = room
        return True

    def _cut(self, name: str, file: Appender, content: bytes, kept: int) -> None:
        """Cut what is torn off a file, and keep it in another one beside it."""
        torn = content[kept:]
        if not torn:
            return
        there, beside, number = self._storage.names(), f"{name}.cut", 1
        while beside in there:
            number += 1
            beside = f"{name}.cut{number}"
        self._storage.replace(beside, torn)
        file.cut(kept)
        get_logger().warning(
            "recording was torn", file=name, at=kept, bytes=len(torn), kept_in=beside
        )

    def _restored(self, recording: Recording) -> Restored:
        return restore(recording, self._now(), self._return_seconds, shared_world)

    def _code_of(self, name: str) -> str:
        try:
            head = next(read_frames(self._storage.read(name)), {})
        except (OSError, RecordingError):
            head = {}
        return str(head.get("code", ""))

    def _try_later(self, name: str, error: OSError) -> None:
        """A full disk, say: the episode waits, as if another process had it."""
        problem = f"not restored yet: {error.strerror or error}"
        if self.problems.get(name) != problem:
            get_logger().error("episode not restored yet", file=name, error=problem)
        self.problems[name] = problem
        self._foreign[name] = self._code_of(name)

    def _give_up(self, name: str, reason: str) -> None:
        self.unrestored[name] = reason
        get_logger().error("episode not restored", file=name, error=reason)


def _has_no_header(content: bytes) -> bool:
    """Whether a file was torn before its first frame was whole."""
    if len(content) < len(MAGIC):
        return any(magic(version).startswith(content) for version in VERSIONS)
    return content[:4] == MAGIC[:4] and next(read_frames(content), None) is None
