"""Role tokens that were taken back before their time: their ids, in a file beside the keys.

`robotouille-token revoke` writes it, running servers read it again whenever it has changed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robotouille_server.auth.private_files import (
    PrivateFileError,
    fingerprint,
    locked,
    read_private,
    write_private,
)
from robotouille_server.runtime.logs import get_logger

__all__ = ["REVOKED_FILE", "Revocations", "RevokedFileError", "load_revoked", "revoke"]

REVOKED_FILE = "revoked.json"
MAX_ENTRIES = 10_000
MAX_FILE_BYTES = 2 * 1024 * 1024
KEPT_SECONDS = 31 * 86400.0
"""An entry is kept at least so long: connections that came in with the token may hold resume
tokens which are good for longer than the token itself."""


class RevokedFileError(PrivateFileError):
    """A list of revoked tokens that cannot be used: names the file and the fault."""


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    id: Annotated[str, Field(min_length=1, max_length=64)]
    until: Annotated[float, Field(allow_inf_nan=False)]


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    revoked: list[_Entry]


class Revocations:
    """The ids of a file's tokens, `in` which one looks; no file means none.

    A changed file that cannot be used, or one that has gone, is logged, and what was revoked
    stays revoked.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._seen = fingerprint(path)
        self._ids = frozenset(load_revoked(path))

    @property
    def ids(self) -> frozenset[str]:
        """Those that are revoked now; another set than before where the file has changed."""
        seen = fingerprint(self.path)
        if seen != self._seen:
            self._seen = seen
            self._reload()
        return self._ids

    def __contains__(self, token_id: object) -> bool:
        return token_id in self.ids

    def _reload(self) -> None:
        try:
            if self._seen is None:
                raise RevokedFileError(str(self.path), "the file has gone")
            self._ids = frozenset(load_revoked(self.path))
        except RevokedFileError as error:
            get_logger().error("revoked tokens not reloaded; the old ones stay", error=str(error))
        else:
            get_logger().info("revoked tokens reloaded", count=len(self._ids))


def load_revoked(path: Path) -> dict[str, float]:
    """The revoked ids, and until when each is kept; none where there is no file.
    RevokedFileError where it is open to others, or wrong."""
    try:
        entries = _File.model_validate_json(read_private(path, MAX_FILE_BYTES)).revoked
    except FileNotFoundError:
        return {}
    except PrivateFileError as error:
        raise RevokedFileError(str(path), error.fault) from None
    except ValidationError as error:
        fault = error.errors(include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise RevokedFileError(str(path), f"{where or 'the file'}: {fault['msg']}") from None
    return {entry.id: entry.until for entry in entries}


def revoke(path: Path, token_ids: Iterable[str], expires: float, now: float) -> None:
    """Add ids of tokens that end at `expires`; those that have had their time are left out.

    RevokedFileError where the file cannot be read or written, or has too many entries.
    """
    try:
        with locked(path.parent):
            kept = {name: until for name, until in load_revoked(path).items() if until > now}
            for token_id in token_ids:
                until = max(expires, now) + KEPT_SECONDS
                kept[token_id] = max(until, kept.get(token_id, -math.inf))
            if len(kept) > MAX_ENTRIES:
                fault = f"more than {MAX_ENTRIES} revoked tokens; rotate the keys instead"
                raise RevokedFileError(str(path), fault)
            entries = [_Entry(id=name, until=until) for name, until in kept.items()]
            content = _File(revoked=entries).model_dump_json(indent=1).encode()
            write_private(path, content + b"\n", replace=True)
    except PrivateFileError as error:
        raise RevokedFileError(error.source, error.fault) from None
