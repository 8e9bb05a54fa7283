"""Copying the closed recordings of a cluster from NATS into a folder.

The nodes of a cluster store closed recordings in a JetStream object store. An object has one
message with its description, and its content in further messages. Anyone who can write to NATS
chooses both, so descriptions are checked like other input and bound the size of contents. The
address may belong to another program, so the answers of the server are checked too.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import re
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterator
from contextlib import (
    AbstractContextManager,
    aclosing,
    asynccontextmanager,
    contextmanager,
    suppress,
)
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any

from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.errors import Error as NatsError
from nats.errors import NoRespondersError
from nats.js import JetStreamContext
from nats.js.api import ConsumerConfig, DeliverPolicy
from nats.js.errors import NotFoundError

from robotouille.files.writing import whole_file
from robotouille.nats.address import NatsAddress
from robotouille.nats.client import RECONNECT_SECONDS, bounded_client
from robotouille.replay.container import MAX_FILE
from robotouille.replay.file_names import CLOSED, is_recording_name
from robotouille_data.database import UnavailableError

ANSWER_SECONDS = 5.0
CONNECT_SECONDS = 10.0
MAX_NAME = 200
"""Characters of a file name. Most file systems permit 255, and a draft has a longer name."""
MAX_CHUNKS = 262_144
"""Messages of an object's content. The library writes 128 KiB into each."""
MAX_DESCRIPTION = 65_536
MAX_DESCRIPTIONS = 32 * 1024 * 1024
"""Bytes of descriptions in memory. Further ones are read by the next call."""
ENTRY_BYTES = 1000
"""Approximate size of the objects that Python needs for a description."""
NO_STREAM = 10059
"""NATS's error code for a missing stream."""
_ID = re.compile(r"[A-Za-z0-9_-]{1,64}")
"""Ids of contents. They become part of a subject, in which `*` and `>` are wildcards."""
_SUM = "SHA-256="


class _FaultError(Exception):
    """An object is not a recording that can be copied."""


@dataclass(frozen=True, slots=True)
class _Object:
    """Description of an object.

    Attributes:
        content: Id of its content.
        digest: SHA-256 in Base64, without padding.
    """

    name: str
    content: str
    size: int
    digest: str


@dataclass(slots=True)
class Fetched:
    """Count of files that were written, and the faults of other objects by their names."""

    files: int = 0
    faults: dict[str, str] = field(default_factory=dict)


Description = tuple[int, bytes]
"""Sequence number and content of the message that describes an object."""
Bar = Callable[[int, int], None]
"""Called with the number of finished objects and their total."""


class ClusterRecordings:
    """Copies closed recordings of a cluster into a folder.

    Files whose objects are deleted remain, so that operators may make room in NATS.

    Args:
        address: The servers and the name of the cluster.
        folder: The folder, which exists.
    """

    def __init__(self, address: NatsAddress, folder: Path) -> None:
        self._address = address
        self._folder = folder
        self._bucket = f"{address.prefix}_recordings"
        self._stream = f"OBJ_{self._bucket}"
        self._created: object = None
        self._after = 0
        self._found = Fetched()

    def fetch(self, stop: Event, bar: Callable[[], AbstractContextManager[Bar]]) -> Fetched:
        """Copy the objects that have come or changed since the last call.

        After an error or a stop, the next call continues with the next object. The first call skips
        objects that the folder has already.

        Args:
            stop: Event that ends the call after the current object.
            bar: Returns a context that shows progress. It is entered if there is something to copy.

        Raises:
            UnavailableError: NATS cannot be reached, or the folder cannot be written.
        """
        asyncio.run(self._fetch(stop, bar))
        found, self._found = self._found, Fetched()
        return found

    async def _fetch(self, stop: Event, bar: Callable[[], AbstractContextManager[Bar]]) -> None:
        async with _errors(), _connected(self._address) as client:
            js = client.jetstream(timeout=ANSWER_SECONDS)
            last, changed = await self._changed(js)
            if changed:
                with bar() as progress:
                    for done, (subject, (sequence, data)) in enumerate(changed, 1):
                        if stop.is_set():
                            return
                        await self._take(js, subject, sequence, data)
                        self._after = sequence
                        progress(done, len(changed))
            # The last message of the store is usually content.
            self._after = max(self._after, last)

    # Descriptions

    async def _changed(self, js: JetStreamContext) -> tuple[int, list[tuple[str, Description]]]:
        """Return the store's last sequence number, and new descriptions with their subjects."""
        try:
            with _valid_answers():
                info = await js.stream_info(self._stream)
                last = int(info.state.last_seq)
        except NotFoundError as error:
            if error.err_code != NO_STREAM:
                raise
            text = f"NATS has no object store {self._bucket}; the nodes of the cluster create it"
            raise UnavailableError(text) from None
        if info.created != self._created or last < self._after:
            # An operator deleted the store, and a node created another one.
            self._created, self._after = info.created, 0
        found: dict[str, Description] = {}
        size = 0
        if last > self._after:
            begin = ConsumerConfig(
                deliver_policy=DeliverPolicy.BY_START_SEQUENCE, opt_start_seq=self._after + 1
            )
            async with aclosing(self._messages(js, f"$O.{self._bucket}.M.>", begin)) as messages:
                async for message in messages:
                    sequence = message.metadata.sequence.stream
                    found[message.subject] = sequence, message.data[: MAX_DESCRIPTION + 1]
                    size += len(found[message.subject][1]) + len(message.subject) + ENTRY_BYTES
                    if size > MAX_DESCRIPTIONS:
                        last = sequence
                        break
        return last, sorted(found.items(), key=lambda each: each[1][0])

    async def _messages(
        self, js: JetStreamContext, subject: str, config: ConsumerConfig
    ) -> AsyncGenerator[Msg, None]:
        """Yield the messages of a subject that exist now."""
        with _valid_answers():
            messages = await js.subscribe(
                subject, stream=self._stream, ordered_consumer=True, config=config
            )
        try:
            with _valid_answers():
                info = await messages.consumer_info()
                delivered = info.delivered.consumer_seq if info.delivered is not None else 0
                waiting = int(delivered) + int(info.num_pending or 0)
            while waiting:
                message = await messages.next_msg(timeout=ANSWER_SECONDS)
                waiting = message.metadata.num_pending
                yield message
        finally:
            with suppress(NatsError):
                await messages.unsubscribe()

    # Objects

    async def _take(self, js: JetStreamContext, subject: str, sequence: int, data: bytes) -> None:
        try:
            entry = _described(subject, data)
            if entry is not None and not await asyncio.to_thread(self._has, entry):
                await self._copy(js, entry)
                self._found.files += 1
        except _FaultError as error:
            # The content of an object disappears when the object is replaced or deleted.
            with _valid_answers():
                latest = await js.get_last_msg(self._stream, subject)
            if latest.seq == sequence:
                self._found.faults[_shown_name(subject)] = str(error)

    def _has(self, entry: _Object) -> bool:
        path = self._folder / entry.name
        if path.is_symlink() or not path.is_file() or path.stat().st_size != entry.size:
            return False
        with path.open("rb") as file:
            return _base64(hashlib.file_digest(file, "sha256").digest()) == entry.digest

    async def _copy(self, js: JetStreamContext, entry: _Object) -> None:
        subject = f"$O.{self._bucket}.C.{entry.content}"
        config = ConsumerConfig(deliver_policy=DeliverPolicy.ALL)
        digest, size, number = hashlib.sha256(), 0, 0
        with whole_file(self._folder / entry.name, text=False) as file:
            async with aclosing(self._messages(js, subject, config)) as messages:
                async for message in messages:
                    size, number = size + len(message.data), number + 1
                    if size > entry.size or number > MAX_CHUNKS:
                        raise _FaultError("its content is longer than announced")
                    digest.update(message.data)
                    file.write(message.data)
            if size < entry.size or _base64(digest.digest()) != entry.digest:
                raise _FaultError("its content is incomplete or damaged")


def _described(subject: str, data: bytes) -> _Object | None:
    """Return the object of a description; None if it is deleted.

    Raises:
        _FaultError: The description is invalid, or is not that of a closed recording.
    """
    if len(data) > MAX_DESCRIPTION:
        raise _FaultError("its description is too long")
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise _FaultError("its description is not a JSON object")
    if found.get("deleted"):
        return None
    name, content, digest = (_text(found, key) for key in ("name", "nuid", "digest"))
    # The subject decides which description replaces which, so each file has one subject.
    if subject.rpartition(".")[2].rstrip("=") != _base64(name.encode("utf-8", "replace")):
        raise _FaultError("its name differs from that of its subject")
    # Commands would take a name such as `-rf.rbt`, which a shell inserts for `*`, for an option.
    closed = name.endswith(CLOSED) and not name.startswith("-") and len(name) <= MAX_NAME
    if not closed or not is_recording_name(name):
        raise _FaultError("not the name of a closed recording")
    options = found.get("options")
    if isinstance(options, dict) and options.get("link"):
        raise _FaultError("a link to another object")
    size = found.get("size")
    if type(size) is not int or size <= 0 or not _ID.fullmatch(content):
        raise _FaultError("its description is invalid")
    if size > MAX_FILE:
        raise _FaultError(f"larger than {MAX_FILE:,} bytes")
    if digest[: len(_SUM)].upper() != _SUM:
        raise _FaultError("no SHA-256")
    return _Object(name, content, size, digest[len(_SUM) :].rstrip("="))


def _text(description: dict[str, Any], key: str) -> str:
    value = description.get(key)
    return value if isinstance(value, str) else ""


def _base64(content: bytes) -> str:
    return base64.urlsafe_b64encode(content).decode().rstrip("=")


def _shown_name(subject: str) -> str:
    """Return the name of an object for messages, or its subject if that contains none."""
    word = subject.rpartition(".")[2].rstrip("=")
    try:
        name = base64.urlsafe_b64decode(word + "=" * (-len(word) % 4)).decode()
    except ValueError:
        name = subject
    return name if len(name) <= MAX_NAME else f"{name[:MAX_NAME]}…"


# Connection


INVALID = (AttributeError, LookupError, RecursionError, TypeError, ValueError)


@contextmanager
def _valid_answers() -> Iterator[None]:
    """Report answers of the server that the library cannot read, and does not check.

    Raises:
        UnavailableError: The answer is invalid.
    """
    try:
        yield
    except INVALID as error:
        raise UnavailableError(f"NATS: the server's answer is invalid: {error}") from None


@asynccontextmanager
async def _errors() -> AsyncIterator[None]:
    try:
        yield
    except NoRespondersError:
        raise UnavailableError("NATS has no JetStream, or no server of it answers") from None
    except (NatsError, OSError) as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise UnavailableError(f"{error.filename}: {error.strerror or error}") from None
        text = (str(error) or type(error).__name__).removeprefix("nats: ")
        raise UnavailableError(f"NATS: {text}") from None


@asynccontextmanager
async def _connected(address: NatsAddress) -> AsyncIterator[Client]:
    client, reasons = bounded_client(), [""]

    async def failed(error: Exception) -> None:
        reasons.append(str(error) or type(error).__name__)

    options: dict[str, Any] = {"tls": address.tls} if address.tls is not None else {}
    if address.user:
        # The library takes the user of an address without a password for a token.
        options |= {"user": address.user, "password": address.password}
    if address.credentials:
        options["user_credentials"] = address.credentials
    try:
        try:
            async with asyncio.timeout(CONNECT_SECONDS):
                await client.connect(
                    servers=list(address.servers),
                    name="robotouille data",
                    max_reconnect_attempts=1,
                    # Without a pause, a server that hangs up would be called thousands of times a
                    # second.
                    reconnect_time_wait=RECONNECT_SECONDS,  # type: ignore[arg-type]
                    connect_timeout=2,
                    error_cb=failed,
                    **options,
                )
        except (TimeoutError, OSError, NatsError, *INVALID) as error:
            reason = reasons[-1] or str(error) or "no answer"
            text = f"cannot connect to NATS at {', '.join(address.servers)}: {reason}"
            raise UnavailableError(text) from None
        yield client
    finally:
        # Without this, a connection that failed would leave a socket open.
        if not client.is_closed:
            with suppress(NatsError, OSError, TimeoutError):
                async with asyncio.timeout(ANSWER_SECONDS):
                    await client.close()
