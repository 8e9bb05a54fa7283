"""Episodes that are over, for those who have missed the end: what they saw last."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from robotouille.errors import ProtocolError, RecordingError, RobotouilleError
from robotouille.replay.container import is_closed, plain
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restoring
from robotouille.world.world import shared_world
from robotouille_server.rooms.recordings.journal import CLOSED, OPEN, Journal, name_in
from robotouille_server.rooms.recordings.storage import Storage
from robotouille_server.runtime.logs import get_logger

__all__ = ["Archive", "ArchivedEpisode", "episode_of"]

MAX_BYTES = 8 * 1024 * 1024
"""Of a recording, uncompressed, from which an end is shown."""
MAX_STEPS = 20_000
"""Of an episode whose end is shown."""
FRAMES_A_TURN = 10
"""Are gone through in one turn of the event loop: a millisecond or two."""
LIST_SECONDS = 5.0
"""From one listing of the folder for those who ask to the next."""
MAX_SOUGHT = 64
"""Episodes that are looked for at a time."""
MAX_REFUSED = 1024
"""Files of which it is remembered that no end is shown, and why."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ArchivedEpisode:
    """An episode and its recording; `journal` is None if it is over."""

    head: dict[str, Any]
    restored: Restored
    recorder: Recorder
    journal: Journal | None


class TooLongError(RecordingError):
    """It would take too long to show how an episode ended."""


class Archive:
    """Finds closed recordings by episode, and makes a room with the end of one (`adopt`).

    That is done beside the games: the folder is listed and a file is read in a thread, and then
    gone through a few frames in each turn of the event loop, so that no game waits for it; one
    recording at a time, and none again that was refused.
    """

    def __init__(self, storage: Storage, adopt: Callable[[ArchivedEpisode], object]) -> None:
        self._storage = storage
        self._adopt = adopt
        self._names: dict[str, list[str]] = {}
        self._sought: dict[str, asyncio.Task[None]] = {}
        self._one_at_a_time = asyncio.Lock()
        self._refused: dict[str, str] = {}
        self._listing: asyncio.Task[None] | None = None
        self._listed = -LIST_SECONDS
        self._missed: set[str] = set()

    def list(self, names: Iterable[str]) -> None:
        """The closed recordings among the files that there are."""
        self._names = {}
        for name in names:
            self.add(name)

    def add(self, name: str) -> None:
        """Another file."""
        if name.endswith(CLOSED):
            self._names.setdefault(episode_of(name), []).append(name)

    def may_have(self, episode: str) -> bool:
        """Whether there is, as far as is known without a look at the folder, a closed recording
        of an episode; False if one was looked for just now, in vain."""
        return episode in self._names or episode not in self._missed or self._may_list

    @property
    def _may_list(self) -> bool:
        return asyncio.get_running_loop().time() >= self._listed + LIST_SECONDS

    async def show(self, episode: str) -> None:
        """Make a room with the end of an episode; without one if that fails. ProtocolError if it
        would take too long, or if too many others are looked for."""
        task = self._sought.get(episode)
        if task is None:
            if len(self._sought) >= MAX_SOUGHT:
                raise _gone("the ends of too many other episodes are looked for")
            task = self._sought[episode] = asyncio.create_task(self._show(episode))
            task.add_done_callback(lambda _: self._sought.pop(episode, None))
        await asyncio.shield(task)

    def stop(self) -> None:
        """Look for nothing any more."""
        if self._listing is not None:
            self._listing.cancel()
        for task in list(self._sought.values()):
            task.cancel()

    async def _show(self, episode: str) -> None:
        if episode not in self._names:
            await self._list_anew()
            if episode not in self._names:
                self._missed.add(episode)
                return
        async with self._one_at_a_time:
            for name in self._names.get(episode, ()):
                found = await self._readable(name)
                if found is not None:
                    self._adopt(found)
                    return

    async def _list_anew(self) -> None:
        """Wait for a listing that begins after now; all who ask meanwhile wait for the same."""
        if self._listing is None:
            self._listing = asyncio.create_task(self._list_when_due())
        await asyncio.shield(self._listing)

    async def _list_when_due(self) -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(self._listed + LIST_SECONDS - loop.time())
        self._listing = None
        self._listed = loop.time()
        self._missed.clear()
        try:
            self.list(await loop.run_in_executor(None, self._storage.names))
        except OSError as error:
            get_logger().error("recordings not listed", error=str(error))

    async def _readable(self, name: str) -> ArchivedEpisode | None:
        """What a file holds; None if it cannot be read, ProtocolError if it is too long."""
        refused = self._refused.get(name)
        if refused is None:
            try:
                return await self._found(name)
            except OSError as error:  # It may be well again the next time.
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
            raise _gone(f"the episode is over, and {refused}")
        return None

    def _refuse(self, name: str, why: str) -> None:
        """Remember that no end is shown from a file, and what those who ask are told."""
        while len(self._refused) >= MAX_REFUSED:
            del self._refused[next(iter(self._refused))]
        self._refused[name] = why

    async def _found(self, name: str) -> ArchivedEpisode:
        loop = asyncio.get_running_loop()
        content = await loop.run_in_executor(None, self._content, name)
        recording = await _in_turns(_opening(content, name))
        its_own = name_in(recording.header).removesuffix(OPEN) + CLOSED
        if name != its_own:
            raise RecordingError(f"a copy of {its_own}")
        restored = await _in_turns(restoring(recording, loop.time(), 0.0, shared_world))
        recorder = Recorder(restored.episode.world, recording.version)
        return ArchivedEpisode(recording.header, restored, recorder, None)

    def _content(self, name: str) -> bytes:
        content = self._storage.read(name)
        if not is_closed(content):
            raise RecordingError("it is not closed")
        stream, fault = plain(content, MAX_BYTES)
        if len(stream) > MAX_BYTES:
            raise TooLongError(f"has more than {MAX_BYTES:,} bytes")
        if fault:
            raise RecordingError(fault)
        return stream


def _opening(content: bytes, name: str) -> Generator[None, None, Recording]:
    """Read a closed recording frame by frame, up to the step that is one too many."""
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


def _gone(why: str) -> ProtocolError:
    """To be answered by a `hello` without 'resume'."""
    return ProtocolError("auth/expired", f"{why}; say hello without 'resume'", "resume")


async def _in_turns(work: Generator[None, None, T]) -> T:
    """Do some work bit by bit; others have their turns in between."""
    while True:
        try:
            for _ in range(FRAMES_A_TURN):
                next(work)
        except StopIteration as end:
            found: T = end.value
            return found
        await asyncio.sleep(0)


def episode_of(name: str) -> str:
    """The episode's id in a recording's name."""
    return name.removesuffix(OPEN).removesuffix(CLOSED).rpartition("_")[2]
