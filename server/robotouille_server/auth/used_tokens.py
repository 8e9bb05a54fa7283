"""Role tokens that are good for one session: who has used which, in a folder of the server's
state, so that other workers and the next process know, too."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from robotouille.errors import ProtocolError
from robotouille_server.auth.private_files import PrivateFileError, read_private, write_private
from robotouille_server.runtime.logs import get_logger

__all__ = ["UsedTokens"]

MAX_FILE_BYTES = 4096
LOOK_SECONDS = 3600.0
"""Between two looks for files of tokens that have expired."""
KEPT_SECONDS = 86400.0
"""So long after its end a token is remembered: somebody may still be connected with it."""


class _Use(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    session: str
    expires: float


class UsedTokens:
    """A file for each token that was used, made in one step: only one session can make it.

    `wall` gives the time in seconds since 1970.
    """

    def __init__(self, folder: Path, wall: Callable[[], float]) -> None:
        self._folder = folder
        self._wall = wall
        self._next_look = wall()

    def check(self, token_id: str, session: str = "") -> None:
        """ProtocolError `auth/used` if a session has used a token, other than this one."""
        used = self._read(self._path(token_id))
        if used is not None and used.session != session:
            text = "this token is good for one session, and another has used it"
            raise ProtocolError("auth/used", text, "token")

    @contextmanager
    def used_by(self, session: str, token_id: str, expires: float) -> Iterator[None]:
        """Around a `join`: a token, good until `expires`, is used up by a session, unless the join
        fails.

        ProtocolError `auth/used` if another session was first, `server/recording` if what is used
        cannot be written.
        """
        self.forget_expired()
        path = self._path(token_id)
        new = self._claim(path, token_id, _Use(session=session, expires=expires))
        try:
            yield
        except BaseException:
            if new:
                path.unlink(missing_ok=True)
            raise

    def _claim(self, path: Path, token_id: str, use: _Use) -> bool:
        """Whether the session is the first; that it has been here before is no fault."""
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            # All games wait for this, since the join must know who was first: the file is synced,
            # for one that is not whole would shut its owner out; its name is not. What a power
            # cut in the next seconds can take is that the token was used, never a session.
            content = use.model_dump_json().encode()
            write_private(path, content, replace=False, durable_name=False)
        except FileExistsError:
            self.check(token_id, use.session)
            return False
        except (OSError, PrivateFileError) as error:
            get_logger().error("use of a token not recorded", error=str(error))
            text = "the use of your token cannot be recorded now; try again later"
            raise ProtocolError("server/recording", text, "token") from None
        return True

    def forget_expired(self) -> None:
        """Remove the files of tokens that have expired, if that was not done lately; in a thread,
        as there may be many."""
        now = self._wall()
        if now < self._next_look:
            return
        self._next_look = now + LOOK_SECONDS
        asyncio.get_running_loop().run_in_executor(None, self._tidy, now)

    def _tidy(self, now: float) -> None:
        with suppress(OSError):
            for path in self._folder.glob("*.json"):
                use = self._read(path)
                if use is not None and use.expires + KEPT_SECONDS < now:
                    path.unlink(missing_ok=True)

    def _read(self, path: Path) -> _Use | None:
        """Who has used a token; None if nobody. What cannot be read was used by nobody known."""
        try:
            return _Use.model_validate_json(read_private(path, MAX_FILE_BYTES))
        except FileNotFoundError:
            return None
        except (PrivateFileError, ValidationError) as error:
            get_logger().error("use of a token not read", file=str(path), error=str(error))
            return _Use(session="?", expires=float("inf"))

    def _path(self, token_id: str) -> Path:
        """A token's id may be any text: its file is named by a digest."""
        return self._folder / f"{hashlib.sha256(token_id.encode()).hexdigest()[:32]}.json"
