"""Resources that a server may run out of, and alerts about them for the operator."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from robotouille_server.rooms.participants.session import Session
from robotouille_server.runtime import process_limits as descriptors
from robotouille_server.runtime.metrics import Metrics

SAMPLE_SECONDS = 5.0
LOG_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class Disk:
    """Free bytes for this user, and the size of the disk."""

    free: int
    size: int


@dataclass(frozen=True, slots=True)
class Busiest:
    """Participant who has sent most in the last seconds, in bytes per second."""

    name: str
    code: str
    bytes_per_second: float


class System:
    """Measurements of the operating system; None where they are not available."""

    def disk(self, folder: Path) -> Disk | None:
        """Return the disk of a folder; raise OSError if the folder does not exist."""
        if sys.platform == "win32":
            return None
        found = os.statvfs(folder)
        return Disk(found.f_bavail * found.f_frsize, found.f_blocks * found.f_frsize)

    def descriptors(self) -> int | None:
        """Return the number of open descriptors."""
        return descriptors.in_use()

    def max_descriptors(self) -> int | None:
        """Return the maximum number of open descriptors."""
        most = descriptors.limit()
        return None if most == descriptors.UNLIMITED else most


class Health:
    """Latest sample of all measurements.

    Args:
        folder: Folder of the recordings.
        reserve: Free bytes of its disk below which no episodes are opened.

    Attributes:
        disk_problem: The reason why the disk of the recordings cannot be measured, or empty.
        suppressed: The log lines that were suppressed in the last minute.
    """

    def __init__(
        self,
        metrics: Metrics,
        folder: Path | None,
        system: System | None = None,
        *,
        reserve: int = 0,
    ) -> None:
        self.reserve = reserve
        self.disk: Disk | None = None
        self.disk_problem = ""
        self.descriptors: int | None = None
        self.max_descriptors: int | None = None
        self.suppressed = 0
        self.busiest: Busiest | None = None
        self.system = system or System()
        self._metrics = metrics
        self._folder = folder
        self._sampled: float | None = None
        self._received: dict[Session, int] = {}
        self._log: deque[tuple[float, int]] = deque()

    def sample(self, now: float, sessions: Iterable[Session]) -> None:
        """Measure again, if the last sample is old enough. `now` is the event loop's time."""
        # The operator page, the metrics and MQTT all ask for samples.
        if self._sampled is not None and now - self._sampled < SAMPLE_SECONDS:
            return
        passed = 0.0 if self._sampled is None else now - self._sampled
        self._sampled = now
        self._measure_disk()
        self.descriptors = self.system.descriptors()
        self.max_descriptors = self.system.max_descriptors()
        self._measure_log(now)
        self._measure_sessions(sessions, passed)
        self._update_metrics()

    def _measure_disk(self) -> None:
        self.disk, self.disk_problem = None, ""
        if self._folder is None:
            return
        try:
            self.disk = self.system.disk(self._folder)
        except OSError as error:
            self.disk_problem = f"the recordings folder: {error.strerror or error}"

    def _measure_log(self, now: float) -> None:
        self._log.append((now, self._metrics.log_suppressed))
        while len(self._log) > 1 and self._log[1][0] <= now - LOG_SECONDS:
            self._log.popleft()
        self.suppressed = self._log[-1][1] - self._log[0][1]

    def _measure_sessions(self, sessions: Iterable[Session], passed: float) -> None:
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


GIB, MIB = 1024**3, 1024**2
DISK_FREE_BYTES, DISK_FREE_SHARE = GIB, 0.05
DISK_CRITICAL = 100 * MIB
DESCRIPTOR_SHARE, DESCRIPTOR_CRITICAL = 0.8, 0.95
PARTICIPANT_BYTES = 64 * 1024
"""Bytes per second from one participant that cause an alert. A person or bot sends a few
hundred."""

Severity = Literal["warning", "critical"]


@dataclass(frozen=True, slots=True)
class Alert:
    """Alert for the operator. `kind` is `disk`, `log`, `descriptors`, `participant` or `audit`."""

    kind: str
    text: str
    severity: Severity


def alerts(health: Health) -> list[Alert]:
    """Return the alerts about a sample, critical ones first."""
    found = [*_disk(health), *_descriptors(health), *_log(health), *_busiest(health)]
    return sorted(found, key=lambda alert: alert.severity != "critical")


def _disk(health: Health) -> Iterator[Alert]:
    disk = health.disk
    if health.disk_problem:
        yield Alert("disk", health.disk_problem, "critical")
        return
    if disk is None:
        return
    share = disk.free / max(disk.size, 1)
    text = f"the recordings' disk has {_size(disk.free)} ({share:.1%}) left"
    if disk.free < health.reserve:
        yield Alert("disk", f"{text}, so no episodes are opened", "critical")
    elif disk.free < DISK_FREE_BYTES or share < DISK_FREE_SHARE:
        yield Alert("disk", text, "critical" if disk.free < DISK_CRITICAL else "warning")


def _descriptors(health: Health) -> Iterator[Alert]:
    used, most = health.descriptors, health.max_descriptors
    if used is None or not most or used <= DESCRIPTOR_SHARE * most:
        return
    text = f"{used:,} of {most:,} file descriptors are open; every new client needs one"
    yield Alert("descriptors", text, "critical" if used > DESCRIPTOR_CRITICAL * most else "warning")


def _log(health: Health) -> Iterator[Alert]:
    if health.suppressed:
        lines = f"{health.suppressed:,} log line{'s' * (health.suppressed > 1)}"
        yield Alert("log", f"{lines} suppressed in the last minute", "warning")


def _busiest(health: Health) -> Iterator[Alert]:
    busiest = health.busiest
    if busiest is not None and busiest.bytes_per_second > PARTICIPANT_BYTES:
        where = f" in {busiest.code}" if busiest.code else ""
        text = f"{busiest.name!r}{where} sends {_size(busiest.bytes_per_second)} a second"
        yield Alert("participant", text, "warning")


def _size(count: float) -> str:
    units = ["B", "KiB", "MiB", "GiB", "TiB"]
    while count >= 1024 and len(units) > 1:
        count /= 1024
        units.pop(0)
    return f"{count:.3g} {units[0]}" if count < 1000 else f"{count:.0f} {units[0]}"
