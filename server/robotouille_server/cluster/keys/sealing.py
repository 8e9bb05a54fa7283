"""Encryption of the signing keys that nodes share, so that NATS and its disks never see them.

A value starts with a byte that names its format. The encrypted format is AES-256-GCM: the byte, a
mark of the key, a random nonce and the encrypted content. The name of the value and everything
before the nonce are authenticated.

Encryption does not protect from a NATS operator who stores an earlier value of the same cluster
again.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import re
import secrets
from pathlib import Path

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_server.auth.private_files import PrivateFileError, read_private

KEY_BYTES = 32
MAX_KEY_FILE_BYTES = 4096
HOW_TO_MAKE = "make one with `(umask 077; openssl rand -hex 32 > FILE)`"

_PLAIN, _ENCRYPTED = b"{", b"\x01"
_MARK_BYTES, _NONCE_BYTES = 8, 12
_HEX = re.compile(r"[0-9A-Fa-f]{64}")
_BASE64URL = re.compile(r"[A-Za-z0-9_-]{43}=?")
_START_OVER = (
    "To change that, stop all nodes, delete the key {name!r} from the cluster's bucket `…_shared` "
    "(`nats kv del`), and start all nodes with the same --cluster-key"
)


def read_cluster_key(path: Path) -> bytes:
    """Return the key in the file of `--cluster-key`.

    Raises:
        RobotouilleError: The file is missing, invalid, or accessible to other users.
    """
    source = f"--cluster-key: {path}"
    try:
        content = read_private(path, MAX_KEY_FILE_BYTES)
    except FileNotFoundError:
        raise PrivateFileError(source, f"the file does not exist; {HOW_TO_MAKE}") from None
    except PrivateFileError as error:
        raise PrivateFileError(source, error.fault) from None
    text = content.decode("ascii", "replace").strip()
    if _HEX.fullmatch(text):
        return bytes.fromhex(text)
    if _BASE64URL.fullmatch(text):
        # Spare bits at the end of the text are ignored.
        with_padding = text.rstrip("=") + "="
        try:
            return base64.urlsafe_b64decode(with_padding)
        except binascii.Error:
            pass
    fault = f"expected {KEY_BYTES} bytes as 64 hex digits or in base64url; {HOW_TO_MAKE}"
    raise PrivateFileError(source, fault)


class Seal:
    """Encrypts values if it has a key; otherwise it returns them unchanged.

    Raises:
        MissingExtraError: There is a key, but the package `cryptography` is missing.
    """

    def __init__(self, key: bytes | None) -> None:
        if key is not None and len(key) != KEY_BYTES:
            raise ValueError(f"a key of {len(key)} bytes; {KEY_BYTES} are required")
        self._key = key
        if key is not None:
            try:
                from cryptography.exceptions import InvalidTag
                from cryptography.hazmat.primitives.ciphers.aead import AESGCM
            except ImportError:
                raise MissingExtraError("--cluster-key", "cluster") from None
            self._cipher = AESGCM(key)
            self._invalid = InvalidTag
            # Tells a wrong key from altered content. It is useless for finding the key, which is
            # random.
            mark = hmac.digest(key, b"robotouille cluster key", hashlib.sha256)
            self._head = _ENCRYPTED + mark[:_MARK_BYTES]

    def close(self, name: str, content: bytes) -> bytes:
        """Return the value to store for a content, which is a JSON object."""
        if self._key is None:
            return content
        nonce = secrets.token_bytes(_NONCE_BYTES)
        return self._head + nonce + self._cipher.encrypt(nonce, content, self._bound(name))

    def open(self, name: str, value: bytes) -> bytes:
        """Return the content of a stored value.

        Raises:
            RobotouilleError: The value was stored with another key, without a key, or altered; or
                it is encrypted and this node lacks a key.
        """
        if value.startswith(_ENCRYPTED):
            return self._decrypted(name, value)
        if not value.startswith(_PLAIN):
            raise RobotouilleError(
                f"the cluster's value {name!r} has an unknown format; the other nodes may have a "
                "newer release"
            )
        if self._key is not None:
            raise RobotouilleError(
                "--cluster-key: the signing keys of this cluster are not encrypted. "
                + _START_OVER.format(name=name)
            )
        return value

    def _decrypted(self, name: str, value: bytes) -> bytes:
        if self._key is None:
            raise RobotouilleError(
                "the signing keys of this cluster are encrypted; start this node with "
                "--cluster-key and the other nodes' file"
            )
        if not value.startswith(self._head):
            raise RobotouilleError(
                "--cluster-key: the key does not fit: another cluster uses this name (choose "
                "another --cluster-name), or the file differs from the other nodes' (copy theirs)"
            )
        start = len(self._head) + _NONCE_BYTES
        nonce, encrypted = value[len(self._head) : start], value[start:]
        try:
            return self._cipher.decrypt(nonce, encrypted, self._bound(name))
        # A short value has a short nonce, which is a ValueError.
        except (self._invalid, ValueError):
            raise RobotouilleError(
                "the signing keys of this cluster were altered in NATS; find out who can write "
                "there. " + _START_OVER.format(name=name)
            ) from None

    def _bound(self, name: str) -> bytes:
        return self._head + name.encode()
