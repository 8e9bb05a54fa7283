"""Episodes that are over, for those who have missed the end: what they saw last."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from robotouille.errors import ProtocolError, RecordingError, RobotouilleError
from robotouille.replay.frames import is_closed, plain
from robotouille.replay.recorder import Recorder
from robotouille.replay.recording import Recording
from robotouille.replay.restore import Restored, restoring
from robotouille.world.world import shared_world
from robotouille_server.journal import CLOSED, OPEN, Journal, name_in
from robotouille_server.logs import get_logger
from robotouille_server.room import Room
from robotouille_server.storage import Storage

__all__ = ["Archive", "Found", "episode_of"]

MAX_BYTES = 8 * 1024 * 1024
"""Of a recording, uncompressed, from which an end is shown."""
MAX_STEPS = 20_000
"""Of an episode whose end is shown."""
FRAMES_A_TURN = 10
"""Are gone through in one turn of the event loop: a millisecond or two."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Found:
    """An episode and its recording; `journal` is None if it is over."""

    head: dict[str, Any]
    restored: Restored
    recorder: Recorder
    journal: Journal | None


class TooLongError(RecordingError):
    """It would take too long to show how an episode ended."""


class Archive:
    """Finds closed recordings by episode, and makes a room with the end of one (`adopt`).

    That is done beside the games: a file is read in a thread, and then gone through a few frames
    in each turn of the event loop, so that no game waits for it; one recording at a time.
    """

    def __init__(self, storage: Storage, adopt: Callable[[Found], Room]) -> None:
        self._storage = storage
        self._adopt = adopt
        self._names: dict[str, list[str]] = {}
        self._sought: dict[str, asyncio.Task[None]] = {}
        self._one_at_a_time = asyncio.Lock()

    def list(self, names: Iterable[str]) -> None:
        """The closed recordings among the files that there are."""
        self._names = {}
        for name in names:
            self.add(name)

    def add(self, name: str) -> None:
        """Another file."""
        if name.endswith(CLOSED):
            self._names.setdefault(episode_of(name), []).append(name)

    def has(self, episode: str) -> bool:
        """Whether there is a closed recording of an episode."""
        if episode not in self._names:
            try:
                self.list(self._storage.names())
            except OSError as error:
                get_logger().error("recordings not listed", error=str(error))
        return episode in self._names

    async def show(self, episode: str) -> None:
        """Make a room with the end of an episode; without one if that fails. ProtocolError if it
        would take too long."""
        task = self._sought.get(episode)
        if task is None:
            task = self._sought[episode] = asyncio.create_task(self._show(episode))
            task.add_done_callback(lambda _: self._sought.pop(episode, None))
        await asyncio.shield(task)

    def stop(self) -> None:
        """Look for nothing any more."""
        for task in list(self._sought.values()):
            task.cancel()

    async def _show(self, episode: str) -> None:
        async with self._one_at_a_time:
            for name in self._names.get(episode, ()):
                try:
                    found = await self._found(name)
                except TooLongError as error:
                    get_logger().info("end not shown", file=name, reason=str(error))
                    message = f"the episode is over, and {error}; say hello without 'resume'"
                    raise ProtocolError("auth/expired", message, "resume") from None
                except (RobotouilleError, OSError) as error:
                    get_logger().error("recording not read", file=name, error=str(error))
                    continue
                self._adopt(found)
                return

    async def _found(self, name: str) -> Found:
        loop = asyncio.get_running_loop()
        content = await loop.run_in_executor(None, self._content, name)
        recording = await _in_turns(Recording.opening(content, name, closed=True))
        its_own = name_in(recording.header).removesuffix(OPEN) + CLOSED
        if name != its_own:
            raise RecordingError(f"a copy of {its_own}")
        if recording.length > MAX_STEPS:
            raise TooLongError(f"has more than {MAX_STEPS:,} steps")
        restored = await _in_turns(restoring(recording, loop.time(), 0.0, shared_world))
        recorder = Recorder(restored.episode.world, recording.version)
        return Found(recording.header, restored, recorder, None)

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
