"""Storage of a simulated NATS: journals, buckets and files, without messages in between."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field

from robotouille_server.cluster.bus import (
    Append,
    Bucket,
    ConflictError,
    Entry,
    Stored,
    UnavailableError,
)

__all__ = ["SimulatedStorage"]

NODE_KEY_SECONDS = 10.0
DUPLICATE_SECONDS = 120.0
"""Seconds for which NATS recognizes the id of a message."""
MAX_MESSAGE = 1024 * 1024
MAX_STALE = 1.0
"""Largest age of an answer of a server that is behind the others, in seconds."""


@dataclass(slots=True)
class _Value:
    """State of a key: `value` is None if it was deleted."""

    value: bytes | None
    revision: int
    at: float
    before: Entry | None

    @property
    def entry(self) -> Entry | None:
        return Entry(self.value, self.revision) if self.value is not None else None


class _KeyValues:
    """Bucket that keeps the last value of each key, in the order of the revisions.

    Attributes:
        created: Number of the bucket among all that were created.
        revision: Number of changes.
    """

    def __init__(self, created: int, seconds: float | None) -> None:
        self.created = created
        self.revision = 0
        self._seconds = seconds
        self._values: dict[str, _Value] = {}

    def find(self, key: str, now: float) -> _Value | None:
        self._expire(now)
        return self._values.get(key)

    def set(self, key: str, value: bytes | None, now: float) -> int:
        self._expire(now)
        before = self._values.pop(key, None)
        self.revision += 1
        entry = before.entry if before is not None else None
        self._values[key] = _Value(value, self.revision, now, entry)
        return self.revision

    def since(self, revision: int, now: float) -> list[tuple[str, Entry | None]]:
        """Return the last changes of all keys that have changed after a revision."""
        self._expire(now)
        return [(k, v.entry) for k, v in self._values.items() if v.revision > revision]

    def _expire(self, now: float) -> None:
        while self._seconds is not None and self._values:
            key, oldest = next(iter(self._values.items()))
            if oldest.at + self._seconds > now:
                return
            del self._values[key]


@dataclass
class SimulatedStorage:
    """State of the service.

    Attributes:
        now: Returns the time.
        chance: Decides which reads are stale.
        stale: The probability that a read is answered by a server that is behind the others.
        full: True while all appends are refused.
        files: The stored files.
        on_stored: Called with the writer, the journal and the message for every stored message.
        on_purged: Called with each journal that is deleted.
        on_set: Called with the bucket, the key and the value of every change.
    """

    now: Callable[[], float]
    chance: random.Random
    stale: float = 0.0
    full: bool = False
    files: dict[str, bytes] = field(default_factory=dict)
    on_stored: Callable[[str, str, Stored], None] | None = None
    on_purged: Callable[[str], None] | None = None
    on_set: list[Callable[[Bucket, str, bytes | None], None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._sequence = 0
        self._journals: dict[str, list[tuple[float, Stored]]] = {}
        self._ids: dict[str, tuple[float, int]] = {}
        self._created = 0
        self._buckets: dict[Bucket, _KeyValues] = {}
        self.prepare()

    # For tests

    @property
    def journals(self) -> list[str]:
        """Names of the journals that have messages."""
        return list(self._journals)

    def messages(self, journal: str) -> list[Stored]:
        """Return all messages of a journal."""
        return [message for _, message in self._journals.get(journal, [])]

    def values(self, bucket: Bucket) -> dict[str, bytes]:
        """Return the keys of a bucket with their values."""
        found = self._buckets.get(bucket)
        entries = found.since(0, self.now()) if found is not None else []
        return {key: entry.value for key, entry in entries if entry is not None}

    def delete_bucket(self, bucket: Bucket) -> None:
        """Delete a bucket, as an operator may do."""
        self._buckets.pop(bucket, None)

    def remove_message(self, journal: str, sequence: int) -> Callable[[], None]:
        """Remove a message, as a server does that is behind the others; return a way back."""
        messages = self._journals[journal]
        (index,) = (i for i, (_, one) in enumerate(messages) if one.sequence == sequence)
        removed = messages.pop(index)
        return lambda: messages.insert(index, removed)

    # Journals

    def append(self, writer: str, message: Append) -> int:
        """Store a message unless there is a later one, or return its number if it is known."""
        known = self.check(message)
        return self.apply(writer, message) if known is None else known

    def check(self, message: Append) -> int | None:
        """Refuse a message if there is a later one, or return its number if it is known."""
        known = self._ids.get(message.id)
        if known is not None and self.now() < known[0] + DUPLICATE_SECONDS:
            return known[1]
        if self.full or len(message.data) > MAX_MESSAGE:
            raise UnavailableError("NATS: maximum bytes exceeded")
        self._check_last(message)
        return None

    def _check_last(self, message: Append) -> None:
        journal = self._journals.get(message.subject, [])
        last = journal[-1][1].sequence if journal else 0
        if last != message.expected:
            raise ConflictError(f"wrong last sequence: {last}")

    def apply(self, writer: str, message: Append) -> int:
        """Store a message that was checked before.

        As in NATS 2.9, only a message that must be the first one is checked again.
        """
        if message.expected == 0:
            self._check_last(message)
        self._sequence += 1
        stored = Stored(self._sequence, message.id, message.data, message.keep)
        self._journals.setdefault(message.subject, []).append((self.now(), stored))
        self._ids[message.id] = self.now(), self._sequence
        if self.on_stored is not None:
            self.on_stored(writer, message.subject, stored)
        return self._sequence

    def read(self, journal: str) -> list[Stored]:
        latest = self.now() - self._age()
        return [message for at, message in self._journals.get(journal, []) if at <= latest]

    def purge(self, journal: str) -> None:
        if self._journals.pop(journal, None) is not None and self.on_purged is not None:
            self.on_purged(journal)

    def keep_file(self, name: str, content: bytes) -> None:
        self.files[name] = content

    def _age(self) -> float:
        """Return the age of the state from which a read is answered."""
        stale = self.stale > 0 and self.chance.random() < self.stale
        return self.chance.random() * MAX_STALE if stale else 0.0

    # Buckets

    def prepare(self) -> None:
        """Create the buckets that do not exist."""
        for bucket in Bucket:
            if bucket not in self._buckets:
                self._created += 1
                seconds = NODE_KEY_SECONDS if bucket is Bucket.NODES else None
                self._buckets[bucket] = _KeyValues(self._created, seconds)

    def created(self) -> dict[Bucket, int]:
        """Return the number of each bucket among all that were created."""
        return {bucket: found.created for bucket, found in self._buckets.items()}

    def _bucket(self, bucket: Bucket) -> _KeyValues:
        if bucket not in self._buckets:
            raise UnavailableError(f"NATS: the bucket {bucket} does not exist")
        return self._buckets[bucket]

    def get(self, bucket: Bucket, key: str) -> Entry | None:
        found = self._bucket(bucket).find(key, self.now())
        if found is None:
            return None
        return found.before if found.at > self.now() - self._age() else found.entry

    def set(self, bucket: Bucket, key: str, value: bytes | None) -> int:
        revision = self._bucket(bucket).set(key, value, self.now())
        for changed in self.on_set:
            changed(bucket, key, value)
        return revision

    def create(self, bucket: Bucket, key: str, value: bytes) -> int:
        found = self._bucket(bucket).find(key, self.now())
        if found is not None and found.value is not None:
            raise ConflictError(f"the key {key} exists")
        return self.set(bucket, key, value)

    def update(self, bucket: Bucket, key: str, value: bytes, revision: int) -> int:
        found = self._bucket(bucket).find(key, self.now())
        if (found.revision if found is not None else 0) != revision:
            raise ConflictError(f"the key {key} has changed")
        return self.set(bucket, key, value)

    def changes(self, bucket: Bucket, position: int) -> tuple[int, list[tuple[str, Entry | None]]]:
        """Return a bucket's revision, and its changes since an earlier revision."""
        found = self._bucket(bucket)
        return found.revision, found.since(position, self.now())
