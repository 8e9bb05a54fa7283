"""Simulated NATS, which delays, reorders, loses and repeats messages as a seed determines.

The service runs on the loop of the test. A message of a node arrives even if the node is killed in
between. Messages of the service arrive in the context of the node: a suspended process of
`tests.programs.simulation.loop` receives them when it continues, and a dead one never.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Awaitable, Callable, Iterator
from contextvars import Context, copy_context
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from robotouille_server.cluster.bus import (
    Append,
    Bucket,
    BusError,
    Entry,
    NoAnswererError,
    Stored,
    UnavailableError,
)
from tests.support.simulated_storage import SimulatedStorage

__all__ = ["Handler", "Quality", "SimulatedBus", "SimulatedNats"]

T = TypeVar("T")
Changed = Callable[[str, Entry | None], None]
Handler = Callable[[str, bytes], Awaitable[bytes]]

ANSWER_SECONDS = 2.0
WATCH_SECONDS = 10.0
SOONEST = 1e-9
"""Seconds between two messages, because timers of the same time have no order."""


@dataclass(slots=True)
class Quality:
    """Quality of all connections. Attributes other than seconds are probabilities.

    Attributes:
        latency: The shortest delay of a message, in seconds.
        jitter: The largest additional delay, with which messages overtake each other.
        lost: A message or an answer is lost.
        repeated: A message or an answer arrives twice.
        late: A message or an answer takes up to `late_seconds` longer.
    """

    latency: float = 0.001
    jitter: float = 0.002
    lost: float = 0.0
    repeated: float = 0.0
    late: float = 0.0
    late_seconds: float = 3.0


@dataclass(slots=True, eq=False)
class _Watch:
    """Delivery of a bucket's changes to one node, in order.

    It ends with the bucket, even if another one of this name is created.
    """

    bus: SimulatedBus
    bucket: Bucket
    changed: Changed
    complete: asyncio.Future[None]
    created: int = 0
    position: int = 0
    scheduled: bool = False
    ended: bool = False


@dataclass(slots=True, eq=False)
class _Subscription:
    """Messages on a subject for one node, in order."""

    bus: SimulatedBus
    subject: str
    received: Callable[[bytes], None]
    last: float = 0.0


@dataclass(slots=True)
class _Request:
    """Work that a node wants of the service, and what to do with the answer."""

    bus: SimulatedBus
    work: Callable[[], Any]
    reply: Callable[[Any], None]


class SimulatedNats:
    """The service.

    Attributes:
        chance: The source of all decisions.
        quality: The quality of all connections.
        loop: The loop of the nodes; the running one by default.
        quorum: False while the service stores nothing.
        commit_seconds: The longest time that passes between the check of a message for a journal
            and its storage. Several messages may be checked before the first one is stored.
        storage: Journals, buckets and files.
    """

    def __init__(
        self,
        chance: random.Random | None = None,
        quality: Quality | None = None,
        loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        self.chance = chance or random.Random(0)
        self.quality = quality or Quality()
        self.loop = loop or asyncio.get_running_loop()
        self.quorum = True
        self.commit_seconds = 0.0
        self._committed_at = 0.0
        self.storage = SimulatedStorage(self.loop.time, self.chance)
        self.storage.on_set.append(lambda bucket, key, value: self._changed(bucket))
        self._context = copy_context()
        self._watches: list[_Watch] = []
        self._handlers: dict[str, tuple[SimulatedBus, Handler]] = {}
        self._proposed: list[_Request] = []
        self._subscriptions: list[_Subscription] = []

    def bus(self, name: str = "") -> SimulatedBus:
        """Connect a node. Answers arrive in the caller's context."""
        return SimulatedBus(self, name)

    def lose_quorum(self) -> None:
        self.quorum = False

    def regain_quorum(self) -> None:
        """Continue, and decide what was proposed without a quorum: it is done or forgotten."""
        self.quorum = True
        proposed, self._proposed = self._proposed, []
        for request in proposed:
            if self.chance.random() < 0.5:
                self._serve(request)
        for bucket in Bucket:
            self._changed(bucket)

    # Transport

    def delays(self, *, repeats: bool = True) -> list[float]:
        """Return the delay of each copy of a message that arrives."""
        copies = 2 if repeats and self._happens(self.quality.repeated) else 1
        return [self._delay() for _ in range(copies) if not self._happens(self.quality.lost)]

    def _happens(self, probability: float) -> bool:
        return probability > 0 and self.chance.random() < probability

    def _delay(self) -> float:
        quality = self.quality
        late = self.chance.random() * quality.late_seconds if self._happens(quality.late) else 0.0
        return quality.latency + self.chance.random() * quality.jitter + late

    def send(
        self,
        bus: SimulatedBus,
        work: Callable[[], T],
        reply: Callable[[T | BusError], None],
        *,
        repeats: bool = True,
    ) -> None:
        """Let the service do some work for a node."""
        request = _Request(bus, work, reply)
        for delay in self.delays(repeats=repeats):
            self.loop.call_later(delay, self._arrive, request, context=self._context)

    def _arrive(self, request: _Request) -> None:
        if not request.bus.reaches:
            request.bus.buffer(lambda: self._arrive(request))
        elif self.quorum:
            self._serve(request)
        else:
            self._without_quorum(request)

    def _without_quorum(self, request: _Request) -> None:
        """Refuse a request, be silent, or keep it as a leader does that is alone."""
        what = self.chance.random()
        if what < 0.3:
            self._answer(request, UnavailableError("NATS has no JetStream or no quorum"))
        elif what < 0.6:
            self._proposed.append(request)

    def _serve(self, request: _Request) -> None:
        try:
            self._answer(request, request.work())
        except BusError as error:
            self._answer(request, error)

    def append(
        self, bus: SimulatedBus, message: Append, reply: Callable[[int | BusError], None]
    ) -> None:
        """Check a message for a journal, and store it later."""
        if not self.commit_seconds:
            self.send(bus, lambda: self.storage.append(bus.name, message), reply)
            return
        store = _Request(bus, lambda: self.storage.apply(bus.name, message), reply)

        def checked(known: int | None) -> None:
            if known is not None:
                self._answer(store, known)
                return
            delay = self.chance.random() * self.commit_seconds
            self._committed_at = max(self.loop.time() + delay, self._committed_at + SOONEST)
            self.loop.call_at(self._committed_at, self._commit, store, context=self._context)

        def refused(result: int | BusError | None) -> None:
            if isinstance(result, BusError):
                reply(result)

        self.send(bus, lambda: checked(self.storage.check(message)), refused)

    def _commit(self, store: _Request) -> None:
        if self.quorum:
            self._serve(store)
        else:
            self._proposed.append(store)

    def _answer(self, request: _Request, result: Any) -> None:
        for delay in self.delays():
            # The answer belongs to the process of the node, the way to it does not.
            self.loop.call_later(delay, self._deliver, request, result, context=request.bus.context)

    def _deliver(self, request: _Request, result: Any) -> None:
        if request.bus.hears and not request.bus.closed:
            request.reply(result)

    # Watches

    def watch(self, watch: _Watch) -> None:
        created = self.storage.created().get(watch.bucket)
        if created is None:
            raise UnavailableError(f"NATS: the bucket {watch.bucket} does not exist")
        if watch not in self._watches and not watch.ended:
            watch.created = created
            self._watches.append(watch)
            self._wake(watch)

    def end_watch(self, watch: _Watch) -> None:
        watch.ended = True
        self._watches = [other for other in self._watches if other is not watch]

    def _changed(self, bucket: Bucket) -> None:
        for watch in self._watches:
            if watch.bucket is bucket:
                self._wake(watch)

    def forget(self, bus: SimulatedBus) -> None:
        self._watches = [watch for watch in self._watches if watch.bus is not bus]
        self._subscriptions = [s for s in self._subscriptions if s.bus is not bus]

    def watches(self, bus: SimulatedBus) -> Iterator[_Watch]:
        return (watch for watch in self._watches if watch.bus is bus)

    def _wake(self, watch: _Watch) -> None:
        if not watch.scheduled:
            watch.scheduled = True
            self.loop.call_later(self._delay(), self._pump, watch, context=self._context)

    def _pump(self, watch: _Watch) -> None:
        watch.scheduled = False
        bus = watch.bus
        if self.storage.created().get(watch.bucket) != watch.created:
            return
        if bus.hears and bus.watches and self.quorum and not bus.closed:
            watch.position, changes = self.storage.changes(watch.bucket, watch.position)
            self.loop.call_soon(_deliver_changes, watch, changes, context=bus.context)

    def wake(self, bus: SimulatedBus) -> None:
        for watch in self.watches(bus):
            self._wake(watch)

    # Messages of nodes to nodes, which need no quorum

    def publish(self, bus: SimulatedBus, subject: str, data: bytes) -> None:
        """Pass a message on to all subscribers, or lose it."""
        for subscription in self._subscriptions:
            if subscription.subject != subject or not bus.reaches:
                continue
            for delay in self.delays(repeats=False):
                at = max(self.loop.time() + delay, subscription.last + SOONEST)
                subscription.last = at
                context = subscription.bus.context
                self.loop.call_at(at, _receive, subscription, data, context=context)

    def subscribe(self, subscription: _Subscription) -> None:
        self._subscriptions.append(subscription)

    def unsubscribe(self, subscription: _Subscription) -> None:
        if subscription in self._subscriptions:
            self._subscriptions.remove(subscription)

    def answer(self, bus: SimulatedBus, subject: str, handler: Handler) -> None:
        self._handlers[subject] = bus, handler

    def ask(
        self, bus: SimulatedBus, subject: str, data: bytes, reply: Callable[[Any], None]
    ) -> None:
        for delay in self.delays():
            self.loop.call_later(
                delay, self._pass_on, bus, subject, data, reply, context=self._context
            )

    def _pass_on(
        self, bus: SimulatedBus, subject: str, data: bytes, reply: Callable[[Any], None]
    ) -> None:
        if not bus.reaches:
            bus.buffer(lambda: self._pass_on(bus, subject, data, reply))
            return
        prefix, _, word = subject.rpartition(".")
        asker = _Request(bus, lambda: None, reply)
        target, handler = self._handlers.get(prefix, (bus, None))
        if handler is None or target.closed:
            self._answer(asker, NoAnswererError("no node answers"))
        elif target.hears:
            self.loop.create_task(
                self._handle(target, partial(handler, word, data), asker),
                context=target.context.copy(),
            )

    async def _handle(
        self, target: SimulatedBus, work: Callable[[], Awaitable[bytes]], asker: _Request
    ) -> None:
        # The target may die before this task begins, so the work begins here.
        answer = await work()
        if target.reaches:
            self._answer(asker, answer)


def _receive(subscription: _Subscription, data: bytes) -> None:
    if subscription.bus.hears and not subscription.bus.closed:
        subscription.received(data)


def _deliver_changes(watch: _Watch, changes: list[tuple[str, Entry | None]]) -> None:
    if watch.bus.closed or watch.ended:
        return
    for change in changes:
        watch.changed(*change)
    if not watch.complete.done():
        watch.complete.set_result(None)


class SimulatedBus:
    """`Bus` of one node.

    Attributes:
        reaches: False while nothing that the node sends arrives.
        hears: False while nothing arrives at the node.
        watches: False while no changes of buckets arrive.
        closed: True once the node is gone.
        context: The context in which answers arrive.
    """

    def __init__(self, nats: SimulatedNats, name: str) -> None:
        self.name = name
        self.reaches = self.hears = self.watches = True
        self.closed = False
        self.context: Context = copy_context()
        self._nats = nats
        self._storage = nats.storage
        self._buffered: list[Callable[[], None]] = []
        self._watching: dict[Bucket, _Watch] = {}
        self._created = nats.storage.created()

    @property
    def connected(self) -> bool:
        return self.reaches and self.hears

    # For tests

    def cut(self, *, answers_only: bool = False) -> None:
        """Cut the node off, or only lose everything that is sent to it."""
        self.reaches, self.hears = answers_only, False

    def deafen(self) -> None:
        """Send the node no changes of buckets."""
        self.watches = False

    def heal(self) -> None:
        """Connect the node again; the client library then sends what it has kept."""
        self.reaches = self.hears = self.watches = True
        buffered, self._buffered = self._buffered, []
        for arrive in buffered:
            arrive()
        self._nats.wake(self)

    def buffer(self, arrive: Callable[[], None]) -> None:
        """Lose a message, or keep it until the connection is back."""
        if self._nats.chance.random() < 0.5:
            self._buffered.append(arrive)

    def close(self) -> None:
        """Forget the node, whose process has ended."""
        self.closed = True
        self._nats.forget(self)

    # The protocol

    async def _ask(
        self, work: Callable[[], T], *, repeats: bool = True, seconds: float = ANSWER_SECONDS
    ) -> T:
        answer: asyncio.Future[T] = self._nats.loop.create_future()
        self._nats.send(self, work, lambda result: _settle(answer, result), repeats=repeats)
        return await _answered(answer, seconds)

    def append(self, message: Append, done: Callable[[int | BusError], None]) -> None:
        waiting = [done]

        def finish(result: int | BusError) -> None:
            if waiting:
                waiting.pop()(result)

        late = UnavailableError("NATS does not answer")
        self._nats.loop.call_later(ANSWER_SECONDS, finish, late, context=self.context)
        self._nats.append(self, message, finish)

    async def prepare(self) -> None:
        await self._ask(self._storage.prepare)
        self._created = await self._ask(self._storage.created)

    async def intact(self) -> bool:
        return await self._ask(self._storage.created) == self._created

    async def last(self, subject: str) -> Stored | None:
        messages = await self._ask(lambda: self._storage.read(subject))
        return messages[-1] if messages else None

    async def read(self, subject: str, after: int = 0) -> list[Stored]:
        messages = await self._ask(lambda: self._storage.read(subject))
        return [message for message in messages if message.sequence > after]

    async def purge(self, subject: str) -> None:
        await self._ask(lambda: self._storage.purge(subject))

    async def journals(self) -> list[str]:
        return await self._ask(lambda: self._storage.journals)

    async def get(self, bucket: Bucket, key: str) -> Entry | None:
        return await self._ask(lambda: self._storage.get(bucket, key))

    async def put(self, bucket: Bucket, key: str, value: bytes) -> int:
        return await self._ask(lambda: self._storage.set(bucket, key, value))

    # The library sends a request once, and the second of two would conflict with the first.

    async def create(self, bucket: Bucket, key: str, value: bytes) -> int:
        return await self._ask(lambda: self._storage.create(bucket, key, value), repeats=False)

    async def update(self, bucket: Bucket, key: str, value: bytes, revision: int) -> int:
        work = lambda: self._storage.update(bucket, key, value, revision)  # noqa: E731
        return await self._ask(work, repeats=False)

    async def delete(self, bucket: Bucket, key: str) -> None:
        await self._ask(lambda: self._storage.set(bucket, key, None))

    async def watch(self, bucket: Bucket, changed: Changed) -> None:
        watch = _Watch(self, bucket, changed, self._nats.loop.create_future())
        try:
            await self._ask(lambda: self._nats.watch(watch))
            await _answered(watch.complete, WATCH_SECONDS)
        except BaseException:
            self._nats.end_watch(watch)
            raise
        earlier = self._watching.pop(bucket, None)
        self._watching[bucket] = watch
        if earlier is not None:
            self._nats.end_watch(earlier)

    async def store(self, name: str, content: bytes) -> None:
        await self._ask(lambda: self._storage.keep_file(name, content))

    async def request(self, subject: str, data: bytes, seconds: float) -> bytes:
        answer: asyncio.Future[bytes] = self._nats.loop.create_future()
        self._nats.ask(self, subject, data, lambda result: _settle(answer, result))
        return await _answered(answer, seconds)

    async def answer(self, subject: str, handler: Handler) -> None:
        self._nats.answer(self, subject, handler)

    def publish(self, subject: str, data: bytes) -> None:
        self._nats.publish(self, subject, data)

    async def subscribe(
        self, subject: str, received: Callable[[bytes], None]
    ) -> Callable[[], Awaitable[None]]:
        subscription = _Subscription(self, subject, received)

        async def end() -> None:
            self._nats.unsubscribe(subscription)

        self._nats.subscribe(subscription)
        return end


def _settle(answer: asyncio.Future[T], result: T | BusError) -> None:
    if answer.done():
        return
    if isinstance(result, BusError):
        answer.set_exception(result)
    else:
        answer.set_result(result)


async def _answered(answer: asyncio.Future[T], seconds: float) -> T:
    try:
        async with asyncio.timeout(seconds):
            return await answer
    except TimeoutError:
        raise UnavailableError("NATS does not answer") from None
