"""Addresses and credentials of the NATS servers of a cluster."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import SplitResult, urlsplit

from robotouille.errors import RobotouilleError
from robotouille.files.certificates import client_context
from robotouille.files.private import read_private

if TYPE_CHECKING:
    import ssl

MAX_PASSWORD_BYTES = 4096


@dataclass(frozen=True, slots=True)
class NatsAddress:
    """Address of NATS, and the credentials for it.

    Attributes:
        servers: The URLs of its servers, without a user.
        prefix: The first word of all subjects, streams and buckets, so that several clusters can
            share a NATS.
        user: The user, or empty.
        password: The password of the user.
        credentials: A file with a JWT and its key, as `nsc` makes it.
        tls: The context for `tls://` addresses.
    """

    servers: tuple[str, ...]
    prefix: str
    user: str = ""
    password: str = field(default="", repr=False)
    credentials: str = ""
    tls: ssl.SSLContext | None = None


def nats_address(
    servers: str,
    prefix: str,
    *,
    password_file: Path | None = None,
    ca: Path | None = None,
    credentials: Path | None = None,
) -> NatsAddress:
    """Return the address that the options `--cluster…` of a program give.

    Args:
        servers: URLs with commas between them.
        prefix: The name of the cluster.
        password_file: A file with the password of the user.
        ca: The certificate authority of the servers. None means the system's.
        credentials: A file with a JWT and its key.

    Raises:
        RobotouilleError: An address or a file is invalid.
    """
    parts = [_parts(text.strip()) for text in servers.split(",") if text.strip()]
    if not parts:
        raise RobotouilleError("--cluster: no address of a NATS server")
    users = {part.username or "" for part in parts}
    if len(users) > 1 or any(part.password for part in parts):
        raise RobotouilleError(
            "--cluster: give all addresses the same user, and the password in a file: "
            "--cluster-password-file"
        )
    encrypted = any(part.scheme == "tls" for part in parts) or ca is not None
    return NatsAddress(
        tuple(f"{part.scheme}://{part.netloc.rpartition('@')[2]}" for part in parts),
        prefix,
        users.pop(),
        _password(password_file),
        str(credentials or ""),
        client_context(ca, "--cluster-ca") if encrypted else None,
    )


def _parts(text: str) -> SplitResult:
    try:
        parts = urlsplit(text)
        valid = parts.scheme in ("nats", "tls") and parts.hostname and parts.port != 0
    except ValueError:
        valid = False
    if not valid:
        raise RobotouilleError(
            f"--cluster: {text!r} is not nats://[USER@]HOST[:PORT] or tls://[USER@]HOST[:PORT]"
        )
    return parts


def _password(file: Path | None) -> str:
    if file is None:
        return ""
    try:
        return read_private(file, MAX_PASSWORD_BYTES).decode("utf-8", "replace").strip()
    except FileNotFoundError:
        raise RobotouilleError(f"--cluster-password-file: {file}: no such file") from None
