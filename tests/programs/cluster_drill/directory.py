"""The nodes of all episodes, as NATS stores them, and the times at which nodes took them over."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from robotouille_server.cluster.bus import Bucket, Entry
from robotouille_server.cluster.episodes.directory import EpisodeRecord
from robotouille_server.cluster.members import parse_report
from robotouille_server.cluster.nats.nats_bus import NatsAddress, nats_bus

__all__ = ["Observer", "Takeover", "observing"]

LOOK_SECONDS = 0.02


@dataclass(frozen=True, slots=True)
class Takeover:
    """A change of an episode's node. `by` is empty if the former node released the episode."""

    at: float
    episode: str
    by: str


class Observer:
    """Copy of the cluster's buckets, which are observed without a node.

    Attributes:
        records: The records of all episodes, by id.
        takeovers: All takeovers since the drill began.
    """

    def __init__(self) -> None:
        self.records: dict[str, EpisodeRecord] = {}
        self.takeovers: list[Takeover] = []
        self._urls: dict[str, str] = {}
        self._ids: dict[str, str] = {}

    def episode_changed(self, key: str, entry: Entry | None) -> None:
        """Note a change of a record."""
        if entry is None:
            self.records.pop(self._ids.pop(key, ""), None)
            return
        record = EpisodeRecord.model_validate_json(entry.value)
        known = self.records.get(record.episode)
        self._ids[key] = record.episode
        self.records[record.episode] = record
        if known is not None and known.node != record.node:
            self.takeovers.append(Takeover(time.monotonic(), record.episode, record.node))

    def node_changed(self, key: str, entry: Entry | None) -> None:
        """Note the report of a node."""
        if entry is not None and (report := parse_report(entry.value)) is not None:
            self._urls[key] = report.url

    def episodes_of(self, url: str) -> set[str]:
        """Return the episodes of the node with an address that have not ended."""
        return {
            record.episode
            for record in self.records.values()
            if self._urls.get(record.node) == url and not record.ended
        }

    def url_of(self, episode: str) -> str:
        """Return the address of an episode's node, or an empty text."""
        record = self.records.get(episode)
        return self._urls.get(record.node, "") if record is not None else ""

    async def lost(self, episodes: Iterable[str], seconds: float) -> set[str]:
        """Wait until other processes have these episodes; return those that nobody has taken over.

        Episodes that end are not waited for.
        """
        before = {name: self.records[name].node for name in episodes if name in self.records}
        deadline = time.monotonic() + seconds
        while True:
            waiting = {name for name, node in before.items() if self._waits(name, node)}
            if not waiting or time.monotonic() > deadline:
                return waiting
            await asyncio.sleep(LOOK_SECONDS)

    def _waits(self, episode: str, node: str) -> bool:
        record = self.records.get(episode)
        return record is not None and not record.ended and record.node in ("", node)

    def taken_over_at(self, episodes: Iterable[str], since: float) -> dict[str, float]:
        """Return when other nodes took episodes over for the last time since a time."""
        wanted = set(episodes)
        return {
            change.episode: change.at
            for change in self.takeovers
            if change.by and change.at >= since and change.episode in wanted
        }


@asynccontextmanager
async def observing(servers: Iterable[str]) -> AsyncIterator[Observer]:
    """Observe the buckets of a cluster."""
    observer = Observer()
    async with nats_bus(NatsAddress(tuple(servers), "robotouille")) as bus:
        await bus.watch(Bucket.NODES, observer.node_changed)
        await bus.watch(Bucket.EPISODES, observer.episode_changed)
        yield observer
