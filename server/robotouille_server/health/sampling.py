"""What a server may run out of, looked at every few seconds: disk, descriptors, log, bandwidth.

Nothing here is on the way of a message: all of it is read when the operator's view ticks or when
metrics are asked for, and at most once in `SAMPLE_SECONDS`.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from robotouille_server.rooms.session import Session
from robotouille_server.runtime import descriptors
from robotouille_server.runtime.metrics import Metrics

__all__ = ["SAMPLE_SECONDS", "Busiest", "Disk", "Health", "System"]

SAMPLE_SECONDS = 5.0
LOG_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class Disk:
    """Bytes that this user may still write, and how many there are in all."""

    free: int
    size: int


@dataclass(frozen=True, slots=True)
class Busiest:
    """Who sends most, and how many bytes a second over the last seconds."""

    name: str
    code: str
    bytes_per_second: float


class System:
    """What the operating system says; None where it does not."""

    def disk(self, folder: Path) -> Disk | None:
        """The disk of a folder; OSError if the folder is not there."""
        if sys.platform == "win32":
            return None
        found = os.statvfs(folder)
        return Disk(found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize)

    def descriptors(self) -> int | None:
        """How many this process has open."""
        return descriptors.in_use()

    def max_descriptors(self) -> int | None:
        """How many it may have open."""
        most = descriptors.limit()
        return None if most == descriptors.UNLIMITED else most


class Health:
    """The last sample. `folder` is that of the recordings, if there is one on disk.

    `disk_problem` says why the disk cannot be looked at; `held_back` is how many log lines were
    in the last minute.
    """

    def __init__(self, metrics: Metrics, folder: Path | None, system: System | None = None) -> None:
        self.disk: Disk | None = None
        self.disk_problem = ""
        self.descriptors: int | None = None
        self.max_descriptors: int | None = None
        self.held_back = 0
        self.busiest: Busiest | None = None
        self.system = system or System()
        self._metrics = metrics
        self._folder = folder
        self._sampled: float | None = None
        self._received: dict[Session, int] = {}
        self._log: deque[tuple[float, int]] = deque()

    def sample(self, now: float, sessions: Iterable[Session]) -> None:
        """Look again, if the last look is long enough ago; `now` is the loop's time."""
        if self._sampled is not None and now - self._sampled < SAMPLE_SECONDS:
            return
        passed = 0.0 if self._sampled is None else now - self._sampled
        self._sampled = now
        self._look_at_disk()
        self.descriptors = self.system.descriptors()
        self.max_descriptors = self.system.max_descriptors()
        self._look_at_log(now)
        self._look_at(sessions, passed)
        self._update_metrics()

    def _look_at_disk(self) -> None:
        self.disk, self.disk_problem = None, ""
        if self._folder is None:
            return
        try:
            self.disk = self.system.disk(self._folder)
        except OSError as error:
            self.disk_problem = f"the recordings folder: {error.strerror or error}"

    def _look_at_log(self, now: float) -> None:
        self._log.append((now, self._metrics.log_suppressed))
        while len(self._log) > 1 and self._log[1][0] <= now - LOG_SECONDS:
            self._log.popleft()
        self.held_back = self._log[-1][1] - self._log[0][1]

    def _look_at(self, sessions: Iterable[Session], passed: float) -> None:
        before, self._received = self._received, {s: s.received_bytes for s in sessions}
        self.busiest = None
        if passed <= 0:
            return
        growth = {s: count - before.get(s, 0) for s, count in self._received.items()}
        most = max(growth, key=growth.__getitem__, default=None)
        if most is not None and growth[most] > 0:
            code = most.room.code if most.room is not None else ""
            self.busiest = Busiest(most.name, code, growth[most] / passed)

    def _update_metrics(self) -> None:
        metrics = self._metrics
        metrics.disk_free = self.disk.free if self.disk is not None else None
        metrics.descriptors, metrics.max_descriptors = self.descriptors, self.max_descriptors
        metrics.busiest_participant = self.busiest.bytes_per_second if self.busiest else 0.0
