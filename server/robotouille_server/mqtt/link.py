"""The task that keeps a connection to the broker, publishes what waits, and takes commands.

It runs in the server's event loop and gives way after each message, so that a step is never later
than by one of them. Whatever the broker does, those who play do not notice.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
from collections.abc import Iterator

from pydantic import BaseModel

from robotouille_server.mqtt.commands import Commands
from robotouille_server.mqtt.connection import BrokerError, Connect, Connection, Received
from robotouille_server.mqtt.models import Presence
from robotouille_server.mqtt.outbox import Outbox, Outgoing, TakenStep
from robotouille_server.mqtt.topics import Topics
from robotouille_server.mqtt.watches import Watches
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics

__all__ = ["MAX_STEPS_A_MESSAGE", "BrokerLink", "encoded", "pauses", "steps_interval"]

LOOK_SECONDS = 0.2
"""Between two looks at what waits."""
STEP_MESSAGES_A_SECOND = 100
"""One costs about as much as a whole step of a game: where more episodes are watched, each message
has more steps."""
MAX_STEPS_A_MESSAGE = 100
MAX_UNANSWERED = 100
"""Messages that wait for the broker while commands are still taken: answers, which may be long,
must not drive out what is told of episodes."""
MESSAGES_AT_ONCE = 16
"""That are on their way before the broker has said that it has the first."""
FIRST_PAUSE, MAX_PAUSE = 0.5, 30.0
STEADY_SECONDS = 10.0
"""A connection that lasted so long was none that the broker closes at once."""
STOP_SECONDS = 3.0
"""For what still waits when the server stops."""
LOG_SECONDS = 60.0


def pauses(rng: random.Random) -> Iterator[float]:
    """Seconds before each attempt, without end: they double on the whole up to MAX_PAUSE; each is
    drawn at random, so that the servers of a broker do not come back all at once."""
    longest = FIRST_PAUSE
    while True:
        yield longest * rng.uniform(0.5, 1.0)
        longest = min(2 * longest, MAX_PAUSE)


def steps_interval(watched: int) -> float:
    """Seconds between two messages with an episode's steps, where so many are watched."""
    return max(LOOK_SECONDS, watched / STEP_MESSAGES_A_SECOND)


def encoded(content: BaseModel) -> bytes:
    """A message's payload; fields at their defaults are left out. Half of a surrogate pair, which
    is in no UTF-8, becomes a question mark."""
    plain = content.model_dump(mode="json", exclude_defaults=True)
    return json.dumps(plain, separators=(",", ":"), ensure_ascii=False).encode(errors="replace")


class BrokerLink:
    """Connects again and again until it is stopped.

    Args:
        presence: What is published while the server is there.
        connect: Makes a connection.
        rng: For the pauses between attempts.
    """

    def __init__(
        self,
        outbox: Outbox,
        watches: Watches,
        commands: Commands,
        topics: Topics,
        metrics: Metrics,
        *,
        presence: Presence,
        connect: Connect,
        rng: random.Random,
    ) -> None:
        self._outbox = outbox
        self._watches = watches
        self._commands = commands
        self._topics = topics
        self._metrics = metrics
        self._presence = presence
        self._connect = connect
        self._rng = rng
        self._stopping = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._answering: set[asyncio.Future[None]] = set()
        self._steps_due = 0.0
        self._logged = -LOG_SECONDS

    def stop(self) -> None:
        """Publish what still waits, for a while, and that the server has stopped; `run` ends."""
        self._stopping.set()

    async def run(self) -> None:
        """Until it is stopped."""
        waits = pauses(self._rng)
        while not self._stopping.is_set():
            began = self._loop.time()
            try:
                async with self._connect() as connection:
                    await self._use(connection)
            except BrokerError as error:
                self._lost(str(error))
            except Exception:
                get_logger().exception("the connection to the broker failed")
            finally:
                self._metrics.mqtt_connected = False
            if self._loop.time() - began >= STEADY_SECONDS:
                waits = pauses(self._rng)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(next(waits)):
                    await self._stopping.wait()

    async def _use(self, connection: Connection) -> None:
        """One connection, until it is lost or the server stops."""
        await connection.subscribe(self._topics.commands)
        await self._publish_presence(connection, self._presence)
        self._metrics.mqtt_connected = True
        get_logger().info("broker connected")
        tasks = [
            asyncio.ensure_future(work)
            for work in (self._receive(connection), self._send(connection), self._stopping.wait())
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            task.result()
        await self._finish(connection)

    async def _finish(self, connection: Connection) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOP_SECONDS):
                await asyncio.gather(*self._answering)
                await self._send_messages(connection)
                await self._send_steps(connection)
                await self._publish_presence(connection, Presence(state="stopped"))

    async def _publish_presence(self, connection: Connection, presence: Presence) -> None:
        await connection.publish(self._topics.presence, encoded(presence), retain=True)

    def _lost(self, why: str) -> None:
        """Tell it once in a while: a broker that is gone may be so for days."""
        if self._loop.time() - self._logged >= LOG_SECONDS:
            self._logged = self._loop.time()
            get_logger().warning("no connection to the broker", reason=why)

    # Commands

    async def _receive(self, connection: Connection) -> None:
        while True:
            if self._outbox.messages > MAX_UNANSWERED:
                await asyncio.sleep(LOOK_SECONDS)
                continue
            received = await connection.receive()
            if received.retained:  # A stale one must not be carried out once more.
                continue
            task = asyncio.ensure_future(self._answer(received))
            self._answering.add(task)
            task.add_done_callback(self._answering.discard)
            await asyncio.shield(task)  # It is carried out whole, whatever the broker does.

    async def _answer(self, received: Received) -> None:
        self._outbox.add(await self._commands.answer(received))

    # Publishing

    async def _send(self, connection: Connection) -> None:
        while True:
            await self._send_messages(connection)
            now = self._loop.time()
            if now >= self._steps_due:
                self._watches.expire(now)
                self._steps_due = now + steps_interval(len(self._watches.episodes))
                await self._send_steps(connection)
                self._outbox.forget_all_but(self._watches.episodes)
            await asyncio.sleep(LOOK_SECONDS)

    async def _send_messages(self, connection: Connection) -> None:
        while batch := self._outbox.take(MESSAGES_AT_ONCE):
            sending = [asyncio.ensure_future(self._send_one(connection, each)) for each in batch]
            published = 0
            try:
                for each in sending:
                    await each
                    published += 1
            except BaseException:
                self._outbox.put_back(batch[published:])
                raise
            finally:
                self._metrics.mqtt_published += published
                for each in sending:
                    each.cancel()
                await asyncio.gather(*sending, return_exceptions=True)

    async def _send_one(self, connection: Connection, message: Outgoing) -> None:
        payload = encoded(message.content)
        await connection.publish(message.topic, payload, correlation=message.correlation)

    async def _send_steps(self, connection: Connection) -> None:
        waiting = [
            (episode, steps[at : at + MAX_STEPS_A_MESSAGE])
            for episode, steps in self._outbox.take_steps().items()
            for at in range(0, len(steps), MAX_STEPS_A_MESSAGE)
        ]
        for number, (episode, steps) in enumerate(waiting):
            payload = steps_payload(episode, steps, self._outbox.take_dropped(episode))
            try:
                await connection.publish(self._topics.steps(episode), payload, qos=0)
            except BaseException:
                for _, unsent in waiting[number:]:
                    self._outbox.drop(unsent)
                raise
            self._metrics.mqtt_published += 1
            await asyncio.sleep(0)


def steps_payload(episode: str, steps: list[TakenStep], dropped: int) -> bytes:
    """An `EpisodeSteps` as JSON, ten times as fast as by the model."""
    content: dict[str, object] = {
        "episode": episode,
        "steps": [
            {
                "step": taken.step,
                "t": taken.t,
                "utc_ms": taken.utc_ms,
                "moves": [
                    {
                        "player": move.player,
                        "action": [move.action.name, *move.action.arguments],
                        "applied": move.applied,
                        "ms": move.ms,
                    }
                    for move in taken.moves
                ],
            }
            for taken in steps
        ],
    }
    if dropped:
        content["dropped"] = dropped
    return json.dumps(content, separators=(",", ":")).encode()
