"""Resume tokens that were replaced after the end of their episode.

A closed recording does not change, so it cannot show them.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from pathlib import Path

from robotouille.errors import FileError
from robotouille.files.reading import read_bytes
from robotouille.files.writing import replace_file
from robotouille_server.auth.revocation import TIDY_SECONDS, use_name
from robotouille_server.runtime.logs import get_logger

MAX_BYTES = 32
ALL = 2**63
"""Generation above those of all tokens."""


class ReplacedTokens:
    """Last used generations of resume tokens. Each session has a file, for `seconds`."""

    def __init__(self, folder: Path, seconds: float) -> None:
        self._folder = folder
        self._seconds = seconds
        self._next_tidy = 0.0

    def last_used(self, session: str) -> int:
        """Return the last noted generation of a session, or 0. An unreadable note is `ALL`."""
        path = self._path(session)
        try:
            return int(read_bytes(path, MAX_BYTES))
        except FileNotFoundError:
            return 0
        except (OSError, FileError, ValueError) as error:
            get_logger().error("replaced tokens not read", file=str(path), error=str(error))
            return ALL

    def note(self, session: str, generation: int) -> None:
        """Note the generation of a token that a session has used."""
        self._tidy_when_due()
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            # The file is not synced: a power failure may make the replaced tokens show the end of
            # the episode again.
            replace_file(self._path(session), f"{generation}\n")
        except OSError as error:
            get_logger().error("replaced tokens not noted", error=str(error))

    def _path(self, session: str) -> Path:
        return self._folder / use_name(session)

    def _tidy_when_due(self) -> None:
        now = time.time()
        if now >= self._next_tidy:
            self._next_tidy = now + TIDY_SECONDS
            asyncio.get_running_loop().run_in_executor(None, self._tidy, now - self._seconds)

    def _tidy(self, before: float) -> None:
        """Remove the files of sessions whose tokens have expired."""
        with suppress(OSError):
            for path in self._folder.iterdir():
                if path.lstat().st_mtime < before:
                    path.unlink(missing_ok=True)
