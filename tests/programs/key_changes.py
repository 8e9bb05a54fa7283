"""TLS records that change the keys of their sender and request the same of the other side."""

from __future__ import annotations

import hmac
import ssl
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cryptography.hazmat.primitives.ciphers.aead import AESGCM

__all__ = ["KeyChanges", "logged_keys"]

CIPHER, HASH, KEY_BYTES, IV_BYTES = "TLS_AES_256_GCM_SHA384", "sha384", 32, 12
KEY_UPDATE = bytes.fromhex("180000010116")
"""The message (RFC 8446, section 4.6.3), with its type."""


@contextmanager
def logged_keys(context: ssl.SSLContext) -> Iterator[Path]:
    """Use TLS 1.3 and log the secrets of connections to a file while the context is open."""
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    with tempfile.NamedTemporaryFile() as log:
        context.keylog_filename = log.name
        yield Path(log.name)


class KeyChanges:
    """Endless changes of keys of one side of a connection.

    Args:
        log: The file with the secrets; the last one counts.
        side: `CLIENT` or `SERVER`.
        sent: Number of records that this side has sent since the handshake.
    """

    def __init__(self, log: Path, side: str, sent: int = 0) -> None:
        rows = (line.split() for line in log.read_text().splitlines())
        secrets = [row[2] for row in rows if row[0] == f"{side}_TRAFFIC_SECRET_0"]
        self._secret, self._sent = bytes.fromhex(secrets[-1]), sent

    def records(self, count: int) -> bytes:
        """Return the next records."""
        return b"".join(self._record() for _ in range(count))

    def _record(self) -> bytes:
        key, iv = self._expand(b"key", KEY_BYTES), self._expand(b"iv", IV_BYTES)
        nonce = (int.from_bytes(iv, "big") ^ self._sent).to_bytes(IV_BYTES, "big")
        # With new keys, the count of records starts again.
        self._secret, self._sent = self._expand(b"traffic upd", len(self._secret)), 0
        head = b"\x17\x03\x03" + (len(KEY_UPDATE) + 16).to_bytes(2, "big")
        return head + AESGCM(key).encrypt(nonce, KEY_UPDATE, head)

    def _expand(self, label: bytes, size: int) -> bytes:
        # HKDF-Expand-Label of RFC 8446, section 7.1. All results fit into one block.
        label = b"tls13 " + label
        info = size.to_bytes(2, "big") + bytes((len(label),)) + label + b"\0\1"
        return hmac.digest(self._secret, info, HASH)[:size]
