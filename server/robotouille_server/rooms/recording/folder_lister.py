"""Listing of the recordings in a folder that other processes change, too."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import NamedTuple

from robotouille.replay.file_names import CLOSED, OPEN, recording_stem
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.runtime.logs import get_logger

LIST_SECONDS = 5.0
"""Minimum seconds between two listings of the folder."""


class FolderLister:
    """Lists the folder in a thread, at most once in `LIST_SECONDS`.

    Callers that ask for the next listing share it.

    Args:
        storage: The folder.
        found_open: Called after each listing with the names of the recordings that are not closed.

    Attributes:
        closed: Names of the closed recordings, by episode.
        begun: Time at which the latest listing in a thread began.
    """

    def __init__(self, storage: Storage, found_open: Callable[[list[str]], None]) -> None:
        self.closed: dict[str, list[str]] = {}
        self.begun = -LIST_SECONDS
        self._storage = storage
        self._found_open = found_open
        self._next: asyncio.Task[None] | None = None
        """Listing that has not begun."""
        self._unfinished: set[asyncio.Task[None]] = set()

    @property
    def is_due(self) -> bool:
        """True if a listing that is scheduled now begins at once."""
        return asyncio.get_running_loop().time() >= self.begun + LIST_SECONDS

    def list_at_once(self) -> None:
        """List the folder, and block until this is done; raise OSError if it fails."""
        self._replace(_read(self._storage))

    def schedule(self) -> asyncio.Task[None]:
        """Schedule a listing as soon as it is due, and return its task."""
        if self._next is None:
            self._next = asyncio.create_task(self._list_when_due())
            self._unfinished.add(self._next)
            self._next.add_done_callback(self._unfinished.discard)
        return self._next

    async def wait(self) -> None:
        """Wait for a listing that begins after this call."""
        # Callers share the task, so one that is cancelled must not cancel it.
        await asyncio.shield(self.schedule())

    def add_closed(self, name: str) -> None:
        """Add a recording that was closed after the latest listing."""
        self.closed.setdefault(episode_of(name), []).append(name)

    async def stop(self) -> None:
        """Cancel all listings."""
        for task in (unfinished := list(self._unfinished)):
            task.cancel()
        await asyncio.gather(*unfinished, return_exceptions=True)

    async def _list_when_due(self) -> None:
        loop = asyncio.get_running_loop()
        await asyncio.sleep(self.begun + LIST_SECONDS - loop.time())
        self._next = None
        self.begun = loop.time()
        try:
            self._replace(await loop.run_in_executor(None, _read, self._storage))
        except OSError as error:
            get_logger().error("recordings not listed", error=str(error))

    def _replace(self, found: _Found) -> None:
        self.closed = found.closed
        self._found_open(found.open)


class _Found(NamedTuple):
    closed: dict[str, list[str]]
    open: list[str]


def _read(storage: Storage) -> _Found:
    # With 100,000 files, this takes a tenth of a second or more.
    found = _Found({}, [])
    for name in storage.names():
        if name.endswith(CLOSED):
            found.closed.setdefault(episode_of(name), []).append(name)
        elif name.endswith(OPEN):
            found.open.append(name)
    return found


def episode_of(name: str) -> str:
    """Return the episode's id in the name of a recording."""
    return recording_stem(name).rpartition("_")[2]
