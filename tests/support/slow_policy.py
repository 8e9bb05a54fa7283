"""Policy whose search takes as long as a test requires."""

from __future__ import annotations

import asyncio
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from robotouille import GroundAction, State
from robotouille.planning.policies import Did

__all__ = ["PATIENCE", "SlowPolicy"]

PATIENCE = 60.0
"""Time limit in seconds for a search that no test ends."""


class SlowPolicy:
    """Policy that reports each search in `asked` and waits for a result in `answers`.

    It fails if two threads use it at once.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._used = threading.Lock()
        self.asked: asyncio.Queue[State] = asyncio.Queue()
        self.answers: queue.SimpleQueue[GroundAction | Exception | None] = queue.SimpleQueue()
        self.observed: list[Did] = []

    def act(self, state: State) -> GroundAction | None:
        with self._alone():
            self._loop.call_soon_threadsafe(self.asked.put_nowait, state)
            answer = self.answers.get(timeout=PATIENCE)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def observe(self, did: Did) -> None:
        with self._alone():
            self.observed.append(did)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        assert self._used.acquire(blocking=False), "two threads use one policy"
        try:
            yield
        finally:
            self._used.release()
