"""Connection to the MQTT broker, configured by the server's settings."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import secrets
import socket
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from urllib.parse import unquote, urlsplit

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from robotouille.errors import RobotouilleError
from robotouille.files.certificates import client_context
from robotouille_server.auth import read_private
from robotouille_server.mqtt.client import BoundedClient
from robotouille_server.mqtt.messages import MAX_PACKET_BYTES
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.workers import WorkerSlot
from robotouille_server.transport import LoopBudget

PORTS = {"mqtt": 1883, "mqtts": 8883}
MAX_PASSWORD_BYTES = 4096
MAX_NAME = 64
_NAME = re.compile(r"[^\x00-\x20/+#$\x7f][^\x00-\x20/+#\x7f]*")

ANSWER_SECONDS = 5.0
"""Time that the broker has to answer, or to accept data."""
CONNECT_SECONDS = 3.0
KEEPALIVE_SECONDS = 15
"""The broker publishes the will after 1.5 times this period without data."""
SESSION_SECONDS = 1
"""Time for which the broker keeps the session of a lost connection.

It must not be 0: a broker publishes the will of a session that another server takes over, unless
the session outlives its connection.
"""
TAKEN_OVER = 0x8E
"""MQTT 5 reason for which a broker closes a connection: another one uses its client id."""
CLOSE_TURNS = 10
LIBRARY_LOG = logging.getLogger("robotouille.mqtt")
LIBRARY_LOG.setLevel(logging.CRITICAL)  # aiomqtt logs every attempt; the service logs one a minute.

Connect = Callable[[bool], AbstractAsyncContextManager[BoundedClient]]
"""Function that opens a connection.

Its argument is False if another server has taken over the name. The connection then has a client id
of its own and no will.
"""


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """Address and credentials of a broker. `tls` is None for unencrypted connections."""

    host: str
    port: int
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: ssl.SSLContext | None = field(default=None, repr=False)

    def __str__(self) -> str:
        """Return the URL without user and password, for logs."""
        scheme = "mqtt" if self.tls is None else "mqtts"
        return f"{scheme}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    @classmethod
    def from_settings(cls, settings: ServerSettings) -> BrokerAddress:
        """Return the broker that `--mqtt` names.

        Raises:
            RobotouilleError: The URL is invalid or contains a password, or a file is unusable.
        """
        try:
            parts = urlsplit(settings.mqtt)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise RobotouilleError(f"--mqtt: {error}") from None
        if parts.password is not None:
            raise RobotouilleError(
                "--mqtt: remove the password from the URL, because all users of this machine can "
                "read command lines; use --mqtt-password-file or ROBOTOUILLE_MQTT_PASSWORD"
            )
        extra = parts.path.strip("/") or parts.query or parts.fragment
        if parts.scheme not in PORTS or not host or extra:
            raise RobotouilleError("--mqtt: expected mqtt://[USER@]HOST[:PORT] or mqtts://…")
        _check_host(host)
        return cls(
            host=host,
            port=port or PORTS[parts.scheme],
            user=unquote(parts.username) if parts.username else None,
            password=_password(settings),
            tls=_tls(settings) if parts.scheme == "mqtts" else None,
        )


def _check_host(host: str) -> None:
    # The resolver raises UnicodeError for such names, at every attempt to connect.
    try:
        encoded = host.encode("idna")
    except UnicodeError:
        encoded = b""
    if not encoded or any(byte <= 0x20 for byte in encoded):
        raise RobotouilleError(f"--mqtt: {host!r} is not a host name or address")


def _password(settings: ServerSettings) -> str | None:
    file = settings.mqtt_password_file
    if file is None:
        secret = settings.mqtt_password
        return None if secret is None else secret.get_secret_value()
    try:
        return read_private(file, MAX_PASSWORD_BYTES).decode().rstrip("\r\n")
    except FileNotFoundError:
        raise RobotouilleError(f"--mqtt-password-file: {file} does not exist") from None
    except UnicodeDecodeError:
        raise RobotouilleError(f"--mqtt-password-file: {file} is not UTF-8") from None


def _tls(settings: ServerSettings) -> ssl.SSLContext:
    context = client_context(settings.mqtt_ca, "--mqtt-ca")
    # The first handshake has a thread of its own; another one would block the event loop, with
    # numbers of the broker's choice for seconds.
    context.options |= ssl.OP_NO_RENEGOTIATION
    return context


def server_name(settings: ServerSettings, worker: WorkerSlot, port: int) -> str:
    """Return the server's name in topics. Each worker process has its own.

    Raises:
        RobotouilleError: The name is not valid in a topic.
    """
    name = settings.mqtt_name or f"{socket.gethostname()}-{port}"
    if len(name) > MAX_NAME or not _NAME.fullmatch(name) or not name.isprintable():
        raise RobotouilleError(
            f"--mqtt-name: {name!r} is not valid in a topic: use 1 to {MAX_NAME} characters "
            "without spaces, /, + and #"
        )
    return f"{name}-w{worker.index}" if worker.count > 1 else name


def broker_connection(
    address: BrokerAddress,
    name: str,
    will: tuple[str, bytes],
    metrics: Metrics,
    budget: LoopBudget,
    authorized: Callable[[bytes], bool],
) -> Connect:
    """Return a function that opens a connection to a broker.

    Args:
        address: The broker.
        name: The server's name. The broker closes older connections with the same name.
        will: The topic and payload that the broker publishes when the connection is lost.
        metrics: Counts dropped commands.
        authorized: Returns whether a command contains a valid token.
    """

    @asynccontextmanager
    async def connect(owns_name: bool) -> AsyncIterator[BoundedClient]:
        identifier = f"robotouille-{name}"
        client = BoundedClient(
            metrics=metrics,
            budget=budget,
            authorized=authorized,
            hostname=address.host,
            port=address.port,
            username=address.user,
            password=address.password,
            identifier=identifier if owns_name else f"{identifier}-{secrets.token_hex(4)}",
            protocol=aiomqtt.ProtocolVersion.V5,
            clean_start=False,
            will=aiomqtt.Will(*will, qos=1, retain=True) if owns_name else None,
            timeout=ANSWER_SECONDS,
            keepalive=KEEPALIVE_SECONDS,
            properties=_connect_properties(),
            logger=LIBRARY_LOG,
            tls_context=address.tls,
            # The socket of TLS is one end of a pair, which has no such option.
            socket_options=[] if address.tls else [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
        )
        client._client.connect_timeout = CONNECT_SECONDS  # aiomqtt has no option for it.
        try:
            async with client:
                yield client
        finally:
            await _close_socket(client)
            if _taken_over(client):
                raise NameTakenError(f"another server uses the name {name}")

    return connect


class NameTakenError(aiomqtt.MqttError):
    """The broker closed the connection, because another server uses the same name."""


def _connect_properties() -> Properties:
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
    properties.MaximumPacketSize = MAX_PACKET_BYTES
    properties.SessionExpiryInterval = SESSION_SECONDS
    return properties


async def _close_socket(client: aiomqtt.Client) -> None:
    # If the broker did not answer, aiomqtt keeps the socket and a task that checks it every second.
    # paho closes a socket only when a read fails, which takes the event loop a few turns.
    for _ in range(CLOSE_TURNS):
        open_socket = client._client.socket()
        if not isinstance(open_socket, socket.socket):
            break
        with contextlib.suppress(OSError):
            open_socket.shutdown(socket.SHUT_RDWR)
        await asyncio.sleep(0)
    if client._disconnected.done():
        client._disconnected.exception()  # Otherwise asyncio warns that nobody retrieved it.


def _taken_over(client: aiomqtt.Client) -> bool:
    lost = client._disconnected.exception() if client._disconnected.done() else None
    reason = lost.rc if isinstance(lost, aiomqtt.MqttCodeError) else None
    return isinstance(reason, ReasonCode) and reason.value == TAKEN_OVER
