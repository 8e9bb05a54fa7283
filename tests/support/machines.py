"""Machines with a configurable disk and configurable file descriptors."""

from __future__ import annotations

from pathlib import Path

from robotouille_server.health import Disk, System

__all__ = ["GIB", "Machine"]


GIB = 1024**3


class Machine(System):
    """Machine whose values a test sets; `looks` counts the disk queries."""

    def __init__(self) -> None:
        self.free: Disk | None = Disk(500 * GIB, 1000 * GIB)
        self.open, self.most = 100, 1000
        self.looks = 0

    def disk(self, folder: Path) -> Disk | None:
        self.looks += 1
        folder.stat()
        return self.free

    def descriptors(self) -> int:
        return self.open

    def max_descriptors(self) -> int:
        return self.most
