"""Tokens for one session that were used on any node of a cluster."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Container
from contextlib import suppress

from robotouille.errors import RobotouilleError
from robotouille_server.auth.revocation import (
    MAX_USED_FILE_BYTES,
    TIDY_SECONDS,
    FailedJoins,
    TokenUse,
    use_name,
)
from robotouille_server.cluster.bus import Bucket, Bus, ConflictError, Entry, UnavailableError

USED = "used."
"""Prefix of the names in the bucket."""
ATTEMPTS = 5
"""Attempts to record the use of a token that others use and release at the same time."""
MAX_FORGOTTEN = 20
"""Used tokens that are deleted at a time, because NATS is asked for each."""


class SharedUses:
    """Copy of the uses in the bucket, which may be a moment behind."""

    def __init__(self, bus: Bus, wall: Callable[[], float]) -> None:
        self._bus = bus
        self._wall = wall
        self._known: dict[str, TokenUse] = {}
        self._next_tidy = wall()
        self._failed = FailedJoins()

    def changed(self, name: str, entry: Entry | None) -> None:
        """Note a change of the bucket."""
        if entry is None:
            self._known.pop(name, None)
        else:
            self._known[name] = _use(name, entry)

    def check(self, token_id: str, session: str) -> None:
        """Raise ProtocolError `auth/used` if the copy has a use by another session."""
        used = self._known.get(USED + use_name(token_id))
        if used is not None:
            used.check(session)

    async def use(self, token_id: str, use: TokenUse) -> bool:
        """Record the use of a token; return False if the session has used it before.

        Raises:
            ProtocolError: `auth/used` if another session has used the token, `rate/limited` if
                too many joins with it have failed, because each costs the cluster two writes.
            BusError: The use is not recorded, or not certainly.
        """
        self._failed.check(token_id, _now())
        name = USED + use_name(token_id)
        for _ in range(ATTEMPTS):
            with suppress(ConflictError):
                await self._bus.create(Bucket.SHARED, name, use.model_dump_json().encode())
                return True
            entry = await self._bus.get(Bucket.SHARED, name)
            if entry is not None:
                _use(name, entry).check(use.session)
                return False
        raise UnavailableError("the token is used and released all the time")

    async def release(self, token_id: str, session: str) -> None:
        """Make a token unused again after a join has failed.

        Raises:
            ProtocolError: Another session has used it.
        """
        self._failed.failed(token_id, _now())
        name = USED + use_name(token_id)
        entry = await self._bus.get(Bucket.SHARED, name)
        if entry is not None:
            _use(name, entry).check(session)
            await self._bus.delete(Bucket.SHARED, name)

    async def restore(self, found: Container[str]) -> None:
        """Record the known uses that are missing in the bucket again.

        Args:
            found: The names in the bucket.
        """
        for name, use in list(self._known.items()):
            if name not in found and not use.outdated(self._wall()):
                with suppress(ConflictError):
                    await self._bus.create(Bucket.SHARED, name, use.model_dump_json().encode())

    async def forget_outdated(self) -> None:
        """Delete the uses of tokens that have expired, a few at a time."""
        now = self._wall()
        if now < self._next_tidy:
            return
        outdated = [name for name, use in self._known.items() if use.outdated(now)]
        for name in outdated[:MAX_FORGOTTEN]:
            await self._bus.delete(Bucket.SHARED, name)
            self._known.pop(name, None)
        if len(outdated) <= MAX_FORGOTTEN:
            self._next_tidy = now + TIDY_SECONDS


def _now() -> float:
    return asyncio.get_running_loop().time()


def _use(name: str, entry: Entry) -> TokenUse:
    if len(entry.value) > MAX_USED_FILE_BYTES:
        return TokenUse.unreadable(name, RobotouilleError(f"{len(entry.value)} bytes"))
    return TokenUse.parse(entry.value, name)
