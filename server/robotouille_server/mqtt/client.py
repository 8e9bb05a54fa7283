"""MQTT client that bounds what a broker, and whoever may send commands, can make it do.

aiomqtt and paho trust the broker: they read as long as data is pending, without a turn for other
tasks, up to 256 MiB a packet, and parse properties in quadratic time. Upstream options are wanted.
Until then, this replaces the methods of aiomqtt that register sockets and queue messages, and those
of paho that read from the socket and handle a packet.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf
from typing import Any

import aiomqtt
from paho.mqtt.client import Client as Paho
from paho.mqtt.client import ConnectFlags, MQTTMessage
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.exception import MQTTException
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from robotouille_server.mqtt.messages import MAX_PACKET_BYTES
from robotouille_server.mqtt.metered_socket import metered
from robotouille_server.mqtt.packets import (
    QOS_BITS,
    PacketError,
    packet_id,
    without_unused_properties,
)
from robotouille_server.runtime.budgets import TokenBucket
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport import LoopBudget

MAX_WAITING_COMMANDS = 100
"""Further commands are dropped. If half as many wait, those without a valid token are dropped."""
COMMANDS_READ_A_SECOND = 1000.0
"""Rate above which commands are dropped unread. Checking a token takes up to 0.3 ms."""
PACKETS_A_SECOND = 5000.0
"""Rate above which the connection is closed. The smallest packets take about 0.05 ms each. Each
`LARGE_BYTES` of a packet count as a packet."""
MAX_CONTROL_BYTES = 1024
"""Largest packet that is not a PUBLISH."""
MAX_UNSENT_PACKETS = 1000
"""Packets that wait because the broker does not read, above which the connection is closed."""
LARGE_BYTES = 8 * 1024
MQTT_RECEIVE_MAXIMUM = 65_535
"""Default of the standard (MQTT 5, section 3.2.2.3.3)."""
LOG_SECONDS = 60.0

_ONCE = {PacketTypes.CONNACK, PacketTypes.SUBACK, PacketTypes.DISCONNECT}
_EXPECTED = {*_ONCE, PacketTypes.PUBLISH, PacketTypes.PUBACK, PacketTypes.PINGRESP}
"""Packets that an honest broker sends: the client subscribes once, with QoS 1."""
_SUBSCRIBED_QOS = (0, 1 << 1)


class BoundedClient(aiomqtt.Client):
    """`aiomqtt.Client` for MQTT 5 with at most one subscription.

    It closes the connection if the broker sends what an honest one never sends. Messages that an
    honest broker may forward are only dropped, so that a client cannot disconnect the server.

    Args:
        metrics: Counts dropped commands.
        budget: Charged for TLS records.
        authorized: Returns whether a payload contains a valid token.
        options: Arguments of `aiomqtt.Client`.

    Attributes:
        largest_packet: The size in bytes of the largest packet that the broker accepts.
        receive_maximum: The number of messages that the broker accepts before it acknowledges one.
    """

    def __init__(
        self,
        *,
        metrics: Metrics,
        budget: LoopBudget,
        authorized: Callable[[bytes], bool],
        **options: Any,
    ) -> None:
        super().__init__(max_queued_incoming_messages=MAX_WAITING_COMMANDS, **options)
        self.largest_packet, self.receive_maximum = inf, MQTT_RECEIVE_MAXIMUM
        self._metrics = metrics
        self._authorized = authorized
        now = self._loop.time()
        self._packets = TokenBucket(PACKETS_A_SECOND, now, PACKETS_A_SECOND)
        self._commands = TokenBucket(COMMANDS_READ_A_SECOND, now, COMMANDS_READ_A_SECOND)
        self._seen: set[int] = set()
        self._again: asyncio.Handle | None = None
        self._logged = -LOG_SECONDS
        # aiomqtt forgets a connection that the broker has broken before the client uses it.
        self._disconnected.add_done_callback(lambda lost: lost.cancelled() or lost.exception())
        paho = self._client
        self._receive, self._handle = paho._sock_recv, paho._packet_handle
        paho._sock_recv = self._receive_bounded  # type: ignore[method-assign]
        if options.get("tls_context") is not None:
            self._budget, self._connect_plain = budget, paho._create_socket_connection
            paho._create_socket_connection = self._connect_metered  # type: ignore[method-assign]
        paho._packet_handle = self._handle_bounded  # type: ignore[method-assign]

    def _on_connect(
        self,
        client: Paho,
        userdata: Any,
        flags: ConnectFlags,
        reason_code: ReasonCode,
        properties: Properties | None = None,
    ) -> None:
        self.largest_packet = getattr(properties, "MaximumPacketSize", inf)
        self.receive_maximum = getattr(properties, "ReceiveMaximum", MQTT_RECEIVE_MAXIMUM)
        super()._on_connect(client, userdata, flags, reason_code, properties)

    def _connect_metered(self) -> socket.socket:
        # paho calls this in the thread that connects.
        broker = self._connect_plain()
        broker.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return metered(broker, self._loop, self._budget)

    def _on_socket_open(self, client: Paho, userdata: Any, sock: Any) -> None:
        # paho calls this in the thread that connects.
        self._loop.call_soon_threadsafe(self._start_reading, sock)

    def _start_reading(self, sock: Any) -> None:
        if sock.fileno() >= 0:
            self._loop.add_reader(sock.fileno(), self._read, sock)
        self._misc_task = self._loop.create_task(self._misc_loop())

    def _on_socket_register_write(self, client: Paho, userdata: Any, sock: Any) -> None:
        # paho also calls this in the thread that connects.
        self._loop.call_soon_threadsafe(self._start_writing, sock)

    def _start_writing(self, sock: Any) -> None:
        # The client may have closed the socket since.
        if sock.fileno() >= 0:
            self._loop.add_writer(sock.fileno(), self._write)

    def _write(self) -> None:
        with self._ending_on_errors():
            self._client.loop_write()

    @contextmanager
    def _ending_on_errors(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            if not self._disconnected.done():
                self._disconnected.set_exception(error)

    def _read(self, sock: Any) -> None:
        """Read about one packet, so that other tasks get a turn after each."""
        if self._again is not None:
            self._again.cancel()
        with self._ending_on_errors():
            self._client.loop_read()
            # The event loop does not report data that TLS has read from the socket and decrypted.
            if self._client.socket() is sock and isinstance(sock, ssl.SSLSocket) and sock.pending():
                self._again = self._loop.call_soon(self._read, sock)

    def _receive_bounded(self, bufsize: int) -> bytes:
        # paho asks for one byte, and later for all bytes that the packet's length announces.
        kind = self._client._in_packet["command"] >> 4
        largest = MAX_PACKET_BYTES if kind == PacketTypes.PUBLISH else MAX_CONTROL_BYTES
        if bufsize > largest:
            raise _closing(f"the broker sends a packet of {bufsize:,} bytes")
        received = self._receive(bufsize)
        if not kind and received:
            self._check_head(received[0])
        return received

    def _check_head(self, first: int) -> None:
        kind = first >> 4
        if not self._packets.take(self._loop.time()):
            raise _closing(f"the broker sends more than {PACKETS_A_SECOND:,.0f} packets a second")
        if len(self._client._out_packet) > MAX_UNSENT_PACKETS:
            raise _closing("the broker sends packets and reads none")
        expected = kind in _EXPECTED and (kind == PacketTypes.CONNACK) == (not self._seen)
        if not expected or (kind in _ONCE and kind in self._seen):
            raise _closing(f"the broker sends an unexpected packet of type {kind}")
        if kind == PacketTypes.PUBLISH and first & QOS_BITS not in _SUBSCRIBED_QOS:
            raise _closing("the broker sends a message of QoS 2")
        self._seen.add(kind)

    def _handle_bounded(self) -> MQTTErrorCode:
        packet = self._client._in_packet
        kind = packet["command"] >> 4
        self._packets.owe(self._loop.time(), len(packet["packet"]) // LARGE_BYTES)
        if kind == PacketTypes.PUBLISH:
            return self._handle_publish(packet["command"], packet["packet"])
        if kind == PacketTypes.PUBACK:
            del packet["packet"][3:]  # All but the identifier and the reason.
        return self._handle()

    def _handle_publish(self, first: int, body: bytearray) -> MQTTErrorCode:
        try:
            number = packet_id(first, body)
        except PacketError as error:
            _closing(f"the broker sends an invalid packet: {error}")
            return MQTTErrorCode.MQTT_ERR_PROTOCOL
        try:
            if not self._commands.take(self._loop.time()):
                raise PacketError(f"more than {COMMANDS_READ_A_SECOND:,.0f} commands a second")
            self._client._in_packet["packet"] = without_unused_properties(first, body)
            return self._handle()
        except (PacketError, MQTTException, UnicodeDecodeError) as error:
            self._drop(str(error))
        # Otherwise the broker would send the message again, at the next connection too.
        return self._client._send_puback(number) if number else MQTTErrorCode.MQTT_ERR_SUCCESS

    def _on_message(self, client: Paho, userdata: Any, message: MQTTMessage) -> None:
        waiting = self._queue.qsize()
        authorized = waiting < MAX_WAITING_COMMANDS // 2 or self._authorized(bytes(message.payload))
        if waiting < MAX_WAITING_COMMANDS and authorized:
            super()._on_message(client, userdata, message)
        else:
            self._drop("too many commands wait")

    def _on_publish(self, client: Paho, userdata: Any, mid: int, *details: Any) -> None:
        # Acknowledgements do not count as packets: after an interruption, thousands are normal.
        self._packets.take(self._loop.time(), -1)
        super()._on_publish(client, userdata, mid, *details)

    def _drop(self, reason: str) -> None:
        self._metrics.mqtt_dropped_commands += 1
        if self._loop.time() - self._logged >= LOG_SECONDS:
            self._logged = self._loop.time()
            dropped = self._metrics.mqtt_dropped_commands
            get_logger().warning("MQTT commands dropped", reason=reason, dropped=dropped)


def _closing(reason: str) -> OSError:
    # Logged here, because paho reports only that the connection was lost.
    get_logger().error("connection to the broker closed", reason=reason)
    return ConnectionAbortedError(reason)
