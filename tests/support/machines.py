"""Machines whose disk and descriptors a test sets."""

from __future__ import annotations

from pathlib import Path

from robotouille_server.health import Disk, System

__all__ = ["GIB", "Machine"]


GIB = 1024**3


class Machine(System):
    """What a test says of the machine; `looks` counts how often it was asked."""

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
