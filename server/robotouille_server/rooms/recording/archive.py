"""Archive of ended episodes, for participants who have missed the end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

from robotouille.errors import ProtocolError, RecordingError, RobotouilleError
from robotouille.replay.compression import is_closed, plain
from robotouille.replay.file_names import CLOSED, OPEN, recording_stem
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restoring
from robotouille.world.world import shared_world
from robotouille_server.rooms.recording.journal import EpisodeJournal, name_in
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.work_in_turns import in_turns

MAX_BYTES = 8 * 1024 * 1024
"""Maximum uncompressed size of a recording whose end is shown."""
MAX_STEPS = 20_000
"""Maximum number of steps of an episode whose end is shown."""
LIST_SECONDS = 5.0
"""Minimum seconds between two listings of the folder."""
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


@dataclass(frozen=True, slots=True)
class Listing:
    """Recordings of a folder: the closed ones by episode, and the names of the others."""

    closed: dict[str, list[str]]
    open: list[str]


class TooLongError(RecordingError):
    """The recording is too long to show how its episode ended."""


class Archive:
    """Finds closed recordings by episode, and makes a room with the final state (`adopt`).

    No running episode waits for this. Listing the folder and reading a file happen in a thread;
    the frames are replayed a few at a time, in many turns of the event loop. Recordings are
    replayed one at a time, and refused recordings are not read again.

    Args:
        storage: Where recordings are kept.
        adopt: Makes a room of an episode.
        found_open: Called with the names of the recordings that a listing finds open.
    """

    def __init__(
        self,
        storage: Storage,
        adopt: Callable[[ArchivedEpisode], object],
        found_open: Callable[[list[str]], None],
    ) -> None:
        self._storage = storage
        self._adopt = adopt
        self._found_open = found_open
        self._names: dict[str, list[str]] = {}
        self._sought: dict[str, asyncio.Task[None]] = {}
        # Each search may hold 8 MiB of frames and a whole episode in memory.
        self._one_at_a_time = asyncio.Lock()
        self._refused: dict[str, str] = {}
        self._listing: asyncio.Task[None] | None = None
        """Listing that has not begun."""
        self._listings: set[asyncio.Task[None]] = set()
        self._listed = -LIST_SECONDS
        self._missed: set[str] = set()

    def renew(self, listing: Listing) -> None:
        """Replace the known recordings by those of a new listing."""
        self._names = listing.closed
        self._found_open(listing.open)

    def add(self, name: str) -> None:
        """Add a closed recording."""
        self._names.setdefault(episode_of(name), []).append(name)

    def may_have(self, episode: str) -> bool:
        """Return whether an episode may have a closed recording, without listing the folder.

        The answer is False right after a search that has failed.
        """
        # A failed search is not repeated before the folder may be listed again. Otherwise, invalid
        # resume tokens could make the server list a large folder all the time.
        return episode in self._names or episode not in self._missed or self._may_list

    @property
    def _may_list(self) -> bool:
        return asyncio.get_running_loop().time() >= self._listed + LIST_SECONDS

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
        """Cancel all searches and listings."""
        tasks = [*self._listings, *self._sought.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _show(self, episode: str) -> None:
        if episode not in self._names:
            await self._list_again()
            if episode not in self._names:
                self._missed.add(episode)
                return
        async with self._one_at_a_time:
            for name in self._names.get(episode, ()):
                found = await self._readable(name)
                if found is not None:
                    self._adopt(found)
                    return

    async def _list_again(self) -> None:
        """Wait for a listing that begins after this call. Concurrent callers share it."""
        await asyncio.shield(self.list_soon())

    def list_soon(self) -> asyncio.Task[None]:
        """List the folder once that is due; return the task."""
        if self._listing is None:
            self._listing = asyncio.create_task(self._list_when_due())
            self._listings.add(self._listing)
            self._listing.add_done_callback(self._listings.discard)
        return self._listing

    async def _list_when_due(self) -> None:
        loop = asyncio.get_running_loop()
        # Listing a folder of many thousand files takes long, so it is done at most once in
        # `LIST_SECONDS`.
        await asyncio.sleep(self._listed + LIST_SECONDS - loop.time())
        self._listing = None
        self._listed = loop.time()
        self._missed.clear()
        try:
            self.renew(await loop.run_in_executor(None, listing_of, self._storage))
        except OSError as error:
            get_logger().error("recordings not listed", error=str(error))

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


def listing_of(storage: Storage) -> Listing:
    """List a folder. With 100,000 files, this takes a tenth of a second or more."""
    listing = Listing({}, [])
    for name in storage.names():
        if name.endswith(CLOSED):
            listing.closed.setdefault(episode_of(name), []).append(name)
        elif name.endswith(OPEN):
            listing.open.append(name)
    return listing


def episode_of(name: str) -> str:
    """Return the episode's id in the name of a recording."""
    return recording_stem(name).rpartition("_")[2]
