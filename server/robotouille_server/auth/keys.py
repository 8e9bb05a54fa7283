"""Signing keys: HS256 secrets by name, from a setting or from a file that can be rotated.

The first key signs; all keys verify. A key can therefore be replaced while tokens signed with it
are in use: `rotate` adds a new first key, which running servers use without a restart.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import re
import secrets
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille_server.auth.private_files import (
    PrivateFileError,
    fingerprint,
    locked,
    read_private,
    write_private,
)
from robotouille_server.runtime.logs import get_logger

SIGNING_KEYS_VARIABLE = "ROBOTOUILLE_SIGNING_KEYS"

MIN_SECRET_BYTES = 32
"""Minimum length of a key: HS256 needs keys as long as its hash (RFC 7518, section 3.2)."""
MAX_KEYS = 16
MAX_FILE_BYTES = 64 * 1024
KEPT_KEYS = 3

_KID = re.compile(r"[A-Za-z0-9_-]{1,32}")
_HOW_TO_MAKE = "`robotouille-token rotate --keys FILE` creates a valid key"


class KeyFileError(PrivateFileError):
    """The signing keys cannot be used. The message names the file or setting and the remedy."""


@dataclass(frozen=True, slots=True)
class Key:
    """Secret with the name that tokens refer to it by."""

    kid: str
    secret: bytes = field(repr=False)


class Keyring:
    """One or several keys. The first one signs; all verify."""

    def __init__(self, keys: Iterable[Key], source: str = "signing keys") -> None:
        self._keys = _checked(tuple(keys), source)

    @classmethod
    def parse(cls, text: str, source: str = SIGNING_KEYS_VARIABLE) -> Keyring:
        """Parse the keys of a setting: `NAME:BASE64URL,…`, the signing key first."""
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
        """Key that signs new tokens."""
        return self.keys[0]

    def find(self, kid: object) -> Key | None:
        """Return the key with a name."""
        return next((key for key in self.keys if key.kid == kid), None)


class FileKeyring(Keyring):
    """Keys of a file, which is created if it is missing and read again whenever it changes.

    If a changed file is invalid, the error is logged and the previous keys stay valid: a typing
    error must not disconnect everybody.
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
            get_logger().error(
                "signing keys not reloaded; the previous keys stay valid", error=str(error)
            )
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
    """Read the keys of a file.

    Raises:
        KeyFileError: The file is missing, invalid, or accessible to other users.
    """
    return parse_keys(_read(path), str(path))


def parse_keys(content: bytes, source: str) -> tuple[Key, ...]:
    """Return the keys in the content of a key file.

    Raises:
        KeyFileError: The content is invalid.
    """
    try:
        file = _KeyFile.model_validate_json(content)
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
    """Add a new first key and keep `keep` keys in all. Create the file if it is missing.

    Tokens signed with a dropped key become invalid.
    """
    if not 1 <= keep <= MAX_KEYS:
        raise KeyFileError(
            str(path), f"the number of keys to keep must be 1 to {MAX_KEYS}, not {keep}"
        )
    if not path.exists():
        return _create(path)
    # Replacing a link itself would leave the servers that read its target with the old keys.
    path = path.resolve()
    key = _new_key()
    with _locked(path):
        # Replaced atomically: running servers may read the file at any moment.
        _write(path, (key, *load(path))[:keep], replace=True)
    return key


def replace_keys(path: Path, keys: tuple[Key, ...], old: tuple[Key, ...]) -> bool:
    """Replace the keys of a file, unless another process has changed them.

    A missing or invalid file is replaced, too.

    Args:
        path: The file.
        keys: Its new keys.
        old: The keys that it should have.

    Returns:
        False if the file has other keys than `old`.
    """
    path = path.resolve()
    with _locked(path):
        try:
            found = load(path)
        except KeyFileError:
            found = ()
        if found and found not in (keys, old):
            return False
        if found != keys:
            _write(path, keys, replace=True)
    return True


def _checked(keys: tuple[Key, ...], source: str) -> tuple[Key, ...]:
    if not 1 <= len(keys) <= MAX_KEYS:
        raise KeyFileError(source, f"{len(keys)} keys; 1 to {MAX_KEYS} are allowed")
    for number, key in enumerate(keys, 1):
        if not _KID.fullmatch(key.kid):
            raise KeyFileError(
                source, f"key {number}: the name must have 1 to 32 letters, digits, '-' or '_'"
            )
        if len(key.secret) < MIN_SECRET_BYTES:
            size = f"{len(key.secret)} bytes; at least {MIN_SECRET_BYTES} are required"
            raise KeyFileError(source, f"key {number}: the secret has {size}; {_HOW_TO_MAKE}")
    if len({key.kid for key in keys}) < len(keys):
        raise KeyFileError(source, "two keys have the same name")
    return keys


def _decoded(text: str, source: str, where: str) -> bytes:
    """Decode base64url, with or without padding. Errors must not contain the secret."""
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
        fault = f"the file does not exist; {_HOW_TO_MAKE}, and so does starting the server"
        raise KeyFileError(source, fault) from None
    except PrivateFileError as error:
        raise KeyFileError(source, error.fault) from None


def _create(path: Path) -> Key:
    """Create a file with one new key, unless another process creates it at the same time."""
    key = _new_key()
    make_key_folder(path)
    # Several workers may start at the same time; all must use the key of the first one.
    with contextlib.suppress(FileExistsError):
        _write(path, (key,), replace=False)
        get_logger().info("signing key created", file=str(path), kid=key.kid)
    return load(path)[0]


def make_key_folder(path: Path) -> None:
    """Create the folder of a key file, accessible to its owner only, if it is missing."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        fault = f"its folder cannot be created: {error.strerror}"
        raise KeyFileError(str(path), fault) from None


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Let one process at a time read and replace a file."""
    try:
        with locked(path.parent):
            yield
    except KeyFileError:
        raise
    except PrivateFileError as error:
        raise KeyFileError(str(path), error.fault) from None


def _write(path: Path, keys: tuple[Key, ...], *, replace: bool) -> None:
    try:
        write_private(path, encode_keys(keys), replace=replace)
    except PrivateFileError as error:
        raise KeyFileError(str(path), error.fault) from None


def encode_keys(keys: Iterable[Key]) -> bytes:
    """Return the content of a key file."""
    entries = [_KeyEntry(kid=key.kid, secret=_encoded(key.secret)) for key in keys]
    return _KeyFile(keys=entries).model_dump_json(indent=2).encode() + b"\n"


def _encoded(secret: bytes) -> str:
    return base64.urlsafe_b64encode(secret).rstrip(b"=").decode("ascii")
