"""Deletion of journals that no record of the directory names.

A node that dies between the first write of a journal and the registration of its episode leaves
such a journal. So does a node that dies before it has deleted the journal of an unused episode.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robotouille.errors import RecordingError
from robotouille.replay.recording import Recording
from robotouille_server.cluster.bus import Bus, BusError
from robotouille_server.cluster.episodes.directory import Directory
from robotouille_server.cluster.episodes.journal import assembled
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.work_in_turns import in_turns

SWEEP_SECONDS = 45.0
"""Seconds between two looks at all journals. An episode is registered within ten, or not at all."""


class Strays:
    """Journals without a record, in which nobody has played."""

    def __init__(self, bus: Bus, directory: Directory) -> None:
        self._bus = bus
        self._directory = directory
        self._unknown: set[str] = set()
        self._left: set[str] = set()

    async def run(self, chosen: Callable[[], bool]) -> None:
        """Delete stray journals from time to time, while this node is the `chosen` one."""
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            try:
                if chosen():
                    await self.sweep()
            except BusError as error:
                get_logger().debug("journals not tidied", error=str(error))
            except Exception:
                get_logger().exception("journals not tidied")

    async def sweep(self) -> None:
        """Delete the journals that were unknown the last time, too."""
        journals = await self._bus.journals()
        unknown = {name for name in journals if self._directory.find(name) is None}
        again, self._unknown = sorted(unknown & self._unknown - self._left), unknown
        for episode in again:
            await self._delete(episode)

    async def _delete(self, episode: str) -> None:
        try:
            content = assembled(await self._bus.read(episode))
            # Players can make long journals, so other games take turns.
            recording = await in_turns(Recording.opening(content, episode, closed=False))
        except RecordingError as error:
            self._leave(episode, str(error))
            return
        # The copy of the directory may be behind.
        await self._directory.look(str(recording.header.get("code", "")))
        if self._directory.find(episode) is not None:
            return
        if recording.length or any(_names_somebody(note) for note in recording.notes()):
            self._leave(episode, "participants have joined it")
            return
        await self._bus.purge(episode)
        get_logger().info("journal without an episode deleted", episode=episode)

    def _leave(self, episode: str, why: str) -> None:
        """Leave a journal to the operator, because it may be of value."""
        self._left.add(episode)
        get_logger().warning("journal without an episode", episode=episode, reason=why)


def _names_somebody(note: dict[str, object]) -> bool:
    return note["note"] == "roster" and bool(note["name"])
