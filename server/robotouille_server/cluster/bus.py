"""Interface of the service that connects the nodes of a cluster.

`nats.nats_bus.NatsBus` is the real one. Tests replace it by a simulated one that delays, drops and
repeats messages.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from robotouille.errors import RobotouilleError
from robotouille_server.runtime.logs import get_logger

PATIENCE_SECONDS = 30.0
"""Seconds for which a node that starts waits for the service. Elections can take ten."""
PAUSE_SECONDS = 0.5


class Bucket(StrEnum):
    """Buckets of keys with values."""

    NODES = "nodes"
    """The report of each node, by the node's name; a key disappears if it is not renewed."""
    EPISODES = "episodes"
    """The node of each episode, by join code."""
    SHARED = "shared"
    """Signing keys, revoked tokens and used tokens."""


class BusError(RobotouilleError):
    """The service could not do something, or has not answered."""


class UnavailableError(BusError):
    """The service cannot be reached, has no quorum, or is full. The request may have been done."""


class NoAnswererError(UnavailableError):
    """No node answers the requests of this subject, so nothing was done."""


class ConflictError(BusError):
    """Another writer was first."""


@dataclass(frozen=True, slots=True)
class Append:
    """One message for a journal.

    Attributes:
        subject: The journal.
        data: The bytes to append.
        expected: The sequence number of the journal's last message, or 0 if it is empty. The
            service refuses the message if another one came in between.
        id: A unique name, by which the writer recognizes its message.
        keep: The number of bytes before this message that are valid, if a torn end is cut off.
    """

    subject: str
    data: bytes
    expected: int
    id: str
    keep: int | None = None


@dataclass(frozen=True, slots=True)
class Stored:
    """One message of a journal."""

    sequence: int
    id: str
    data: bytes
    keep: int | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """Value of a key. Each change increases the revision."""

    value: bytes
    revision: int


class Bus(Protocol):
    """Journals, buckets, files and requests that all nodes share.

    Methods raise UnavailableError unless their docstring names another error.
    """

    @property
    def connected(self) -> bool:
        """True while there is a connection to the service."""

    async def prepare(self) -> None:
        """Create journals and buckets that do not exist; raise RobotouilleError."""

    async def intact(self) -> bool:
        """Return whether all journals and buckets are those of the last `prepare`.

        If an operator has deleted some, watches report nothing any more, even if another node has
        created them again.
        """

    def append(self, message: Append, done: Callable[[int | BusError], None]) -> None:
        """Append a message to a journal.

        `done` is called once, later: with the sequence number when a quorum has the message, or
        with an error.
        """

    async def last(self, subject: str) -> Stored | None:
        """Return the last message of a journal."""

    async def read(self, subject: str, after: int = 0) -> list[Stored]:
        """Return the messages of a journal after a sequence number."""

    async def purge(self, subject: str) -> None:
        """Delete all messages of a journal."""

    async def journals(self) -> list[str]:
        """Return the names of all journals that have messages."""

    async def get(self, bucket: Bucket, key: str) -> Entry | None:
        """Return the value of a key."""

    async def put(self, bucket: Bucket, key: str, value: bytes) -> int:
        """Set the value of a key; return its revision."""

    async def create(self, bucket: Bucket, key: str, value: bytes) -> int:
        """Set the value of a new key; raise ConflictError if it exists."""

    async def update(self, bucket: Bucket, key: str, value: bytes, revision: int) -> int:
        """Replace a value; raise ConflictError if its revision is not `revision`."""

    async def delete(self, bucket: Bucket, key: str) -> None:
        """Delete a key."""

    async def watch(self, bucket: Bucket, changed: Callable[[str, Entry | None], None]) -> None:
        """Call `changed` for all keys that exist now, then for every change.

        Return when all existing keys were reported. Deleted keys are reported without an entry;
        keys that have expired are not reported. This ends an earlier watch of the bucket, but an
        attempt that fails does not.
        """

    async def store(self, name: str, content: bytes) -> None:
        """Store a file, in place of an earlier one with its name."""

    async def request(self, subject: str, data: bytes, seconds: float) -> bytes:
        """Return the answer to a request; raise NoAnswererError if no node can receive it."""

    async def answer(self, subject: str, handler: Callable[[str, bytes], Awaitable[bytes]]) -> None:
        """Answer all requests to `subject.WORD` with `handler(WORD, data)`."""

    def publish(self, subject: str, data: bytes) -> None:
        """Send a message to all subscribers. It may be lost."""

    async def subscribe(
        self, subject: str, received: Callable[[bytes], None]
    ) -> Callable[[], Awaitable[None]]:
        """Call `received` with each message that is published; return how to end that."""


async def until_available(ask: Callable[[], Awaitable[None]]) -> None:
    """Repeat a request while the service is unavailable, for at most `PATIENCE_SECONDS`.

    Raises:
        BusError: The service was unavailable all the time, or it refuses the request.
    """
    loop = asyncio.get_running_loop()
    end, reason = loop.time() + PATIENCE_SECONDS, ""
    while True:
        try:
            return await ask()
        except UnavailableError as error:
            if loop.time() >= end:
                raise
            if str(error) != reason:
                reason = str(error)
                get_logger().warning("waiting for NATS", error=reason)
        await asyncio.sleep(PAUSE_SECONDS)
