"""Reading long journals without delaying other traffic."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re

from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.errors import Error as NatsError
from nats.js import JetStreamContext
from nats.js.api import DEFAULT_PREFIX, AckPolicy, ConsumerConfig, DeliverPolicy, Header

from robotouille_server.cluster.bus import Stored

KEEP = "Robotouille-Keep"
MESSAGE_ID = str(Header.MSG_ID.value)
BATCH = 64
"""Messages that are requested at a time. The event loop takes 5 to 10 ms for them."""
BATCH_SECONDS = 2.0
"""Seconds after which a batch counts as lost."""


class JournalReader:
    """Reader of journals in batches.

    All messages of a long journal at once would take seconds of the event loop, and the answers to
    the writes of games would come after them. Only one batch is under way at a time, and the
    readers of several journals take turns.
    """

    def __init__(self, client: Client, jetstream: JetStreamContext, stream: str) -> None:
        self._client = client
        self._jetstream = jetstream
        self._stream = stream
        self._turn = asyncio.Lock()

    async def read(self, subject: str, after: int, last: int) -> list[Stored]:
        """Return the messages of a subject after one sequence number, at least up to another.

        Raises:
            TimeoutError: NATS does not send them, or the connection was lost in between.
        """
        config = ConsumerConfig(
            deliver_policy=DeliverPolicy.BY_START_SEQUENCE,
            opt_start_seq=after + 1,
            filter_subject=subject,
            ack_policy=AckPolicy.NONE,
        )
        consumer = (await self._jetstream.add_consumer(self._stream, config)).name
        inbox, arriving = self._client.new_inbox(), _Arriving(last)
        request = json.dumps({"batch": BATCH, "no_wait": True}).encode()
        next_messages = f"{DEFAULT_PREFIX}.CONSUMER.MSG.NEXT.{self._stream}.{consumer}"
        # `fetch` of the library would take more than twice the processor time.
        messages = await self._client.subscribe(inbox, cb=arriving.receive)
        try:
            while not arriving.complete:
                async with self._turn:
                    arriving.expect(BATCH)
                    await self._client.publish(next_messages, request, reply=inbox)
                    async with asyncio.timeout(BATCH_SECONDS):
                        await arriving.done.wait()
        finally:
            with contextlib.suppress(NatsError, OSError, TimeoutError):
                await messages.unsubscribe()
                await self._jetstream.delete_consumer(self._stream, consumer)
        return arriving.found


class _Arriving:
    """Messages of a consumer, as they arrive.

    Attributes:
        found: The messages.
        done: Is set when the batch has arrived.
    """

    def __init__(self, last: int) -> None:
        self.found: list[Stored] = []
        self.done = asyncio.Event()
        self._last = last
        self._expected = 0

    @property
    def complete(self) -> bool:
        """True if the last message is here."""
        return bool(self.found) and self.found[-1].sequence >= self._last

    def expect(self, count: int) -> None:
        """Begin a batch."""
        self.done.clear()
        self._expected = len(self.found) + count

    async def receive(self, message: Msg) -> None:
        # A batch that is not full ends with a status, which has no number.
        if not message.reply:
            return
        # After a gap, the batch is never complete.
        sequence = message.metadata.sequence
        if sequence.consumer == len(self.found) + 1:
            self.found.append(stored(sequence.stream, message.headers, message.data))
        if len(self.found) == self._expected or self.complete:
            self.done.set()


def stored(sequence: int, headers: dict[str, str] | None, data: bytes) -> Stored:
    """Return a message of a journal."""
    headers = headers or {}
    keep = headers.get(KEEP, "")
    # Another writer may have sent anything. The journal is then refused, because its content is
    # not that of its owner.
    cut = int(keep) if re.fullmatch("[0-9]{1,15}", keep) else None
    return Stored(sequence, headers.get(MESSAGE_ID, ""), data, cut)
