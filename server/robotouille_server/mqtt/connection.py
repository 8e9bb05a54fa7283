"""A connection to the broker: MQTT 5 by aiomqtt, which needs the extra `mqtt`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_server.mqtt.address import BrokerAddress

if TYPE_CHECKING:
    import aiomqtt

__all__ = ["BrokerError", "Connect", "Connection", "Received", "broker", "require_mqtt"]

ANSWER_SECONDS = 5.0
"""For the broker to answer, or to take what is sent."""
CONNECT_SECONDS = 3.0
KEEPALIVE_SECONDS = 15
"""After one and a half times that the broker takes the server for gone."""
MAX_PACKET_BYTES = 2 * 1024 * 1024
"""The broker is told to deliver nothing larger."""
MAX_CORRELATION = 256
"""Bytes that go back with an answer; longer ones do not."""
MAX_RECEIVED = 100
"""Commands that wait; more are dropped."""
CLOSE_TURNS = 10
SILENT = logging.getLogger("robotouille.mqtt")
"""For what the library says of each connection that breaks: the link says it once a minute."""
SILENT.setLevel(logging.CRITICAL)


class BrokerError(RobotouilleError):
    """There is no connection, or not any more."""


@dataclass(frozen=True, slots=True)
class Received:
    """A message from the broker. `retained`: it was published before we came."""

    payload: bytes
    retained: bool = False
    response_topic: str = ""
    correlation: bytes | None = None


class Connection(Protocol):
    """A connection; all of it raises BrokerError once it is lost or the broker does not answer."""

    async def subscribe(self, topic: str) -> None:
        """From now on `receive` gives what is published there."""

    async def publish(
        self,
        topic: str,
        payload: bytes,
        *,
        qos: Literal[0, 1] = 1,
        retain: bool = False,
        correlation: bytes | None = None,
    ) -> None:
        """Publish. With quality of service 1 wait until the broker says that it has it, with 0
        until it is on its way."""

    async def receive(self) -> Received:
        """Wait for the next message."""


Connect = Callable[[], AbstractAsyncContextManager[Connection]]


def require_mqtt() -> None:
    """MissingExtraError, with the line that installs it, where the library is missing."""
    try:
        import aiomqtt  # noqa: F401
    except ImportError:
        raise MissingExtraError("--mqtt", "mqtt") from None


def broker(address: BrokerAddress, name: str, will: tuple[str, bytes]) -> Connect:
    """Connects to a broker under this name, of which there is one at a time. The broker publishes
    the `will` (topic, payload), retained, if it does not hear of us any more."""
    import aiomqtt
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    @asynccontextmanager
    async def connect() -> AsyncIterator[Connection]:
        limits = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        limits.MaximumPacketSize = MAX_PACKET_BYTES
        client = aiomqtt.Client(
            address.host,
            address.port,
            username=address.user,
            password=address.password,
            identifier=f"robotouille-{name}",
            protocol=aiomqtt.ProtocolVersion.V5,
            will=aiomqtt.Will(*will, qos=1, retain=True),
            timeout=ANSWER_SECONDS,
            keepalive=KEEPALIVE_SECONDS,
            max_queued_incoming_messages=MAX_RECEIVED,
            properties=limits,
            logger=SILENT,
            tls_context=address.tls,
            socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
        )
        client.pending_calls_threshold = MAX_RECEIVED
        client._client.connect_timeout = CONNECT_SECONDS  # aiomqtt has no name for it.
        try:
            with _failures():
                async with client:
                    yield MqttConnection(client)
        finally:
            await _cut(client)

    return connect


async def _cut(client: aiomqtt.Client) -> None:
    """Nothing is left of a connection, also where the broker has not answered: aiomqtt would keep
    its socket and look at it once a second, and its future would complain of the end."""
    for _ in range(CLOSE_TURNS):
        open_socket = client._client.socket()
        if not isinstance(open_socket, socket.socket):
            break
        with contextlib.suppress(OSError):
            open_socket.shutdown(socket.SHUT_RDWR)
        await asyncio.sleep(0)
    if client._disconnected.done():
        client._disconnected.exception()


class MqttConnection:
    """A `Connection` on a client that is connected."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self._client = client
        self._messages = client.messages

    async def subscribe(self, topic: str) -> None:
        with _failures():
            await self._client.subscribe(topic, qos=1)

    async def publish(
        self,
        topic: str,
        payload: bytes,
        *,
        qos: Literal[0, 1] = 1,
        retain: bool = False,
        correlation: bytes | None = None,
    ) -> None:
        properties = None
        if correlation is not None:
            from paho.mqtt.packettypes import PacketTypes
            from paho.mqtt.properties import Properties

            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.CorrelationData = correlation
        with _failures():
            await self._client.publish(topic, payload, qos, retain, properties)

    async def receive(self) -> Received:
        with _failures():
            message = await anext(self._messages)
        content = message.payload
        correlation = getattr(message.properties, "CorrelationData", None)
        return Received(
            content if isinstance(content, bytes) else b"",
            message.retain,
            getattr(message.properties, "ResponseTopic", ""),
            correlation if len(correlation or b"") <= MAX_CORRELATION else None,
        )


@contextlib.contextmanager
def _failures() -> Iterator[None]:
    """The library's errors as BrokerError."""
    import aiomqtt

    try:
        yield
    except aiomqtt.MqttError as error:
        cause = error.__cause__
        raise BrokerError(f"{error}: {cause}" if cause is not None else str(error)) from None
