"""Turning the journal of an ended episode into a file."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import partial

from robotouille.errors import RecordingError
from robotouille_server.cluster.bus import Bus, BusError
from robotouille_server.cluster.episodes.directory import Directory
from robotouille_server.cluster.episodes.journal import assembled
from robotouille_server.rooms.recording.journal import close_recording, in_closing_thread
from robotouille_server.rooms.recording.storage import Storage
from robotouille_server.runtime.logs import get_logger

RETRY_SECONDS = 1.0


@dataclass(frozen=True, slots=True)
class Closing:
    """Stores complete recordings in the node's folder and in the cluster's bucket of files."""

    bus: Bus
    directory: Directory
    storage: Storage

    async def finish(
        self, episode: str, name: str, *, kept: bool, content: bytes | None = None
    ) -> str:
        """Store a recording and delete its journal; try again until NATS has done it.

        Args:
            episode: The episode's id.
            name: The file name of the open recording.
            kept: False to delete the journal only.
            content: The journal, if the caller has read it already. Another node may be about to
                delete it.

        Returns:
            The file name of the closed recording, or an empty text.
        """
        reported = set[str]()
        while True:
            try:
                if kept and content is None:
                    content = assembled(await self.bus.read(episode))
                return await self._finish(episode, name, content if kept else b"", kept=kept)
            except BusError as error:
                if (reason := str(error)) not in reported:
                    get_logger().warning("recording not stored yet", file=name, error=reason)
                reported.add(reason)
            except (OSError, RecordingError) as error:
                get_logger().error("recording not closed", file=name, error=str(error))
                return ""
            await asyncio.sleep(RETRY_SECONDS)

    async def _finish(self, episode: str, name: str, content: bytes | None, *, kept: bool) -> str:
        whole = ""
        if content:
            # A thread does this, because compressing a long recording would delay steps.
            close = partial(close_recording, self.storage, name, content, len(content))
            whole = await in_closing_thread(close)
            await self.bus.store(whole, await in_closing_thread(partial(self.storage.read, whole)))
        record = self.directory.find(episode)
        if record is not None and kept:
            # Participants who were away still find the end here.
            await self.directory.replace(record.model_copy(update={"ended": True}))
        elif record is not None:
            await self.directory.remove(record)
        # The journal goes last: until then, another node can do all of this again.
        await self.bus.purge(episode)
        return whole
