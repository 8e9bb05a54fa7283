"""MQTT service of a server: publishes its episodes, and executes commands from the broker.

The service runs in the server's event loop and yields after each message, so it delays a step by
one message at most. Episodes never wait for the broker.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import socket
from collections import deque
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from functools import partial

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from robotouille.installation import VERSION
from robotouille_server.app import Server
from robotouille_server.mqtt.broker import (
    BrokerAddress,
    Connect,
    NameTakenError,
    broker_connection,
    server_name,
)
from robotouille_server.mqtt.client import BoundedClient
from robotouille_server.mqtt.commands import Commands, too_large
from robotouille_server.mqtt.limits import has_host_token
from robotouille_server.mqtt.messages import Presence, Topics
from robotouille_server.mqtt.packets import publish_bytes
from robotouille_server.mqtt.stream import (
    Outbox,
    OutgoingMessage,
    RoomStream,
    StepRecord,
    Watches,
    encode,
    steps_payload,
)
from robotouille_server.runtime.logs import get_logger

SEND_SECONDS = 0.2
"""Period of publishing queued messages and steps."""
STEP_MESSAGES_A_SECOND = 100
"""A message costs as much as a step of an episode. With more watched episodes, messages are less
frequent and contain more steps."""
MAX_UNSENT = 100
"""Queued messages above which commands wait. Otherwise their replies, which may be long, would
displace lifecycle events."""
MAX_IN_FLIGHT = 16
"""Messages sent before the broker acknowledges the first one; fewer if it accepts fewer."""
MAX_CORRELATION = 256
"""Largest correlation data in bytes that a reply repeats."""
FIRST_PAUSE, MAX_PAUSE = 0.5, 30.0
STABLE_SECONDS = 10.0
"""Duration of a connection after which the pauses start at `FIRST_PAUSE` again."""
STOP_SECONDS = 3.0
"""Time to publish the queue when the server stops."""
LOG_SECONDS = 60.0


def reconnect_pauses(rng: random.Random) -> Iterator[float]:
    """Yield the pauses before attempts to connect: random, and doubling up to `MAX_PAUSE`."""
    # Random, because all servers of a broker lose their connections at the same time.
    longest = FIRST_PAUSE
    while True:
        yield longest * rng.uniform(0.5, 1.0)
        longest = min(2 * longest, MAX_PAUSE)


def steps_interval(watched: int) -> float:
    """Return the seconds between two messages with steps of one of so many watched episodes."""
    return max(SEND_SECONDS, watched / STEP_MESSAGES_A_SECOND)


@asynccontextmanager
async def on_broker(
    server: Server, *, connect: Connect | None = None, rng: random.Random | None = None
) -> AsyncIterator[None]:
    """Publish a server's episodes to the broker in its settings, and execute commands.

    Args:
        connect: Opens a connection. By default, to the broker in the settings.
        rng: Source of the random pauses between attempts to connect.

    Raises:
        RobotouilleError: A setting is invalid.
    """
    topics = Topics(server_name(server.settings, server.worker, server.port))
    if connect is None:
        address = BrokerAddress.from_settings(server.settings)
        will = topics.presence, encode(Presence(state="gone"))
        authorized = partial(has_host_token, server.tokens)
        connect = broker_connection(
            address, topics.server, will, server.metrics, server.admission.loop_budget, authorized
        )
        get_logger().info("broker", url=str(address), name=topics.server)
    service = BrokerService(server, topics, connect, rng or random.SystemRandom())
    running = asyncio.create_task(service.run(), name="broker")
    try:
        yield
    finally:
        service.stop()
        await running


class BrokerService:
    """Connects to the broker, again and again, until it is stopped.

    During a rolling restart, the next server takes over the name. This one then leaves presence and
    commands to it, and publishes only its own episodes until they end.
    """

    def __init__(self, server: Server, topics: Topics, connect: Connect, rng: random.Random):
        self._loop = asyncio.get_running_loop()
        self._topics = topics
        self._connect = connect
        self._rng = rng
        self._lobby = server.lobby
        self._metrics = server.metrics
        self._presence = _presence(server)
        self._outbox = Outbox(server.metrics)
        self._in_flight: list[OutgoingMessage] = []
        self._watches = Watches(server.lobby.rooms.values, server.tokens.revoked)
        self._commands = Commands(server, self._watches, self._loop.time)
        self._received: asyncio.Queue[aiomqtt.Message] = asyncio.Queue(maxsize=1)
        self._stopping = asyncio.Event()
        self._owns_name = True
        self._steps_due = 0.0
        self._logged = self._logged_too_large = -LOG_SECONDS
        server.lobby.observe(RoomStream(self._outbox, self._watches, topics, server.wall))

    def stop(self) -> None:
        """Let `run` publish the queue and return."""
        self._stopping.set()

    async def run(self) -> None:
        """Run until the service is stopped."""
        # This is not one of the connection's tasks, so that a lost connection does not interrupt a
        # command.
        executing = asyncio.create_task(self._execute_commands(), name="broker commands")
        pauses = reconnect_pauses(self._rng)
        self._metrics.mqtt_connected = False
        while not self._stopping.is_set():
            began = self._loop.time()
            try:
                async with self._connect(self._owns_name) as client:
                    await self._use(client)
            except* NameTakenError:
                self._owns_name = False
                get_logger().warning("another server uses the MQTT name", name=self._topics.server)
            except* aiomqtt.MqttError as errors:
                self._log_lost(errors)
            except* Exception:
                get_logger().exception("the MQTT connection failed")
            finally:
                self._metrics.mqtt_connected = False
                # Not every broker names the reason for which it closes a connection.
                self._owns_name = self._owns_name and not self._lobby.draining
            if self._loop.time() - began >= STABLE_SECONDS:
                pauses = reconnect_pauses(self._rng)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(next(pauses)):
                    await self._stopping.wait()
        executing.cancel()
        await asyncio.gather(executing, return_exceptions=True)

    async def _use(self, client: BoundedClient) -> None:
        if self._owns_name:
            await self._subscribe(client)
            await self._publish_presence(client, self._presence)
        self._metrics.mqtt_connected = True
        get_logger().info("broker connected")
        async with asyncio.TaskGroup() as tasks:
            working = [
                tasks.create_task(self._receive(client)),
                tasks.create_task(self._send(client)),
            ]
            await self._stopping.wait()
            for task in working:
                task.cancel()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOP_SECONDS):
                # This comes first, because a command waits until the queue is short.
                await self._send_messages(client)
                await self._received.join()
                await self._send_messages(client)
                await self._send_steps(client)
                if self._owns_name:
                    await self._publish_presence(client, Presence(state="stopped"))

    async def _subscribe(self, client: BoundedClient) -> None:
        topic = self._topics.commands
        for granted in await client.subscribe(topic, options=_subscribe_options()):
            if isinstance(granted, ReasonCode) and granted.is_failure:
                get_logger().error(
                    "the broker refuses the subscription, so no command arrives; check its access "
                    "control list",
                    topic=topic,
                    reason=str(granted),
                )

    async def _publish_presence(self, client: BoundedClient, presence: Presence) -> None:
        topic, payload = self._topics.presence, encode(presence)
        if publish_bytes(topic, payload) > client.largest_packet:
            self._log_too_large(client)
        else:
            await client.publish(topic, payload, qos=1, retain=True)

    def _log_lost(self, error: BaseException) -> None:
        # A broker may be gone for days, with an attempt to connect every 30 seconds.
        if self._loop.time() - self._logged >= LOG_SECONDS:
            self._logged = self._loop.time()
            while isinstance(error, BaseExceptionGroup):
                error = error.exceptions[0]
            reason = f"{error}: {error.__cause__}" if error.__cause__ else str(error)
            get_logger().warning("no connection to the broker", reason=reason)

    def _log_too_large(self, client: BoundedClient) -> None:
        if self._loop.time() - self._logged_too_large >= LOG_SECONDS:
            self._logged_too_large = self._loop.time()
            get_logger().warning(
                "messages are larger than the broker accepts; raise its maximum packet size",
                largest=client.largest_packet,
            )

    async def _receive(self, client: BoundedClient) -> None:
        async for message in client.messages:
            if not message.retain:  # A retained command would be executed at each connection.
                await self._received.put(message)

    async def _execute_commands(self) -> None:
        while True:
            message = await self._received.get()
            while len(self._outbox.messages) > MAX_UNSENT:  # noqa: ASYNC110
                await asyncio.sleep(SEND_SECONDS)
            try:
                await self._execute(message)
            except Exception:
                get_logger().exception("MQTT: no reply to a command")
            finally:
                self._received.task_done()

    async def _execute(self, message: aiomqtt.Message) -> None:
        payload = message.payload if isinstance(message.payload, bytes) else b""
        reply = await self._commands.execute(payload)
        if reply is None:
            return
        topic = self._topics.reply_topic(getattr(message.properties, "ResponseTopic", ""))
        correlation = getattr(message.properties, "CorrelationData", None)
        if len(correlation or b"") > MAX_CORRELATION:
            correlation = None
        payload = encode(reply)
        refusal = encode(too_large(reply, len(payload)))
        self._outbox.add(OutgoingMessage(topic, payload, correlation, refusal))

    async def _send(self, client: BoundedClient) -> None:
        while True:
            await self._send_messages(client)
            now = self._loop.time()
            if now >= self._steps_due:
                self._watches.expire(now)
                self._steps_due = now + steps_interval(len(self._watches.episodes))
                await self._send_steps(client)
                self._outbox.forget_all_but(self._watches.episodes)
            await asyncio.sleep(SEND_SECONDS)

    async def _send_messages(self, client: BoundedClient) -> None:
        # Messages stay in `_in_flight` until the broker has them. The next connection sends them
        # again, so the broker may receive one twice, but loses none.
        queued = self._outbox.messages
        at_once = max(1, min(MAX_IN_FLIGHT, client.receive_maximum))
        while queued or self._in_flight:
            while queued and len(self._in_flight) < at_once:
                self._in_flight.append(queued.popleft())
            async with asyncio.TaskGroup() as tasks:
                for message in self._in_flight[:at_once]:
                    tasks.create_task(self._send_message(client, message))

    async def _send_message(self, client: BoundedClient, message: OutgoingMessage) -> None:
        # The broker would close the connection, and the next connection would send it again.
        accepted = message.within(client.largest_packet)
        if accepted is None:
            self._metrics.mqtt_dropped_messages += 1
        else:
            await _publish(client, accepted)
            self._metrics.mqtt_published += 1
        self._in_flight.remove(message)
        if accepted is None or accepted.payload != message.payload:
            self._log_too_large(client)

    async def _send_steps(self, client: BoundedClient) -> None:
        waiting = self._outbox.take_steps()
        try:
            while waiting:
                await self._send_first_steps(waiting, client)
                await asyncio.sleep(0)
        finally:
            for steps in waiting:
                self._outbox.drop(steps)

    async def _send_first_steps(
        self, waiting: deque[list[StepRecord]], client: BoundedClient
    ) -> None:
        """Publish the first steps, or split or drop them if the broker does not accept so many."""
        steps = waiting[0]
        episode = steps[0].episode
        dropped = self._outbox.dropped(episode)
        topic, payload = self._topics.steps(episode), steps_payload(steps, dropped)
        if publish_bytes(topic, payload) <= client.largest_packet:
            await client.publish(topic, payload, qos=0)
            waiting.popleft()
            self._outbox.dropped_reported(episode, dropped)
            self._metrics.mqtt_published += 1
            return
        waiting.popleft()
        if middle := len(steps) // 2:
            waiting.extendleft((steps[middle:], steps[:middle]))
        else:
            self._outbox.drop(steps)
            self._log_too_large(client)


async def _publish(client: BoundedClient, message: OutgoingMessage) -> None:
    properties = None
    if message.correlation is not None:
        properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        properties.CorrelationData = message.correlation
    await client.publish(message.topic, message.payload, qos=1, properties=properties)


def _subscribe_options() -> SubscribeOptions:
    # A retained command would be executed at each connection.
    never = SubscribeOptions.RETAIN_DO_NOT_SEND
    return SubscribeOptions(qos=1, retainHandling=never)


def _presence(server: Server) -> Presence:
    worker, url = server.worker, server.url
    if server.settings.host in ("0.0.0.0", "::"):  # noqa: S104
        url = f"{url.partition(':')[0]}://{socket.gethostname()}:{server.port}"
    return Presence(
        state="online",
        url=url,
        version=VERSION,
        since_utc_ms=round(server.wall() * 1000),
        worker=worker.index,
        workers=worker.count,
    )
