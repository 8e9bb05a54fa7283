"""TLS for the listening socket, with a certificate that can be renewed while the server runs."""

from __future__ import annotations

import asyncio
import ssl
import stat
import sys
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille_server.runtime.logs import get_logger
from robotouille_server.transport.certificate import certificate_names

__all__ = ["ServerTLS", "TLSFileError"]

POLL_SECONDS = 10.0


class TLSFileError(RobotouilleError):
    """A certificate or key that cannot be used: names the file, the fault, and the way out."""


class ServerTLS:
    """TLS 1.2 or newer with the certificate chain and the key of two PEM files.

    Pass `context` to the listening socket and keep `watch` running. Each handshake takes the
    certificate that is in force at that moment; a renewed one takes the place of the old only when
    it is whole and fits its key, and connections that are open go on.

    `name` is what clients may call this server: the first name in the certificate that is no
    wildcard, else the first address; empty if it has neither.
    """

    def __init__(self, cert: Path, key: Path) -> None:
        self.cert = cert
        self.key = key
        self._seen = self._fingerprint()
        self.context = self._current = _load(cert, key)
        self.context.sni_callback = self._use_current
        self.name = _name(cert)
        self._warn_if_open()

    @classmethod
    def from_settings(cls, cert: Path | None, key: Path | None) -> ServerTLS:
        """TLS as two settings ask for it; TLSFileError where only one is given."""
        if cert is None or key is None:
            given, missing = (
                ("--tls-cert", "--tls-key") if key is None else ("--tls-key", "--tls-cert")
            )
            raise TLSFileError(f"{given} is given without {missing}; TLS needs both")
        return cls(cert, key)

    def reload(self) -> bool:
        """Take a changed certificate; False where nothing has changed or it cannot be used."""
        seen = self._fingerprint()
        if seen == self._seen:
            return False
        self._seen = seen
        try:
            self._current = _load(self.cert, self.key)
        except TLSFileError as error:
            get_logger().error("certificate not reloaded; the old one stays", error=str(error))
            return False
        self.name = _name(self.cert)
        get_logger().info("certificate reloaded", file=str(self.cert))
        self._warn_if_open()
        return True

    async def watch(self, seconds: float = POLL_SECONDS) -> None:
        """Look every so often whether the files have changed, until cancelled."""
        while True:
            await asyncio.sleep(seconds)
            self.reload()

    def _use_current(
        self, connection: ssl.SSLSocket | ssl.SSLObject, name: str | None, context: ssl.SSLContext
    ) -> None:
        # A context into which a chain is loaded again holds, for a moment or after a fault, the
        # new certificate with the old key; whole contexts are exchanged instead.
        connection.context = self._current

    def _fingerprint(self) -> tuple[tuple[int, int, int] | None, ...]:
        return tuple(_stamp(path) for path in (self.cert, self.key))

    def _warn_if_open(self) -> None:
        if sys.platform != "win32" and stat.S_IMODE(self.key.stat().st_mode) & 0o007:
            get_logger().warning(
                "others can read the TLS key", file=str(self.key), advice=f"chmod 600 {self.key}"
            )


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino, found.st_size


def _load(cert: Path, key: Path) -> ssl.SSLContext:
    _check_pem(cert, b"-----BEGIN CERTIFICATE-----", "certificate", "--tls-cert")
    _check_pem(key, b"PRIVATE KEY-----", "private key", "--tls-key")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(cert, key, password=_refuse_passphrase)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            fault = f"the key {key} does not belong to the certificate {cert}"
            raise TLSFileError(f"{fault}; renew both") from None
        fault = (error.reason or str(error)).replace("_", " ").lower()
        raise TLSFileError(f"{cert} and {key} cannot be used: {fault}") from None
    except _NeedsPassphraseError:
        raise TLSFileError(
            f"{key}: the key has a passphrase, which a server cannot be asked for; "
            f"write it without: openssl pkey -in KEY -out NEW"
        ) from None
    except OSError as error:
        raise TLSFileError(f"{cert} and {key} cannot be read: {error.strerror}") from None
    return context


def _name(cert: Path) -> str:
    try:
        dns, addresses = certificate_names(cert.read_bytes())
    except OSError:  # Gone since it was loaded.
        return ""
    return next((name for name in [*dns, *addresses] if "*" not in name), "")


class _NeedsPassphraseError(Exception):
    """The key is encrypted."""


def _refuse_passphrase() -> str:
    """Instead of a prompt on the terminal, which would stop the server."""
    raise _NeedsPassphraseError


def _check_pem(path: Path, mark: bytes, what: str, flag: str) -> None:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TLSFileError(f"{flag} {path}: {error.strerror}") from None
    if mark not in content:
        raise TLSFileError(f"{flag} {path}: there is no {what} in PEM format in it")
