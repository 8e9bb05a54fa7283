"""TLS with a certificate that can be renewed while the server runs."""

from __future__ import annotations

import asyncio
import ipaddress
import re
import ssl
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille.files.reading import open_regular
from robotouille_server.runtime.logs import get_logger

SUBJECT_ALT_NAME = bytes.fromhex("0603551d11")
"""The object identifier 2.5.29.17 (RFC 5280, 4.2.1.6) in DER."""
BOOLEAN, OCTET_STRING, SEQUENCE = 0x01, 0x04, 0x30
DNS_NAME, IP_ADDRESS = 0x82, 0x87

# Only the first certificate of the chain is the server's own.
_PEM = re.compile(rb"-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----", re.DOTALL)


def certificate_names(chain: bytes) -> tuple[list[str], list[str]]:
    """Return the DNS names and the addresses in the first certificate of a PEM chain.

    Both are empty if the certificate is unreadable.
    """
    dns: list[str] = []
    addresses: list[str] = []
    found = _PEM.search(chain)
    if found is None:
        return dns, addresses
    try:
        names = list(_alternative_names(ssl.PEM_cert_to_DER_cert(found[0].decode("ascii"))))
        dns += [content.decode("ascii") for tag, content in names if tag == DNS_NAME]
        addresses += [str(ipaddress.ip_address(own)) for tag, own in names if tag == IP_ADDRESS]
    except (ValueError, IndexError):
        return [], []
    return dns, addresses


def _alternative_names(certificate: bytes) -> Iterator[tuple[int, bytes]]:
    # The standard library decodes only certificates of connected peers, and one field does not
    # justify a dependency. The name is only shown to people, so a wrong result is harmless.
    _, mark, rest = certificate.partition(SUBJECT_ALT_NAME)
    if not mark:
        return
    tag, content, rest = _element(rest)
    if tag == BOOLEAN:  # The flag that the extension is critical.
        tag, content, rest = _element(rest)
    if tag != OCTET_STRING or content[0] != SEQUENCE:
        raise ValueError("not a list of names")
    _, names, _ = _element(content)
    while names:
        tag, content, names = _element(names)
        yield tag, content


def _element(data: bytes) -> tuple[int, bytes, bytes]:
    """Return the tag and content of the first DER element, and the data that follows it."""
    tag, size, start = data[0], data[1], 2
    if size & 0x80:
        start += size & 0x7F
        size = int.from_bytes(data[2:start], "big")
    if len(data) < start + size:
        raise ValueError("the certificate is cut off")
    return tag, data[start : start + size], data[start + size :]


POLL_SECONDS = 10.0
MAX_PEM_BYTES = 1024 * 1024


class TLSFileError(RobotouilleError):
    """The certificate or key cannot be used. The message names the file and the remedy."""


class ServerTLS:
    """TLS 1.2 or newer with a certificate chain and key from two PEM files.

    A changed certificate is used only if it is complete and matches its key. Open connections are
    not affected.

    Attributes:
        context: The context for new connections. While `watch` runs, it has the latest valid
            certificate.
        name: The name for clients: the first name in the certificate that is not a wildcard, or
            else the first address; empty if there is neither.
    """

    def __init__(self, cert: Path, key: Path) -> None:
        self.cert = cert
        self.key = key
        self._seen = self._fingerprint()
        self.context = _load(cert, key)
        self.name = _name(cert)
        self._warn_if_open()

    @classmethod
    def from_settings(cls, cert: Path | None, key: Path | None) -> ServerTLS:
        """Load the files of the settings; raise TLSFileError if only one is given."""
        if cert is None or key is None:
            given, missing = (
                ("--tls-cert", "--tls-key") if key is None else ("--tls-key", "--tls-cert")
            )
            raise TLSFileError(f"{given} is given without {missing}; TLS needs both")
        return cls(cert, key)

    def reload(self) -> bool:
        """Load a changed certificate; return whether a new one is used now."""
        seen = self._fingerprint()
        if seen == self._seen:
            return False
        # This also applies to a broken file, which is reported once and tried again when it
        # changes.
        self._seen = seen
        try:
            # Loading a chain into the same context would, for a moment or after an error, combine
            # the new certificate with the old key. Contexts are replaced as a whole instead.
            self.context = _load(self.cert, self.key)
        except TLSFileError as error:
            get_logger().error(
                "certificate not reloaded; the previous one stays in use", error=str(error)
            )
            return False
        self.name = _name(self.cert)
        get_logger().info("certificate reloaded", file=str(self.cert))
        self._warn_if_open()
        return True

    async def watch(self, seconds: float = POLL_SECONDS) -> None:
        """Reload changed files regularly, until cancelled."""
        while True:
            await asyncio.sleep(seconds)
            # A slow file system must not stop the games.
            await asyncio.to_thread(self.reload)

    def _fingerprint(self) -> tuple[tuple[int, int, int] | None, ...]:
        return tuple(_stamp(path) for path in (self.cert, self.key))

    def _warn_if_open(self) -> None:
        if sys.platform == "win32":
            return
        try:
            mode = stat.S_IMODE(self.key.stat().st_mode)
        except OSError:  # Gone since it was loaded.
            return
        if mode & 0o007:
            get_logger().warning(
                "other users can read the TLS key",
                file=str(self.key),
                advice=f"chmod 600 {self.key}",
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
    # Older versions have known weaknesses, and no supported client needs them.
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    # Other groups include ffdhe8192, with which a stranger's first packet costs the server 0.2 s.
    # Every client of TLS 1.3 supports this curve (RFC 8446, section 9.1).
    context.set_ecdh_curve("prime256v1")
    try:
        context.load_cert_chain(cert, key, password=_refuse_passphrase)
    except ssl.SSLError as error:
        # This is the usual mistake, and also the state of the files in the middle of a renewal.
        if error.reason == "KEY_VALUES_MISMATCH":
            fault = f"the key {key} does not belong to the certificate {cert}"
            raise TLSFileError(f"{fault}; renew both") from None
        fault = (error.reason or str(error)).replace("_", " ").lower()
        raise TLSFileError(f"{cert} and {key} cannot be used: {fault}") from None
    except _NeedsPassphraseError:
        raise TLSFileError(
            f"{key}: the key has a passphrase, which the server cannot ask for; "
            f"remove it: openssl pkey -in KEY -out NEW"
        ) from None
    except OSError as error:
        raise TLSFileError(f"{cert} and {key} cannot be read: {error.strerror}") from None
    return context


def _name(cert: Path) -> str:
    try:
        dns, addresses = certificate_names(_read(cert))
    except OSError:  # Gone since it was loaded.
        return ""
    return next((name for name in [*dns, *addresses] if "*" not in name), "")


class _NeedsPassphraseError(Exception):
    """The key is encrypted."""


def _refuse_passphrase() -> str:
    """Raise an error instead of asking on the terminal, which would block the server."""
    raise _NeedsPassphraseError


def _read(path: Path) -> bytes:
    """Return the content of a file, or slightly more than its limit; raise OSError."""
    with open_regular(path) as file:
        return file.read(MAX_PEM_BYTES + 1)


def _check_pem(path: Path, mark: bytes, what: str, flag: str) -> None:
    try:
        content = _read(path)
    except OSError as error:
        raise TLSFileError(f"{flag} {path}: {error.strerror}") from None
    if len(content) > MAX_PEM_BYTES:
        fault = f"larger than {MAX_PEM_BYTES} bytes; it may be the wrong file"
        raise TLSFileError(f"{flag} {path}: {fault}")
    # OpenSSL's own message for a wrong file names neither the file nor the fault.
    if mark not in content:
        raise TLSFileError(f"{flag} {path}: the file has no {what} in PEM format")
