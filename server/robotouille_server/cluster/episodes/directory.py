"""Directory of the nodes of all episodes: a copy of a bucket that all nodes share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille.errors import ProtocolError
from robotouille.protocol.join_codes import plain_code
from robotouille_server.cluster.bus import Bucket, Bus, ConflictError, Entry
from robotouille_server.cluster.members import Members
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import ElsewhereError, WorkerSlot, is_id


class EpisodeRecord(BaseModel):
    """Facts that all nodes know about an episode.

    Attributes:
        episode: The episode's id.
        code: The code with which participants join.
        node: The name of its node, or empty if its node has left and no other was there.
        claim: The sequence number with which the node took over the journal; the highest one wins.
        file: The file name of the recording.
        owner: The pseudonym of the participant who opened it.
        reserved: True if it was opened in advance and nobody has joined yet.
        ended: True if its recording is stored and the journal deleted.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    episode: str
    code: str
    node: str
    claim: int = 0
    file: str = ""
    owner: str = ""
    reserved: bool = False
    ended: bool = False

    @property
    def key(self) -> str:
        return plain_code(self.code)

    @property
    def state(self) -> tuple[int, bool]:
        """The claim, and whether the episode has ended. It only ever grows."""
        return self.claim, self.ended


class Directory:
    """Records of all episodes.

    The copy may be a moment behind the bucket. A node that takes an outdated record for current is
    refused by the journal.

    Attributes:
        observer: Called with the id of each episode whose record has changed or is gone.
    """

    def __init__(self, bus: Bus) -> None:
        self.observer: Callable[[str], None] = _ignore
        self._bus = bus
        self._by_code: dict[str, EpisodeRecord] = {}
        self._by_id: dict[str, str] = {}
        self._revisions: dict[str, int] = {}

    def changed(self, key: str, entry: Entry | None) -> None:
        """Note a change of the bucket."""
        if entry is None:
            self._remove(key)
            return
        try:
            record = EpisodeRecord.model_validate_json(entry.value)
        except ValidationError:
            get_logger().error("the cluster has an invalid record of an episode", code=key)
            return
        known = self._by_code.get(key)
        # News may come in another order than the changes, and after an operator has deleted the
        # bucket its revisions begin again. So the claim decides, and then the end.
        if known is not None and known.state > record.state:
            return
        self._by_code[key] = record
        self._by_id[record.episode] = key
        self._revisions[key] = entry.revision
        self.observer(record.episode)

    def _remove(self, key: str) -> None:
        known = self._by_code.pop(key, None)
        self._revisions.pop(key, None)
        if known is not None:
            self._by_id.pop(known.episode, None)
            self.observer(known.episode)

    def find(self, name: str) -> EpisodeRecord | None:
        """Return the record of an episode by id or code."""
        key = self._by_id.get(name) if is_id(name) else plain_code(name)
        return self._by_code.get(key or "")

    def __iter__(self) -> Iterator[EpisodeRecord]:
        return iter(list(self._by_code.values()))

    def __len__(self) -> int:
        return len(self._by_code)

    # Changes by this node

    async def add(self, record: EpisodeRecord) -> None:
        """Add a new episode; raise ConflictError if its code exists."""
        value = record.model_dump_json(exclude_defaults=True).encode()
        revision = await self._bus.create(Bucket.EPISODES, record.key, value)
        self.changed(record.key, Entry(value, revision))

    async def replace(self, record: EpisodeRecord) -> bool:
        """Replace a record, unless another node has claimed the episode later, or it has ended.

        Returns:
            False if another node has it, or if it has ended.
        """
        value = record.model_dump_json(exclude_defaults=True).encode()
        if await self._replace_known(record, value):
            return True
        while True:
            current = await self._bus.get(Bucket.EPISODES, record.key)
            try:
                if current is None:
                    revision = await self._bus.create(Bucket.EPISODES, record.key, value)
                else:
                    before = EpisodeRecord.model_validate_json(current.value)
                    if before.state > record.state:
                        self.changed(record.key, current)
                        return False
                    revision = await self._bus.update(
                        Bucket.EPISODES, record.key, value, current.revision
                    )
            except ConflictError:
                continue
            self.changed(record.key, Entry(value, revision))
            return True

    async def _replace_known(self, record: EpisodeRecord, value: bytes) -> bool:
        """Replace a record if the copy of it is current. A game waits for this, so nothing is read.

        Returns:
            False if the copy is behind the bucket, or missing.
        """
        known, revision = self._by_code.get(record.key), self._revisions.get(record.key)
        if known is None or revision is None or known.state > record.state:
            return False
        try:
            revision = await self._bus.update(Bucket.EPISODES, record.key, value, revision)
        except ConflictError:
            return False
        self.changed(record.key, Entry(value, revision))
        return True

    async def remove(self, record: EpisodeRecord) -> None:
        """Remove an episode that is over."""
        await self._bus.delete(Bucket.EPISODES, record.key)
        self._remove(record.key)

    async def look(self, code: str) -> None:
        """Read the record of a code again, because the copy may be behind."""
        key = plain_code(code)
        # Keys of NATS have few characters, and a client may send anything as a code.
        if key.isascii() and key.isalpha():
            entry = await self._bus.get(Bucket.EPISODES, key)
            if entry is not None:
                self.changed(key, entry)


def _ignore(episode: str) -> None:
    """Do nothing: nobody on this node is interested in other nodes' episodes."""


@dataclass(frozen=True, slots=True)
class ClusterSlot(WorkerSlot):
    """Position of a process among the nodes of a cluster."""

    directory: Directory | None = None
    members: Members | None = None

    def owns(self, episode: str) -> bool:
        """Return False: nodes claim episodes from the cluster and not from files."""
        return False

    def check_here(self, name: str, code: str, code_length: int) -> None:
        """Raise ElsewhereError if another node has an episode.

        Raises:
            ProtocolError: `server/handover` if no node has it at the moment.
        """
        if self.directory is None or self.members is None:
            return
        record = self.directory.find(name)
        if record is None:
            return
        node = self.members.find(record.node)
        if node is None or (node is self.members.own and not record.ended):
            message = "this episode is being handed over; try again in a moment"
            raise ProtocolError("server/handover", message, "episode")
        if node is not self.members.own:
            raise ElsewhereError(record.episode, 0, node.url)
