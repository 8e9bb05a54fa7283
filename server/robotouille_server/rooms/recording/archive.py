"""Archive of ended episodes, for participants who have missed the end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from robotouille.errors import ProtocolError, RecordingError, RobotouilleError
from robotouille.replay.compression import is_closed, plain
from robotouille.replay.file_names import CLOSED, OPEN
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restoring
from robotouille.world.world import shared_world
from robotouille_server.rooms.recording.folder_lister import FolderLister
from robotouille_server.rooms.recording.journal import EpisodeJournal, name_in
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.work_in_turns import in_turns

MAX_BYTES = 8 * 1024 * 1024
"""Maximum uncompressed size of a recording whose end is shown."""
MAX_STEPS = 20_000
"""Maximum number of steps of an episode whose end is shown."""
MAX_SOUGHT = 64
"""Maximum number of concurrent searches."""
MAX_REFUSED = 1024
"""Maximum number of refused files that are remembered."""


@dataclass(frozen=True, slots=True)
class ArchivedEpisode:
    """Episode read from a recording. `journal` is None if the episode has ended."""

    head: dict[str, Any]
    restored: Restored
    recorder: Recorder
    journal: EpisodeJournal | None


class TooLongError(RecordingError):
    """The recording is too long to show how its episode ended."""


class Archive:
    """Finds closed recordings by episode, and makes a room with the final state (`adopt`).

    No running episode waits for this. A thread reads a file; the frames are replayed a few at a
    time, in many turns of the event loop. Recordings are replayed one at a time, and refused
    recordings are not read again.

    Args:
        storage: Where recordings are kept.
        lister: Lists the recordings.
        adopt: Makes a room of an episode.
    """

    def __init__(
        self,
        storage: Storage,
        lister: FolderLister,
        adopt: Callable[[ArchivedEpisode], object],
    ) -> None:
        self._storage = storage
        self._lister = lister
        self._adopt = adopt
        self._sought: dict[str, asyncio.Task[None]] = {}
        # Each search may hold 8 MiB of frames and a whole episode in memory.
        self._one_at_a_time = asyncio.Lock()
        self._refused: dict[str, str] = {}
        self._missed: set[str] = set()
        """Episodes that the listing begun at `_missed_since` lacks."""
        self._missed_since = 0.0

    def may_have(self, episode: str) -> bool:
        """Return whether an episode may have a closed recording, without listing the folder.

        The answer is False right after a search that has failed.
        """
        # A failed search is not repeated before the folder may be listed again. Otherwise, invalid
        # resume tokens could make the server list a large folder all the time.
        return (
            episode in self._lister.closed or not self._was_missed(episode) or self._lister.is_due
        )

    async def show(self, episode: str) -> None:
        """Open a room with the end of an episode, if its recording is found.

        Raises:
            ProtocolError: The search takes too long, or too many searches are under way.
        """
        task = self._sought.get(episode)
        if task is None:
            # This bounds the number of tasks that clients with old tokens can create.
            if len(self._sought) >= MAX_SOUGHT:
                raise _expired("too many ended episodes are being searched for")
            task = self._sought[episode] = asyncio.create_task(self._show(episode))
            task.add_done_callback(lambda _: self._sought.pop(episode, None))
        # Clients that ask for the same episode share the task, so one that disconnects must not
        # cancel it.
        await asyncio.shield(task)

    async def stop(self) -> None:
        """Cancel all searches."""
        for task in (searches := list(self._sought.values())):
            task.cancel()
        await asyncio.gather(*searches, return_exceptions=True)

    async def _show(self, episode: str) -> None:
        if episode not in self._lister.closed:
            await self._lister.wait()
            if episode not in self._lister.closed:
                self._miss(episode)
                return
        async with self._one_at_a_time:
            for name in self._lister.closed.get(episode, ()):
                found = await self._readable(name)
                if found is not None:
                    self._adopt(found)
                    return

    def _miss(self, episode: str) -> None:
        """Remember until the next listing begins that an episode has no closed recording."""
        if self._missed_since != self._lister.begun:
            self._missed_since = self._lister.begun
            self._missed.clear()
        self._missed.add(episode)

    def _was_missed(self, episode: str) -> bool:
        return self._missed_since == self._lister.begun and episode in self._missed

    async def _readable(self, name: str) -> ArchivedEpisode | None:
        """Return the episode of a file; None if it is unreadable, ProtocolError if too long."""
        refused = self._refused.get(name)
        # Unreadable and too long files never change, so clients must not make the server read them
        # again and again.
        if refused is None:
            try:
                return await self._found(name)
            except OSError as error:  # Not remembered: the next attempt may succeed.
                get_logger().error("recording not read", file=name, error=str(error))
                return None
            except TooLongError as error:
                refused = str(error)
                get_logger().info("end not shown", file=name, reason=refused)
            except RobotouilleError as error:
                refused = ""
                get_logger().error("recording not read", file=name, error=str(error))
            self._refuse(name, refused)
        if refused:
            raise _expired(f"the episode has ended, and its recording {refused}")
        return None

    def _refuse(self, name: str, why: str) -> None:
        """Remember that a file is refused, and the reason for clients (empty if unreadable)."""
        while len(self._refused) >= MAX_REFUSED:
            del self._refused[next(iter(self._refused))]
        self._refused[name] = why

    async def _found(self, name: str) -> ArchivedEpisode:
        loop = asyncio.get_running_loop()
        # A thread reads and decompresses the file, because both block. Replaying frames is Python
        # code, so the event loop does it in small parts.
        content = await loop.run_in_executor(None, self._content, name)
        recording = await in_turns(_opening(content, name))
        original = name_in(recording.header).removesuffix(OPEN) + CLOSED
        # A renamed copy may have been changed, and must not be shown instead of the original.
        if name != original:
            raise RecordingError(f"a copy of {original}")
        restored = await in_turns(restoring(recording, loop.time(), 0.0, shared_world))
        recorder = Recorder(restored.episode.world)
        return ArchivedEpisode(recording.header, restored, recorder, None)

    def _content(self, name: str) -> bytes:
        content = self._storage.read(name)
        if not is_closed(content):
            raise RecordingError("not closed")
        stream, fault = plain(content, MAX_BYTES)
        # `plain` stops soon after the limit: a small file may expand to gigabytes.
        if len(stream) > MAX_BYTES:
            raise TooLongError(f"has more than {MAX_BYTES:,} bytes")
        if fault:
            raise RecordingError(fault)
        return stream


def _opening(content: bytes, name: str) -> Generator[None, None, Recording]:
    """Read a closed recording frame by frame; stop at the first step beyond `MAX_STEPS`."""
    reading = Recording.opening(content, name, closed=True)
    while True:
        try:
            steps = next(reading)
        except StopIteration as end:
            recording: Recording = end.value
            return recording
        if steps > MAX_STEPS:
            raise TooLongError(f"has more than {MAX_STEPS:,} steps")
        yield


def _expired(why: str) -> ProtocolError:
    return ProtocolError("auth/expired", f"{why}; send hello without 'resume'", "resume")
