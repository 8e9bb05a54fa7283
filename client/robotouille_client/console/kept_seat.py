"""The seat of a window or bot whose process stopped: who starts it again here gets it back."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from robotouille_client.client import Client
from robotouille_client.game import Game

try:
    import fcntl
except ImportError:  # Windows: seats are not kept there
    fcntl = None  # type: ignore[assignment]

__all__ = ["KeptSeat", "came_back", "keep_seat", "kept_seat", "kept_seat_of", "state_folder"]

KEEP_SECONDS = 0.2


class KeptSeat:
    """A file with the resume token of one player and the seats that it brings back, readable by its
    owner alone.

    The process that plays holds a lock on it: another one of the same name is another player.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor
        self._written = os.pread(descriptor, 4096, 0).decode(errors="replace").strip()

    @property
    def token(self) -> str | None:
        return self._written.partition("\n")[0] or None

    @property
    def seats(self) -> tuple[str, ...]:
        """Which the token brings back; none where an earlier version did not write them down."""
        return tuple(self._written.splitlines()[1:])

    def token_for(self, asked: Literal["all"] | Sequence[str]) -> str | None:
        """The token, where it brings back the seats that are asked for: any if none are named, or
        all that are free. Others are forgotten as soon as there is a seat to keep instead."""
        anything = not asked or asked == "all"
        return self.token if anything or set(asked) == set(self.seats) else None

    def keep(self, token: str | None, seats: Sequence[str]) -> None:
        """Write down the newest token; one that cannot be written is no reason to stop."""
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
        """The game is over: there is nothing to come back to."""
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)


@contextmanager
def kept_seat(folder: Path, url: str, code: str, name: str) -> Iterator[KeptSeat | None]:
    """The kept seat of a name in an episode; None where another process has it, or none can be."""
    key = "\n".join((url, code.strip().replace("-", "").upper(), name))
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
    """The first of some names under which no other process here plays, and its kept seat; the
    first of all, without one, where each of them is taken."""
    with contextlib.ExitStack() as stack:
        for name in names:
            kept = stack.enter_context(kept_seat(folder, url, code, name))
            if kept is not None:
                yield name, kept
                return
        yield names[0], None


async def keep_seat(client: Client, game: Game, kept: KeptSeat | None) -> None:
    """Write down what brings this player back into its seat, each time that it is another."""
    while kept is not None:
        if game.ended:
            kept.forget()
            return
        kept.keep(client.resume, game.own_seats)
        await asyncio.sleep(KEEP_SECONDS)


def came_back(client: Client, game: Game, kept: KeptSeat | None) -> str:
    """The seats of the process before, if the kept token has brought them back; else nothing."""
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
    """Where the seats of this user are kept."""
    home = os.environ.get("XDG_STATE_HOME")
    return (Path(home) if home else Path.home() / ".local" / "state") / "robotouille" / "seats"
