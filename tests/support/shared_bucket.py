"""Bucket of a cluster in memory, and nodes that share secrets through it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from robotouille_server.auth.revocation import revoke
from robotouille_server.cluster.bus import Bucket, Bus, ConflictError, Entry, UnavailableError
from robotouille_server.cluster.keys.secrets import SharedSecrets

NOW = 1_800_000_000.0
CLUSTER_KEY = bytes(range(32))
Changed = Callable[[str, Entry | None], None]


def errors(logs: list[Any]) -> list[str]:
    """Return the errors in captured logs."""
    return [line["error"] for line in logs if line["log_level"] == "error"]


class Shared:
    """Bucket in memory, and the connections to it."""

    def __init__(self) -> None:
        self.entries: dict[str, Entry] = {}
        self.revision = 0
        self.links: list[Link] = []
        self.requests = 0

    def change(self, key: str, value: bytes | None) -> int:
        """Change a value, and let all nodes know at once: before the writer gets its answer."""
        self.revision += 1
        if value is None:
            self.entries.pop(key, None)
        else:
            self.entries[key] = Entry(value, self.revision)
        for link in self.links:
            link.pending.append((key, self.entries.get(key)))
            link.deliver()
        return self.revision

    def delete(self) -> None:
        """Replace the bucket by an empty one. No node receives its changes."""
        self.entries, self.revision = {}, 0
        for link in self.links:
            link.forget()


class Link:
    """Connection of one node, with the part of `Bus` that concerns buckets.

    `up` is False while the node cannot reach the bucket, `deaf` is True while changes do not
    arrive, and `answers` is False while requests are done but not answered.
    """

    def __init__(self, shared: Shared) -> None:
        self.up, self.answers, self.deaf = True, True, False
        self.pending: list[tuple[str, Entry | None]] = []
        self._shared = shared
        self._changed: list[Changed] = []
        shared.links.append(self)

    def forget(self) -> None:
        self.pending, self._changed = [], []

    def deliver(self) -> None:
        while self.pending and self.up and not self.deaf:
            change = self.pending.pop(0)
            for changed in self._changed:
                changed(*change)

    async def _reach(self) -> None:
        await asyncio.sleep(0)
        self._shared.requests += 1
        if not self.up:
            raise UnavailableError("NATS does not answer")

    def _answer(self, revision: int) -> int:
        if not self.answers:
            raise UnavailableError("NATS does not answer")
        return revision

    async def get(self, bucket: Bucket, key: str) -> Entry | None:
        assert bucket is Bucket.SHARED
        await self._reach()
        return self._shared.entries.get(key)

    async def create(self, bucket: Bucket, key: str, value: bytes) -> int:
        assert bucket is Bucket.SHARED
        await self._reach()
        if key in self._shared.entries:
            raise ConflictError(key)
        return self._answer(self._shared.change(key, value))

    async def update(self, bucket: Bucket, key: str, value: bytes, revision: int) -> int:
        assert bucket is Bucket.SHARED
        await self._reach()
        found = self._shared.entries.get(key)
        if found is None or found.revision != revision:
            raise ConflictError(key)
        return self._answer(self._shared.change(key, value))

    async def delete(self, bucket: Bucket, key: str) -> None:
        assert bucket is Bucket.SHARED
        await self._reach()
        self._shared.change(key, None)

    async def watch(self, bucket: Bucket, changed: Changed) -> None:
        assert bucket is Bucket.SHARED
        await self._reach()
        self._changed = [changed]
        self.pending = []
        for key, entry in list(self._shared.entries.items()):
            changed(key, entry)


class Node:
    """Node with its files."""

    def __init__(
        self,
        shared: Shared,
        folder: Path,
        *,
        key: bytes | None = None,
        own_keys: bool = False,
        wall: Callable[[], float] = lambda: NOW,
    ) -> None:
        self.link = Link(shared)
        self.keys = folder / "state" / "keys.json"
        self.revoked = self.keys.with_name("revoked.json")
        bus = cast("Bus", self.link)
        file = None if own_keys else self.keys
        self.secrets = SharedSecrets(bus, file, self.revoked, key, wall)

    def revoke(self, *ids: str, expires: float = NOW) -> None:
        revoke(self.revoked, ids, expires, NOW)
