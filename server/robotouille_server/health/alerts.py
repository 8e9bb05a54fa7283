"""What the operator must look after before it goes wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from robotouille_server.health.sampling import Health

__all__ = [
    "DESCRIPTOR_SHARE",
    "DISK_FREE_BYTES",
    "DISK_FREE_SHARE",
    "PARTICIPANT_BYTES",
    "Alert",
    "alerts",
]

GIB, MIB = 1024**3, 1024**2
DISK_FREE_BYTES, DISK_FREE_SHARE = GIB, 0.05
DISK_CRITICAL = 100 * MIB
DESCRIPTOR_SHARE, DESCRIPTOR_CRITICAL = 0.8, 0.95
PARTICIPANT_BYTES = 64 * 1024
"""A second, from one participant; a person or a bot sends a few hundred."""

Severity = Literal["warning", "critical"]


@dataclass(frozen=True, slots=True)
class Alert:
    """`kind` is `disk`, `log`, `descriptors`, `participant` or `audit`."""

    kind: str
    text: str
    severity: Severity


def alerts(health: Health) -> list[Alert]:
    """Those that are critical first."""
    found = [*_disk(health), *_descriptors(health), *_log(health), *_busiest(health)]
    return sorted(found, key=lambda alert: alert.severity != "critical")


def _disk(health: Health) -> Iterator[Alert]:
    disk = health.disk
    if health.disk_problem:
        yield Alert("disk", health.disk_problem, "critical")
    elif disk is not None and (
        disk.free < DISK_FREE_BYTES or disk.free < DISK_FREE_SHARE * disk.size
    ):
        share = disk.free / max(disk.size, 1)
        text = f"{_size(disk.free)} ({share:.1%}) are free on the recordings' disk"
        yield Alert("disk", text, "critical" if disk.free < DISK_CRITICAL else "warning")


def _descriptors(health: Health) -> Iterator[Alert]:
    used, most = health.descriptors, health.max_descriptors
    if used is None or not most or used <= DESCRIPTOR_SHARE * most:
        return
    text = f"{used:,} of {most:,} file descriptors are open; without one nobody comes in"
    yield Alert("descriptors", text, "critical" if used > DESCRIPTOR_CRITICAL * most else "warning")


def _log(health: Health) -> Iterator[Alert]:
    if health.held_back:
        lines = f"{health.held_back:,} log line{'s' * (health.held_back > 1)}"
        yield Alert("log", f"{lines} held back in the last minute", "warning")


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
