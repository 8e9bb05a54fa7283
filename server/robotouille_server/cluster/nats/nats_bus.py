"""Connection to NATS JetStream."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from datetime import datetime
from functools import partial
from typing import Any

from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.errors import Error as NatsError
from nats.errors import TimeoutError as NatsTimeoutError
from nats.js import JetStreamContext
from nats.js.api import (
    DeliverPolicy,
    DiscardPolicy,
    Header,
    KeyValueConfig,
    ObjectStoreConfig,
    RetentionPolicy,
    StorageType,
    StreamConfig,
)
from nats.js.errors import (
    APIError,
    KeyDeletedError,
    KeyNotFoundError,
    NotFoundError,
)
from nats.js.kv import KeyValue

from robotouille.errors import RobotouilleError
from robotouille.nats.address import NatsAddress
from robotouille.nats.client import RECONNECT_SECONDS, bounded_client
from robotouille_server.cluster.bus import (
    Append,
    Bucket,
    BusError,
    ConflictError,
    Entry,
    Stored,
    UnavailableError,
)
from robotouille_server.cluster.nats.connection_log import ConnectionLog
from robotouille_server.cluster.nats.errors import (
    IN_USE,
    NO_MESSAGE,
    WRONG_SEQUENCE,
    NatsErrors,
)
from robotouille_server.cluster.nats.journal_reader import KEEP, MESSAGE_ID, JournalReader, stored
from robotouille_server.cluster.nats.purging import CarefulJetStream
from robotouille_server.runtime.logs import get_logger

OLDEST_SERVER = (2, 9)
"""Oldest version of nats-server that the tests use."""
REPLICAS = 3
ANSWER_SECONDS = 2.0
"""Seconds after which an append without an answer counts as failed."""
ATTEMPTS = 5
"""Attempts of a request without an answer while a node starts."""
LEADER_SECONDS = 1.0
"""Seconds in which a stream with a leader answers."""
SWEEP_SECONDS = 0.25
HEARTBEAT_SECONDS = 1.0
"""Seconds between signs of life of a watch. It begins again when two are missing."""
CONNECT_SECONDS = 10.0
NODE_KEY_SECONDS = 10.0
"""Seconds after which NATS deletes the key of a node that does not renew it."""
MAX_PUBLISHED = 8 * 1024 * 1024
"""Bytes that wait to be published, above which messages are lost."""
EXPECTED = str(Header.EXPECTED_LAST_SUBJECT_SEQUENCE.value)


@asynccontextmanager
async def nats_bus(address: NatsAddress) -> AsyncIterator[NatsBus]:
    """Connect to NATS, and create the streams and buckets that do not exist.

    Raises:
        RobotouilleError: NATS cannot be reached, refuses the credentials, or has no JetStream.
    """
    bus = NatsBus(address)
    try:
        await bus.open()
        yield bus
    finally:
        await bus.close()


class NatsBus:
    """`Bus` on NATS JetStream. Use `nats_bus`."""

    def __init__(self, address: NatsAddress) -> None:
        self._address = address
        self._prefix = address.prefix
        self._nats = bounded_client()
        self._js = CarefulJetStream(self._nats, timeout=ANSWER_SECONDS)
        self._reader = JournalReader(self._nats, self._js, self._stream)
        self._buckets: dict[Bucket, KeyValue] = {}
        self._watching: dict[Bucket, JetStreamContext.PushSubscription] = {}
        self._outgoing: deque[tuple[Append, bytes]] = deque()
        self._published: deque[tuple[str, bytes]] = deque()
        self._published_bytes = 0
        self._wake = asyncio.Event()
        self._waiting: dict[str, tuple[float, Callable[[int | BusError], None]]] = {}
        self._count = 0
        self._inbox = ""
        self._tasks: set[asyncio.Task[None]] = set()
        self._log = ConnectionLog()
        self._errors = NatsErrors()
        self._created: list[datetime | None] = []

    @property
    def connected(self) -> bool:
        return self._nats.is_connected

    # Opening

    async def open(self) -> None:
        await self._connect()
        self._check_server()
        await self.prepare()
        self._inbox = self._nats.new_inbox()
        await self._nats.subscribe(f"{self._inbox}.*", cb=self._answered)
        self._start(self._send())
        self._start(self._sweep())

    async def _connect(self) -> None:
        address = self._address
        options: dict[str, Any] = {}
        if address.user:
            # The library takes the user of an address without a password for a token.
            options |= {"user": address.user, "password": address.password}
        if address.credentials:
            options["user_credentials"] = address.credentials
        if address.tls is not None:
            options["tls"] = address.tls
        servers = ", ".join(address.servers)
        try:
            async with asyncio.timeout(CONNECT_SECONDS):
                await self._nats.connect(
                    servers=list(address.servers),
                    name="robotouille-server",
                    max_reconnect_attempts=-1,
                    reconnect_time_wait=RECONNECT_SECONDS,  # type: ignore[arg-type]
                    connect_timeout=2,
                    ping_interval=2,
                    max_outstanding_pings=2,
                    allow_reconnect=True,
                    error_cb=self._failed,
                    disconnected_cb=self._disconnected,
                    reconnected_cb=self._reconnected,
                    **options,
                )
        except (TimeoutError, OSError, NatsError, ValueError) as error:
            reason = self._log.reason or str(error) or "no answer"
            raise RobotouilleError(
                f"--cluster: cannot connect to NATS at {servers}: {reason}"
            ) from None
        self._log.connected()

    def _check_server(self) -> None:
        version = self._nats.connected_server_version
        if (version.major, version.minor) < OLDEST_SERVER:
            needed = ".".join(map(str, OLDEST_SERVER))
            raise RobotouilleError(
                f"--cluster: NATS has version {version.major}.{version.minor}.{version.patch}; "
                f"at least {needed} is required"
            )
        if not self._info.get("jetstream"):
            raise RobotouilleError(
                "--cluster: this NATS has no JetStream; start nats-server with -js"
            )

    @property
    def _info(self) -> dict[str, Any]:
        info: dict[str, Any] = self._nats._server_info
        return info

    async def prepare(self) -> None:
        """Create the stream, buckets and files that do not exist.

        Raises:
            RobotouilleError: JetStream refuses, or has too few servers for three replicas.
        """
        # A single server is enough to try a cluster, but then its disk is all there is.
        replicas = REPLICAS if self._info.get("cluster") else 1
        if replicas == 1 and not self._buckets:
            get_logger().warning("NATS is a single server, so recordings have one replica")
        journal = StreamConfig(
            name=self._stream,
            subjects=[f"{self._prefix}.journal.*"],
            retention=RetentionPolicy.LIMITS,
            # A full stream refuses messages, and the games pause. Dropping old messages would
            # destroy recordings.
            discard=DiscardPolicy.NEW,
            storage=StorageType.FILE,
            num_replicas=replicas,
            allow_direct=False,
        )
        async with self._errors.explained(REPLICAS):
            with contextlib.suppress(_InUseError):
                await _or_in_use(partial(self._js.add_stream, journal))
        for bucket in Bucket:
            leases = bucket is Bucket.NODES
            config = KeyValueConfig(
                bucket=f"{self._prefix}_{bucket}",
                ttl=NODE_KEY_SECONDS if leases else None,
                storage=StorageType.MEMORY if leases else StorageType.FILE,
                replicas=replicas,
                direct=False,
            )
            async with self._errors.explained(REPLICAS):
                try:
                    self._buckets[bucket] = await _or_in_use(
                        partial(self._js.create_key_value, config)
                    )
                except _InUseError:
                    self._buckets[bucket] = await self._js.key_value(config.bucket)
        files = ObjectStoreConfig(
            bucket=self._recordings, storage=StorageType.FILE, replicas=replicas
        )
        async with self._errors.explained(REPLICAS):
            with contextlib.suppress(_InUseError):
                await _or_in_use(partial(self._js.create_object_store, self._recordings, files))
        # A stream that another node has just created has no leader, and drops requests.
        quick = self._nats.jetstream(timeout=LEADER_SECONDS)
        for stream in self._streams[:-1]:
            async with self._errors.explained(REPLICAS):
                with contextlib.suppress(NotFoundError):
                    await _until_answered(partial(quick.get_last_msg, stream, "any"))
        async with self._errors.explained(REPLICAS):
            self._created = await self._creation_times()

    @property
    def _streams(self) -> list[str]:
        """Names of all streams: of the journals, of the buckets, and of the files at the end."""
        buckets = (f"KV_{self._prefix}_{bucket}" for bucket in Bucket)
        return [self._stream, *buckets, f"OBJ_{self._recordings}"]

    async def _creation_times(self) -> list[datetime | None]:
        infos = [await self._js.stream_info(stream) for stream in self._streams]
        return [info.created for info in infos]

    async def intact(self) -> bool:
        async with self._errors.translated():
            try:
                return await self._creation_times() == self._created
            except NotFoundError:
                return False

    @property
    def _stream(self) -> str:
        return f"{self._prefix}_journal"

    @property
    def _recordings(self) -> str:
        return f"{self._prefix}_recordings"

    def _start(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def close(self) -> None:
        for task in list(self._tasks):
            task.cancel()
        for _, done in self._waiting.values():
            done(UnavailableError("the server stops"))
        self._waiting.clear()
        if not self._nats.is_closed:
            with contextlib.suppress(NatsError, OSError, TimeoutError):
                async with asyncio.timeout(ANSWER_SECONDS):
                    await self._nats.close()

    # Connection

    async def _failed(self, error: Exception) -> None:
        self._log.failed(error)

    async def _disconnected(self) -> None:
        if not self._nats.is_closed:
            self._log.lost()

    async def _reconnected(self) -> None:
        self._log.returned(_netloc(self._nats))

    # Journals

    def append(self, message: Append, done: Callable[[int | BusError], None]) -> None:
        self._count += 1
        token = str(self._count)
        self._waiting[token] = asyncio.get_running_loop().time() + ANSWER_SECONDS, done
        self._outgoing.append((message, token.encode()))
        self._wake.set()

    async def _send(self) -> None:
        """Send appends in order. One task for all: a task for each would cost more than sending."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._outgoing:
                message, token = self._outgoing.popleft()
                if token.decode() not in self._waiting:  # It has taken too long already.
                    continue
                headers = {
                    EXPECTED: str(message.expected),
                    MESSAGE_ID: message.id,
                }
                if message.keep is not None:
                    headers[KEEP] = str(message.keep)
                try:
                    await self._nats.publish(
                        f"{self._prefix}.journal.{message.subject}",
                        message.data,
                        reply=f"{self._inbox}.{token.decode()}",
                        headers=headers,
                    )
                except (NatsError, OSError) as error:
                    self._finish(token.decode(), UnavailableError(str(error)))
            # Appends come first, because games wait for them.
            if self._published:
                self._wake.set()
                await self._send_published(*self._published.popleft())

    async def _send_published(self, subject: str, data: bytes) -> None:
        self._published_bytes -= len(data)
        with contextlib.suppress(NatsError, OSError):
            await self._nats.publish(f"{self._prefix}.{subject}", data)

    async def _answered(self, answer: Msg) -> None:
        self._finish(answer.subject.rpartition(".")[2], _acknowledged(answer, self._errors))

    def _finish(self, token: str, result: int | BusError) -> None:
        waiting = self._waiting.pop(token, None)
        if waiting is None:
            return
        try:
            waiting[1](result)
        except Exception:
            # One failing episode must not stop the answers to the others.
            get_logger().exception("the answer to an append failed")

    async def _sweep(self) -> None:
        """Fail the appends that were not answered in time."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            now = loop.time()
            # Tokens are in the order of their deadlines.
            late = []
            for token, (due, _) in self._waiting.items():
                if due > now:
                    break
                late.append(token)
            for token in late:
                self._finish(token, self._errors.unavailable("NATS does not answer"))

    async def last(self, subject: str) -> Stored | None:
        async with self._errors.translated():
            try:
                found = await self._js.get_last_msg(
                    self._stream, f"{self._prefix}.journal.{subject}"
                )
            except NotFoundError as error:
                if error.err_code != NO_MESSAGE:  # Any other means that the stream is gone.
                    raise
                return None
            return stored(found.seq or 0, found.headers, found.data or b"")

    async def read(self, subject: str, after: int = 0) -> list[Stored]:
        last = await self.last(subject)
        if last is None or last.sequence <= after:
            return []
        async with self._errors.translated():
            name = f"{self._prefix}.journal.{subject}"
            return await self._reader.read(name, after, last.sequence)

    async def purge(self, subject: str) -> None:
        async with self._errors.translated():
            await self._js.purge_stream(self._stream, subject=f"{self._prefix}.journal.{subject}")

    async def journals(self) -> list[str]:
        prefix = f"{self._prefix}.journal."
        async with self._errors.translated():
            found = await self._js.stream_info(self._stream, subjects_filter=f"{prefix}*")
        return [subject.removeprefix(prefix) for subject in found.state.subjects or ()]

    # Buckets

    async def get(self, bucket: Bucket, key: str) -> Entry | None:
        async with self._errors.translated():
            try:
                entry = await self._buckets[bucket].get(key)
            except (KeyNotFoundError, KeyDeletedError):
                return None
            return Entry(entry.value or b"", entry.revision or 0)

    async def put(self, bucket: Bucket, key: str, value: bytes) -> int:
        async with self._errors.translated():
            return await self._buckets[bucket].put(key, value)

    async def create(self, bucket: Bucket, key: str, value: bytes) -> int:
        async with self._errors.translated():
            return await self._buckets[bucket].create(key, value)

    async def update(self, bucket: Bucket, key: str, value: bytes, revision: int) -> int:
        async with self._errors.translated():
            return await self._buckets[bucket].update(key, value, revision)

    async def delete(self, bucket: Bucket, key: str) -> None:
        async with self._errors.translated():
            await self._buckets[bucket].delete(key)

    async def watch(self, bucket: Bucket, changed: Callable[[str, Entry | None], None]) -> None:
        complete = asyncio.Event()
        prefix = f"$KV.{self._prefix}_{bucket}."

        async def received(message: Msg) -> None:
            metadata = message.metadata
            deleted = bool(message.headers and message.headers.get("KV-Operation"))
            entry = None if deleted else Entry(message.data, metadata.sequence.stream)
            try:
                changed(message.subject.removeprefix(prefix), entry)
            except Exception:
                get_logger().exception("a change of the cluster was not processed")
            if metadata.num_pending == 0:
                complete.set()

        # The library's `KeyValue.watch` notices only after ten seconds that the server with its
        # consumer has died.
        async with self._errors.translated():
            watching = await self._js.subscribe(
                f"{prefix}>",
                stream=f"KV_{self._prefix}_{bucket}",
                cb=received,
                ordered_consumer=True,
                deliver_policy=DeliverPolicy.LAST_PER_SUBJECT,
                idle_heartbeat=HEARTBEAT_SECONDS,
            )
            try:
                if (await watching.consumer_info()).num_pending or watching.delivered:
                    async with asyncio.timeout(CONNECT_SECONDS):
                        await complete.wait()
            except BaseException:
                # The caller will watch again.
                await _end_watch(watching)
                raise
        earlier = self._watching.pop(bucket, None)
        self._watching[bucket] = watching
        if earlier is not None:
            await _end_watch(earlier)

    # Files and requests

    async def store(self, name: str, content: bytes) -> None:
        async with self._errors.translated():
            files = await self._js.object_store(self._recordings)
            await files.put(name, content)

    async def request(self, subject: str, data: bytes, seconds: float) -> bytes:
        async with self._errors.translated():
            answer = await self._nats.request(f"{self._prefix}.{subject}", data, timeout=seconds)
            return answer.data

    async def answer(self, subject: str, handler: Callable[[str, bytes], Awaitable[bytes]]) -> None:
        async def serve(request: Msg) -> None:
            try:
                answer = await handler(request.subject.rpartition(".")[2], request.data)
                await request.respond(answer)
            except (NatsError, OSError) as error:
                get_logger().warning("request of another node not answered", error=str(error))
            except Exception:
                get_logger().exception("request of another node failed")

        async def begin(request: Msg) -> None:
            # Requests of different episodes must not wait for each other.
            self._start(serve(request))

        async with self._errors.translated():
            await self._nats.subscribe(f"{self._prefix}.{subject}.*", cb=begin)

    def publish(self, subject: str, data: bytes) -> None:
        # Without a connection the library would keep messages that are outdated when it is back.
        if self.connected and self._published_bytes + len(data) <= MAX_PUBLISHED:
            self._published.append((subject, data))
            self._published_bytes += len(data)
            self._wake.set()

    async def subscribe(
        self, subject: str, received: Callable[[bytes], None]
    ) -> Callable[[], Awaitable[None]]:
        async def pass_on(message: Msg) -> None:
            received(message.data)

        async with self._errors.translated():
            subscription = await self._nats.subscribe(f"{self._prefix}.{subject}", cb=pass_on)

        async def end() -> None:
            with contextlib.suppress(NatsError, OSError):
                await subscription.unsubscribe()

        return end


async def _end_watch(watching: JetStreamContext.PushSubscription) -> None:
    with contextlib.suppress(NatsError, OSError, TimeoutError):
        await watching.unsubscribe()


def _acknowledged(answer: Msg, errors: NatsErrors) -> int | BusError:
    """Return the sequence number in an answer to an append, or the error."""
    if answer.headers and answer.headers.get("Status") == "503":
        return errors.unavailable("NATS has no JetStream or no quorum")
    try:
        content = json.loads(answer.data)
    except ValueError:
        return UnavailableError("NATS has sent an answer that is not JSON")
    error = content.get("error")
    if error is None:
        return int(content["seq"])
    code, text = error.get("err_code"), str(error.get("description", error))
    if code in WRONG_SEQUENCE:
        return ConflictError(text)
    return errors.refused(code, text)


class _InUseError(Exception):
    """The stream exists already, possibly with other settings."""


async def _until_answered(ask: Callable[[], Awaitable[Any]]) -> Any:
    """Repeat a request for a while: NATS drops those that come before a leader is elected."""
    for _ in range(ATTEMPTS - 1):
        with contextlib.suppress(NatsTimeoutError):
            return await ask()
    return await ask()


async def _or_in_use(create: Callable[[], Awaitable[Any]]) -> Any:
    try:
        return await _until_answered(create)
    except APIError as error:
        if error.err_code == IN_USE:
            raise _InUseError from None
        raise


def _netloc(client: Client) -> str:
    url = client.connected_url
    return url.netloc if url is not None else ""
