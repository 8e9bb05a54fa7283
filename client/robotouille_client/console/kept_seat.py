"""Files that let a window or bot return to its seat after its process was killed."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from robotouille.files.private import user_state
from robotouille.protocol.join_codes import plain_code
from robotouille_client.client import Client
from robotouille_client.game import Game

try:
    import fcntl
except ImportError:  # Windows has no fcntl, so seats are not kept there.
    fcntl = None  # type: ignore[assignment]

KEEP_SECONDS = 0.2
"""Interval between checks for a new resume token."""


class KeptSeat:
    """A file with one participant's resume token and seats, readable by its owner only.

    The process holds a lock on the file, so a second process with the same name does not take
    over the seat of the first.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor
        self._written = os.pread(descriptor, 4096, 0).decode(errors="replace").strip()

    @property
    def token(self) -> str | None:
        """The resume token, if one was written."""
        return self._written.partition("\n")[0] or None

    @property
    def seats(self) -> tuple[str, ...]:
        """The seats that the token restores; empty if an earlier version wrote the file."""
        return tuple(self._written.splitlines()[1:])

    def token_for(self, asked: Literal["all"] | Sequence[str]) -> str | None:
        """Return the token if it restores the requested seats, or if any seats will do."""
        anything = not asked or asked == "all"
        return self.token if anything or set(asked) == set(self.seats) else None

    def keep(self, token: str | None, seats: Sequence[str]) -> None:
        """Write the newest token. A failure to write is ignored, since the game goes on."""
        if token is None:
            return
        written = "\n".join((token, *seats))
        if written == self._written:
            return
        with contextlib.suppress(OSError):
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, written.encode(), 0)
            self._written = written

    def forget(self) -> None:
        """Delete the file, once there is no seat to return to."""
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)


@contextmanager
def kept_seat(folder: Path, url: str, code: str, name: str) -> Iterator[KeptSeat | None]:
    """Open the kept seat of a name in an episode.

    Yields None if another process holds it, or if the folder cannot be written.
    """
    key = "\n".join((url, plain_code(code), name))
    path = folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.seat"
    descriptor = _locked(path)
    try:
        yield KeptSeat(path, descriptor) if descriptor is not None else None
    finally:
        if descriptor is not None:
            with contextlib.suppress(OSError):
                if not os.fstat(descriptor).st_size:
                    path.unlink()
            os.close(descriptor)


@contextmanager
def kept_seat_of(
    folder: Path, url: str, code: str, names: Sequence[str]
) -> Iterator[tuple[str, KeptSeat | None]]:
    """Open the kept seat of the first name that no other process here uses.

    If every name is in use, yields the first one without a kept seat.
    """
    with contextlib.ExitStack() as stack:
        for name in names:
            kept = stack.enter_context(kept_seat(folder, url, code, name))
            if kept is not None:
                yield name, kept
                return
        yield names[0], None


async def keep_seat(client: Client, game: Game, kept: KeptSeat | None) -> None:
    """Keep the newest resume token of a client until its game ends."""
    while kept is not None:
        if game.ended:
            kept.forget()
            return
        kept.keep(client.resume, game.own_seats)
        await asyncio.sleep(KEEP_SECONDS)


def came_back(client: Client, game: Game, kept: KeptSeat | None) -> str:
    """Return the names of the seats if the kept token restored them, else an empty text."""
    back = kept is not None and client.resumed and set(kept.seats) == set(game.own_seats)
    return ", ".join(game.own_seats) if back else ""


def _locked(path: Path) -> int | None:
    if fcntl is None:
        return None
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def state_folder() -> Path:
    """Return the folder of this user's kept seats."""
    return user_state("seats")
