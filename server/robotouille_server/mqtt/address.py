"""Where the broker is, and how the server proves who it is: from the settings."""

from __future__ import annotations

import re
import socket
import ssl
from dataclasses import dataclass, field
from urllib.parse import unquote, urlsplit

from robotouille.errors import RobotouilleError
from robotouille_server.auth import read_private
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.workers import WorkerSlot

__all__ = ["BrokerAddress", "server_name"]

PORTS = {"mqtt": 1883, "mqtts": 8883}
MAX_PASSWORD_BYTES = 4096
MAX_NAME = 64
_NAME = re.compile(r"[^\x00-\x20/+#$\x7f][^\x00-\x20/+#\x7f]*")


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """A broker: `tls` is None where nothing is encrypted."""

    host: str
    port: int
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: ssl.SSLContext | None = field(default=None, repr=False)

    def __str__(self) -> str:
        """The address without user and password, for logs."""
        scheme = "mqtt" if self.tls is None else "mqtts"
        return f"{scheme}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    @classmethod
    def from_settings(cls, settings: ServerSettings) -> BrokerAddress:
        """The broker of `--mqtt`.

        Raises:
            RobotouilleError: It is no such URL, has a password in it, or a file cannot be used.
        """
        try:
            parts = urlsplit(settings.mqtt)
            host, port = parts.hostname, parts.port
        except ValueError as error:
            raise RobotouilleError(f"--mqtt: {error}") from None
        if parts.password is not None:
            raise RobotouilleError(
                "--mqtt: no password in the URL, since everybody on the machine can read a command "
                "line; name a file with --mqtt-password-file, or set ROBOTOUILLE_MQTT_PASSWORD"
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
    """RobotouilleError if it can be no name of a host: else each attempt to reach it would be a
    fault of ours."""
    try:
        encoded = host.encode("idna")
    except UnicodeError:
        encoded = b""
    if not encoded or any(byte <= 0x20 for byte in encoded):
        raise RobotouilleError(f"--mqtt: {host!r} is no name or address of a host")


def _password(settings: ServerSettings) -> str | None:
    file = settings.mqtt_password_file
    if file is None:
        secret = settings.mqtt_password
        return None if secret is None else secret.get_secret_value()
    try:
        return read_private(file, MAX_PASSWORD_BYTES).decode().rstrip("\r\n")
    except FileNotFoundError:
        raise RobotouilleError(f"--mqtt-password-file: {file} is not there") from None
    except UnicodeDecodeError:
        raise RobotouilleError(f"--mqtt-password-file: {file} is not UTF-8") from None


def _tls(settings: ServerSettings) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=settings.mqtt_ca)
    except OSError as error:  # An SSLError is one, too.
        raise RobotouilleError(f"--mqtt-ca: {settings.mqtt_ca}: {error.strerror}") from None


def server_name(settings: ServerSettings, worker: WorkerSlot, port: int) -> str:
    """What a server is called in topics; each of several workers has a name of its own.

    Raises:
        RobotouilleError: The name cannot be a level of a topic.
    """
    name = settings.mqtt_name or f"{socket.gethostname()}-{port}"
    if len(name) > MAX_NAME or not _NAME.fullmatch(name) or not name.isprintable():
        raise RobotouilleError(
            f"--mqtt-name: {name!r} cannot be a part of a topic: 1 to {MAX_NAME} characters, "
            "no blanks and none of / + #"
        )
    return f"{name}-w{worker.index}" if worker.count > 1 else name
