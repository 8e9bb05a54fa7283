"""All mirrors of a node."""

from __future__ import annotations

import asyncio
from functools import partial

from robotouille_server.cluster.spectators.mirror import Mirror, MirrorService
from robotouille_server.runtime.timer_queue import TimerQueue


class Mirrors:
    """Mirrors of the episodes that spectators of this node watch on other nodes."""

    def __init__(self, service: MirrorService) -> None:
        self.by_episode: dict[str, Mirror] = {}
        self._service = service
        self._timers = TimerQueue()
        service.node.directory.observer = self._changed

    def of(self, session: str, episode: str) -> Mirror | None:
        """Return the mirror to which a spectator may come back."""
        known = self._service.services.sessions.by_id.get(session)
        if known is not None and isinstance(known.room, Mirror):
            return known.room
        mirror = self.by_episode.get(episode)
        usable = mirror is not None and not mirror.closed and mirror.code
        # A spectator may have taken a seat since its token was made.
        return mirror if usable and mirror is not None and session not in mirror.seated else None

    async def open(self, episode: str) -> Mirror | None:
        """Return the mirror of an episode; None if its node does not answer."""
        mirror = self.by_episode.get(episode)
        if mirror is None or mirror.closed:
            mirror = self.by_episode[episode] = Mirror(episode, self._service, self._timers)
            mirror.running.add_done_callback(partial(self._forget, mirror))
        return mirror if await asyncio.shield(mirror.ready) else None

    def _forget(self, mirror: Mirror, done: asyncio.Task[None]) -> None:
        if self.by_episode.get(mirror.id) is mirror:
            del self.by_episode[mirror.id]

    def _changed(self, episode: str) -> None:
        mirror = self.by_episode.get(episode)
        if mirror is not None:
            mirror.look()

    async def close(self) -> None:
        """End all mirrors, because the server stops."""
        running = [mirror.running for mirror in self.by_episode.values()]
        for task in running:
            task.cancel()
        await asyncio.gather(*running, return_exceptions=True)
        self._timers.clear()
