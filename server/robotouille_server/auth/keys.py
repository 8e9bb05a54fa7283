"""Signing keys: HS256 secrets by name, from a setting or from a file that can be rotated.

The first key signs, all of them verify. So a key can be replaced while tokens that it has signed
are still in use: `rotate` puts a new one first, and a running server takes it without a restart.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille_server.auth.private_files import (
    PrivateFileError,
    fingerprint,
    read_private,
    write_private,
)
from robotouille_server.runtime.logs import get_logger

__all__ = [
    "MIN_SECRET_BYTES",
    "SIGNING_KEYS_VARIABLE",
    "FileKeyring",
    "Key",
    "KeyFileError",
    "Keyring",
    "load",
    "rotate",
]

SIGNING_KEYS_VARIABLE = "ROBOTOUILLE_SIGNING_KEYS"

MIN_SECRET_BYTES = 32
"""HS256 is as strong as its key: shorter ones than its hash (RFC 7518, 3.2) are refused."""
MAX_KEYS = 16
MAX_FILE_BYTES = 64 * 1024
KEPT_KEYS = 3

_KID = re.compile(r"[A-Za-z0-9_-]{1,32}")
_HOW_TO_MAKE = "`robotouille-token rotate --keys FILE` makes a good one"


class KeyFileError(PrivateFileError):
    """Signing keys that cannot be used: names the file or setting, the fault, and the way out."""


@dataclass(frozen=True, slots=True)
class Key:
    """A secret and the name by which tokens refer to it."""

    kid: str
    secret: bytes = field(repr=False)


class Keyring:
    """One or several keys; the first signs, all verify."""

    def __init__(self, keys: Iterable[Key], source: str = "signing keys") -> None:
        self._keys = _checked(tuple(keys), source)

    @classmethod
    def parse(cls, text: str, source: str = SIGNING_KEYS_VARIABLE) -> Keyring:
        """Keys as a setting has them: `kid:base64url,kid2:base64url`, the signing one first."""
        keys = []
        for number, part in enumerate(text.split(","), 1):
            kid, colon, secret = part.strip().partition(":")
            if not colon:
                raise KeyFileError(source, f"key {number} is not written as NAME:BASE64URL")
            keys.append(Key(kid, _decoded(secret, source, f"key {number}")))
        return cls(keys, source)

    @property
    def keys(self) -> tuple[Key, ...]:
        return self._keys

    @property
    def signing(self) -> Key:
        """The key that signs new tokens."""
        return self.keys[0]

    def find(self, kid: object) -> Key | None:
        """The key of this name."""
        return next((key for key in self.keys if key.kid == kid), None)


class FileKeyring(Keyring):
    """The keys of a file, which is made at first use and read again whenever it has changed.

    A changed file that cannot be used is logged, and the keys from before stay in force.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.exists():
            _create(path)
        self._seen = fingerprint(path)
        super().__init__(load(path), str(path))

    @property
    def keys(self) -> tuple[Key, ...]:
        seen = fingerprint(self.path)
        if seen != self._seen:
            self._seen = seen
            self._reload()
        return self._keys

    def _reload(self) -> None:
        try:
            self._keys = load(self.path)
        except KeyFileError as error:
            get_logger().error("signing keys not reloaded; the old ones stay", error=str(error))
        else:
            get_logger().info("signing keys reloaded", file=str(self.path), keys=len(self._keys))


class _KeyEntry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    kid: str
    secret: str


class _KeyFile(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    keys: list[_KeyEntry]


def load(path: Path) -> tuple[Key, ...]:
    """The keys of a file; KeyFileError where it is missing, open to others, or wrong."""
    source = str(path)
    try:
        file = _KeyFile.model_validate_json(_read(path))
    except ValidationError as error:
        fault = error.errors(include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise KeyFileError(source, f"{where or 'the file'}: {fault['msg']}") from None
    keys = (
        Key(entry.kid, _decoded(entry.secret, source, f"keys.{number}.secret"))
        for number, entry in enumerate(file.keys)
    )
    return _checked(tuple(keys), source)


def rotate(path: Path, *, keep: int = KEPT_KEYS) -> Key:
    """Put a new key first and keep `keep` keys in all; the file is made if there is none.

    Tokens signed with a key that falls off are worth nothing from then on.
    """
    if not 1 <= keep <= MAX_KEYS:
        raise KeyFileError(str(path), f"keep 1 to {MAX_KEYS} keys, not {keep}")
    if not path.exists():
        return _create(path)
    path = path.resolve()
    key = _new_key()
    _write(path, (key, *load(path))[:keep], replace=True)
    return key


def _checked(keys: tuple[Key, ...], source: str) -> tuple[Key, ...]:
    if not 1 <= len(keys) <= MAX_KEYS:
        raise KeyFileError(source, f"{len(keys)} keys; there must be 1 to {MAX_KEYS}")
    for number, key in enumerate(keys, 1):
        if not _KID.fullmatch(key.kid):
            raise KeyFileError(
                source, f"key {number}: its name must be 1 to 32 letters, digits, '-' or '_'"
            )
        if len(key.secret) < MIN_SECRET_BYTES:
            size = f"{len(key.secret)} bytes; at least {MIN_SECRET_BYTES} are needed"
            raise KeyFileError(source, f"key {number}: its secret has {size}; {_HOW_TO_MAKE}")
    if len({key.kid for key in keys}) < len(keys):
        raise KeyFileError(source, "two keys have the same name")
    return keys


def _decoded(text: str, source: str, where: str) -> bytes:
    """Base64url with or without padding; what it says is in no error message."""
    try:
        padded = text.rstrip("=") + "=" * (-len(text.rstrip("=")) % 4)
        return base64.b64decode(padded.encode("ascii"), altchars=b"-_", validate=True)
    except (binascii.Error, ValueError):
        raise KeyFileError(source, f"{where} is not base64url") from None


def _new_key() -> Key:
    return Key(secrets.token_hex(4), secrets.token_bytes(MIN_SECRET_BYTES))


def _read(path: Path) -> bytes:
    source = str(path)
    try:
        return read_private(path, MAX_FILE_BYTES)
    except FileNotFoundError:
        fault = f"there is no such file; {_HOW_TO_MAKE}, and so does the server at its start"
        raise KeyFileError(source, fault) from None
    except PrivateFileError as error:
        raise KeyFileError(source, error.fault) from None


def _create(path: Path) -> Key:
    """A file with one new key; where another process is faster, its file stays."""
    key = _new_key()
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        fault = f"its folder cannot be made: {error.strerror}"
        raise KeyFileError(str(path), fault) from None
    with contextlib.suppress(FileExistsError):
        _write(path, (key,), replace=False)
        get_logger().info("signing key made", file=str(path), kid=key.kid)
    return load(path)[0]


def _write(path: Path, keys: tuple[Key, ...], *, replace: bool) -> None:
    content = _KeyFile(
        keys=[_KeyEntry(kid=key.kid, secret=_encoded(key.secret)) for key in keys]
    ).model_dump_json(indent=2)
    try:
        write_private(path, content.encode() + b"\n", replace=replace)
    except PrivateFileError as error:
        raise KeyFileError(str(path), error.fault) from None


def _encoded(secret: bytes) -> str:
    return base64.urlsafe_b64encode(secret).rstrip(b"=").decode("ascii")
