"""Recordings of a server for operators: list, downloads, archives and replays."""

from __future__ import annotations

import asyncio
import copy
from collections.abc import AsyncIterator, Collection, Mapping
from http import HTTPStatus
from io import BytesIO
from typing import BinaryIO

from robotouille.episode import Phase
from robotouille.replay.file_names import CLOSED
from robotouille_server.app import Server
from robotouille_server.cluster.members import NodeReport
from robotouille_server.operator.forwarding import MAX_ANSWER_BYTES, too_large
from robotouille_server.operator.load import HeavyJobs, Turns
from robotouille_server.operator.models import RecordingPage, RecordingRow
from robotouille_server.operator.other_nodes import EpisodeElsewhereError, OtherNodes
from robotouille_server.operator.principal import Principal, RequestRefusedError, note
from robotouille_server.operator.recordings.archive import MAX_ARCHIVED, archive
from robotouille_server.operator.recordings.replay_pages import ReplayPages
from robotouille_server.operator.recordings.store import (
    ReadableStorage,
    RecordingStore,
    pieces,
    unknown_recording,
)
from robotouille_server.operator.rows import recording_name, rooms_of

MAX_MERGED = 1000
"""Newest recordings that are listed in a cluster. The nodes send all rows before a page."""


class StoredRecordings:
    """Recordings of a server's storage, limited to what a principal may see."""

    def __init__(
        self,
        server: Server,
        storage: ReadableStorage,
        jobs: HeavyJobs,
        turns: Turns,
        others: OtherNodes | None,
    ) -> None:
        self._server = server
        self._store = RecordingStore(storage)
        self._replays = ReplayPages(server.settings.tasks)
        self._jobs = jobs
        self._turns = turns
        self._others = others
        self._principal = Principal()

    def for_principal(self, principal: Principal) -> StoredRecordings:
        """Return these recordings for another principal."""
        recordings = copy.copy(self)
        recordings._principal = principal
        return recordings

    async def page(self, search: str, limit: int, offset: int) -> RecordingPage:
        """Return a page of the list of recordings, newest first, of all nodes of a cluster.

        Raises:
            RequestRefusedError: The page is too far from the newest recordings of a cluster.
        """
        if self._others is None or self._principal.via:
            return await self._own_page(search, limit, offset)
        if offset + limit > MAX_MERGED:
            message = f"a cluster lists the {MAX_MERGED} newest recordings; search for fewer"
            status = HTTPStatus.BAD_REQUEST
            raise RequestRefusedError(status, "request/invalid", message, field="offset")
        own, others = await asyncio.gather(
            self._own_page(search, offset + limit, 0),
            self._others.recordings(self._principal, search, offset + limit),
        )
        pages = [own, *(page for _, page in others)]
        rows = sorted((row for page in pages for row in page.recordings), key=_by_name)[::-1]
        return RecordingPage(
            found=sum(page.found for page in pages), recordings=rows[offset : offset + limit]
        )

    async def _own_page(self, search: str, limit: int, offset: int) -> RecordingPage:
        live = {
            recording_name(room): room.id
            for room in rooms_of(self._server.lobby, self._principal)
            if room.episode.phase is not Phase.ENDED
        }
        only = self._only()
        return await self._jobs.run(self._store.page, search, limit, offset, live, only)

    def _only(self) -> str:
        """Return the end of the names that the principal may see, or "" for all."""
        return self.only_file() if self._principal.only_episode else ""

    async def archived(self, names: Collection[str], search: str) -> dict[str, NodeReport | None]:
        """Return the recordings in an archive, newest first, each with its node if it is another.

        Args:
            names: The wanted recordings; empty for all that a search finds.
            search: Words that all occur in the names, codes, tasks, labels or players.

        Raises:
            RequestRefusedError: A name is unknown, or there are too many recordings.
        """
        own = await self._jobs.run(self._store.found, search, self._only())
        found: dict[str, NodeReport | None] = dict.fromkeys(own)
        if self._others is not None and not self._principal.via:
            pages = await self._others.recordings(self._principal, search, MAX_MERGED)
            found |= {row.name: node for node, page in pages for row in page.recordings}
        wanted = set(names)
        if unknown := wanted.difference(found):
            raise unknown_recording(min(unknown))
        chosen = [name for name in sorted(found, reverse=True) if not wanted or name in wanted]
        if len(chosen) > MAX_ARCHIVED:
            message = (
                f"{len(chosen)} recordings match, and an archive holds {MAX_ARCHIVED}; "
                "search for fewer"
            )
            status = HTTPStatus.BAD_REQUEST
            raise RequestRefusedError(status, "request/invalid", message, field="search")
        return {name: found[name] for name in chosen}

    def archive(self, names: Mapping[str, NodeReport | None]) -> AsyncIterator[bytes]:
        """Return a tar file of recordings, each up to its last complete frame."""
        self._note("archive", count=str(len(names)))

        async def opened(name: str) -> tuple[BinaryIO, int]:
            await self._turns.next()
            node = names[name]
            if node is None or self._others is None:
                return await self._opened_again(name)
            content = await self._others.recording(node, self._principal, name)
            return BytesIO(content), len(content)

        return archive(list(names), opened, self._server.wall())

    async def _opened_again(self, name: str) -> tuple[BinaryIO, int]:
        """Open a recording, also if its episode has ended since it was listed."""
        try:
            return await self._jobs.run(self._store.opened, name, self._live_size(name))
        except RequestRefusedError:
            closed = name.removesuffix(".part")
            if closed == name:
                raise
            return await self._jobs.run(self._store.opened, closed, None)

    async def content(self, name: str) -> tuple[int, AsyncIterator[bytes]]:
        """Return the size and content of a recording, up to its last complete frame."""
        file, size = await self._opened(name)
        if self._others is not None and self._principal.via and size > MAX_ANSWER_BYTES:
            file.close()
            raise too_large(self._others.own)
        self._note("recording", file=name)
        return size, pieces(file, size)

    async def replay(self, name: str) -> bytes:
        """Return the data of the page that shows a recording, as compressed JSON."""
        file, size = await self._opened(name)
        data = await self._replays.data(name, file, size)
        self._note("replay", file=name)
        return data

    async def _opened(self, name: str) -> tuple[BinaryIO, int]:
        """Return the file of a recording and its size, or refuse it, or send to its node."""
        closed_name = name.removesuffix(".part")
        if self._principal.only_episode and not closed_name.endswith(self.only_file()):
            self._principal.require_episode()
        try:
            return await self._jobs.run(self._store.opened, name, self._live_size(name))
        except RequestRefusedError as refused:
            if refused.code != "recording/unknown" or self._others is None or self._principal.via:
                raise
            node = await self._others.node_with_recording(self._principal, name)
            if node is None:
                raise
            raise EpisodeElsewhereError(node, name) from None

    def _live_size(self, name: str) -> int | None:
        """Return the size of a recording that an episode of this server writes."""
        journals = (room.journal for room in self._server.lobby.rooms.values())
        return next((j.size for j in journals if j is not None and j.name == name), None)

    def only_file(self) -> str:
        """Return the end of the name of the only recording that the principal may see.

        Recordings are named after the episode's id. If the token has a code instead, the id is
        known only while the episode is on the server.
        """
        ids = (room.id for room in rooms_of(self._server.lobby, self._principal))
        return f"_{next(ids, self._principal.only_episode.lower())}{CLOSED}"

    def _note(self, what: str, **details: str) -> None:
        note(self._server.audit, self._principal, what, **details)


def _by_name(row: RecordingRow) -> str:
    return row.name
