"""Revoked and used role tokens.

`robotouille-token revoke` writes the ids of revoked tokens to a file next to the keys. Running
servers read the file again whenever it changes.
"""

from __future__ import annotations

import asyncio
import hashlib
import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille.errors import ProtocolError
from robotouille_server.auth.private_files import (
    PrivateFileError,
    fingerprint,
    locked,
    read_private,
    write_private,
)
from robotouille_server.runtime.budgets import TokenBucket
from robotouille_server.runtime.logs import get_logger

REVOKED_FILE = "revoked.json"
MAX_ENTRIES = 10_000
MAX_FILE_BYTES = 2 * 1024 * 1024
KEPT_SECONDS = 31 * 86400.0
"""Minimum time for which an entry is kept. Resume tokens that derive from a role token may be valid
for longer than the role token."""


class RevokedFileError(PrivateFileError):
    """The list of revoked tokens cannot be used. The message names the file and the fault."""


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    id: Annotated[str, Field(min_length=1, max_length=64)]
    until: Annotated[float, Field(allow_inf_nan=False)]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    revoked: list[_Entry]


class Revocations:
    """Ids of revoked tokens, read from a file. A missing file counts as an empty one.

    If a changed file is invalid or the file disappears, the error is logged and revoked tokens
    stay revoked.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._seen = fingerprint(path)
        self._ids = frozenset(load_revoked(path))

    @property
    def ids(self) -> frozenset[str]:
        """Revoked ids. The set is a new object whenever the file has changed."""
        seen = fingerprint(self.path)
        # Each check costs one `stat`. The file changes rarely, so a watcher is not worth it.
        if seen != self._seen:
            self._seen = seen
            self._reload()
        return self._ids

    def __contains__(self, token_id: object) -> bool:
        return token_id in self.ids

    def _reload(self) -> None:
        try:
            # Deleting the file must not make revoked tokens valid again.
            if self._seen is None:
                raise RevokedFileError(str(self.path), "the file was removed")
            self._ids = frozenset(load_revoked(self.path))
        except RevokedFileError as error:
            get_logger().error(
                "revoked tokens not reloaded; revoked ones stay revoked", error=str(error)
            )
        else:
            get_logger().info("revoked tokens reloaded", count=len(self._ids))


def load_revoked(path: Path) -> dict[str, float]:
    """Return the revoked ids, and the time until which each is kept.

    Raises:
        RevokedFileError: The file is invalid or accessible to other users.
    """
    try:
        return parse_revoked(read_private(path, MAX_FILE_BYTES), str(path))
    except FileNotFoundError:
        return {}
    except PrivateFileError as error:
        raise RevokedFileError(str(path), error.fault) from None


def parse_revoked(content: bytes, source: str) -> dict[str, float]:
    """Return the revoked ids in the content of a file, and the time until which each is kept.

    Raises:
        RevokedFileError: The content is invalid.
    """
    try:
        entries = _File.model_validate_json(content).revoked
    except ValidationError as error:
        fault = error.errors(include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise RevokedFileError(source, f"{where or 'the file'}: {fault['msg']}") from None
    return {entry.id: entry.until for entry in entries}


def revoke(path: Path, token_ids: Iterable[str], expires: float, now: float) -> None:
    """Add the ids of tokens that end at `expires`, and remove outdated entries.

    Raises:
        RevokedFileError: The file cannot be read or written, or has too many entries.
    """
    until = max(expires, now) + KEPT_SECONDS
    add_revoked(path, dict.fromkeys(token_ids, until), now)


def add_revoked(path: Path, entries: Mapping[str, float], now: float) -> None:
    """Add ids and the times until which they are kept, and remove outdated entries.

    Raises:
        RevokedFileError: The file cannot be read or written, or has too many entries.
    """
    try:
        with locked(path.parent):
            found = load_revoked(path)
            kept = merge_revoked(found, entries, now)
            check_revoked_count(kept, str(path))
            if kept != found:
                write_private(path, encode_revoked(kept), replace=True)
    except PrivateFileError as error:
        raise RevokedFileError(error.source, error.fault) from None


def merge_revoked(
    one: Mapping[str, float], other: Mapping[str, float], now: float
) -> dict[str, float]:
    """Return the entries of both that are not outdated, with the later of two times."""
    merged = dict(one)
    for token_id, until in other.items():
        merged[token_id] = max(until, merged.get(token_id, -math.inf))
    return {token_id: until for token_id, until in merged.items() if until > now}


def check_revoked_count(entries: Mapping[str, float], source: str) -> None:
    """Raise RevokedFileError if there are too many entries."""
    if len(entries) > MAX_ENTRIES:
        fault = f"more than {MAX_ENTRIES} revoked tokens; rotate the keys instead"
        raise RevokedFileError(source, fault)


def encode_revoked(entries: Mapping[str, float], *, indent: int | None = 1) -> bytes:
    """Return the content of a file."""
    listed = [_Entry(id=token_id, until=until) for token_id, until in entries.items()]
    return _File(revoked=listed).model_dump_json(indent=indent).encode() + b"\n"


MAX_USED_FILE_BYTES = 4096
TIDY_SECONDS = 3600.0
"""Seconds between two searches for files of expired tokens."""
USED_KEPT_SECONDS = 86400.0
"""Seconds for which a token is remembered after its end: its session may still be connected."""


class TokenUse(BaseModel):
    """Use of a token for one session.

    Attributes:
        session: The session that has used it.
        expires: The time when the token expires.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    session: str
    expires: float

    @classmethod
    def parse(cls, content: bytes, source: str) -> TokenUse:
        """Return the use in a file. An invalid file counts as a use by another session."""
        try:
            return cls.model_validate_json(content)
        except ValidationError as error:
            return cls.unreadable(source, error)

    @classmethod
    def unreadable(cls, source: str, error: Exception) -> TokenUse:
        """Log the error, and return the use by an unknown session, which never expires."""
        get_logger().error("use of a token not read", file=source, error=str(error))
        return cls(session="?", expires=math.inf)

    def check(self, session: str) -> None:
        """Raise ProtocolError `auth/used` if another session has used the token."""
        if self.session != session:
            text = "this token is valid for one session, and another session has used it"
            raise ProtocolError("auth/used", text, "token")

    def outdated(self, now: float) -> bool:
        """Return whether the use can be forgotten."""
        return self.expires + USED_KEPT_SECONDS < now


def use_name(token_id: str) -> str:
    """Return the name under which the use of a token is stored: a digest, as ids are any text."""
    return hashlib.sha256(token_id.encode()).hexdigest()[:32]


def not_recorded(error: Exception) -> ProtocolError:
    """Log that the use of a token was not recorded, and return the error for the client."""
    get_logger().error("use of a token not recorded", error=str(error))
    text = "the use of your token cannot be recorded; try again later"
    return ProtocolError("server/recording", text, "token")


FAILED_JOINS_A_MINUTE = 20
"""Failed joins with one token, for which a file is written and removed again."""
MAX_FAILED_TOKENS = 1000


class FailedJoins:
    """Rate limit of failed joins, for each token. Those that failed last are remembered."""

    def __init__(self) -> None:
        self._budgets: OrderedDict[str, TokenBucket] = OrderedDict()

    def check(self, token_id: str, now: float) -> None:
        """Raise ProtocolError `rate/limited` if too many joins have failed."""
        budget = self._budgets.get(token_id)
        if budget is not None and budget.left(now) < 1:
            text = "too many joins with this token have failed; try again in a few seconds"
            raise ProtocolError("rate/limited", text, "token")

    def failed(self, token_id: str, now: float) -> None:
        """Count a failed join."""
        most = FAILED_JOINS_A_MINUTE
        budget = self._budgets.pop(token_id, None) or TokenBucket(most / 60, now, most)
        budget.take(now)
        self._budgets[token_id] = budget
        if len(self._budgets) > MAX_FAILED_TOKENS:
            self._budgets.popitem(last=False)


class UsedTokens:
    """Tokens for one session that have been used. Their sessions created one file each, atomically.

    `wall` returns the time in seconds since 1970.
    """

    def __init__(self, folder: Path, wall: Callable[[], float]) -> None:
        self._folder = folder
        self._wall = wall
        self._next_tidy = wall()
        self._failed = FailedJoins()

    def check(self, token_id: str, session: str = "") -> None:
        """Raise ProtocolError `auth/used` if another session has used a token."""
        used = self._read(self._path(token_id))
        if used is not None:
            used.check(session)

    @contextmanager
    def used_by(self, session: str, token_id: str, expires: float) -> Iterator[None]:
        """Return a context for a `join`, which uses up the token unless the join fails.

        Raises:
            ProtocolError: `auth/used` if another session has used the token, `server/recording` if
                its use cannot be written, `rate/limited` if too many joins with it have failed.
        """
        now = asyncio.get_running_loop().time()
        self._failed.check(token_id, now)
        # Joins trigger the tidying, so an idle server does no work.
        self.forget_expired()
        path = self._path(token_id)
        new = self._claim(path, token_id, TokenUse(session=session, expires=expires))
        try:
            yield
        except BaseException:
            if new:
                # The join failed, so the token is still unused.
                self._failed.failed(token_id, now)
                path.unlink(missing_ok=True)
            raise

    def _claim(self, path: Path, token_id: str, use: TokenUse) -> bool:
        """Return whether this is the first use; raise if another session was first."""
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            # All episodes wait for this write, because the join must know who was first. The file
            # is synced, because an incomplete one would lock its owner out. Its name is not: after
            # a power failure the token may count as unused, which harms nobody.
            content = use.model_dump_json().encode()
            write_private(path, content, replace=False, durable_name=False)
        except FileExistsError:
            self.check(token_id, use.session)
            return False
        except (OSError, PrivateFileError) as error:
            raise not_recorded(error) from None
        return True

    def forget_expired(self) -> None:
        """Remove the files of expired tokens, in a thread and not too often."""
        now = self._wall()
        if now < self._next_tidy:
            return
        self._next_tidy = now + TIDY_SECONDS
        asyncio.get_running_loop().run_in_executor(None, self._tidy, now)

    def _tidy(self, now: float) -> None:
        with suppress(OSError):
            for path in self._folder.glob("*.json"):
                use = self._read(path)
                if use is not None and use.outdated(now):
                    path.unlink(missing_ok=True)

    def _read(self, path: Path) -> TokenUse | None:
        """Return the use of a token; None if it is unused. Unreadable files count as used."""
        try:
            return TokenUse.parse(read_private(path, MAX_USED_FILE_BYTES), str(path))
        except FileNotFoundError:
            return None
        except PrivateFileError as error:
            return TokenUse.unreadable(str(path), error)

    def _path(self, token_id: str) -> Path:
        return self._folder / f"{use_name(token_id)}.json"
