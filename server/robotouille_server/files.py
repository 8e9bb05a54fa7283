"""Recordings on disk: appended while an episode runs, compressed when it closes."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path
from typing import BinaryIO

from robotouille.replay.frames import compress
from robotouille_server.logs import get_logger

__all__ = ["RecordingFile"]


class RecordingFile:
    """`NAME.rbt.part` while it grows, `NAME.rbt` when it is whole."""

    def __init__(self, folder: Path, name: str) -> None:
        self.path = folder / f"{re.sub(r'[^A-Za-z0-9_.-]+', '-', name)}.rbt"
        self._part = self.path.with_suffix(".rbt.part")
        self._file: BinaryIO | None = None
        self.begun = False

    def open(self) -> None:
        """Create the file; OSError where that cannot be."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._part.open("xb")
        self.begun = True

    def append(self, data: bytes) -> None:
        """Hand bytes to the operating system; an error is logged and ends the recording."""
        if self._file is None or not data:
            return
        try:
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            get_logger().error("recording failed", file=str(self._part), error=str(error))
            with contextlib.suppress(OSError):
                self._file.close()
            self._file = None

    def close(self) -> Path | None:
        """Compress the recording and give it its final name; None if it failed before."""
        if self._file is None:
            return None
        file, self._file = self._file, None
        try:
            file.close()
            compressed = self.path.with_suffix(".rbt.new")
            with compressed.open("wb") as whole:
                whole.write(compress(self._part.read_bytes()))
                whole.flush()
                os.fsync(whole.fileno())
            compressed.rename(self.path)
            self._part.unlink()
        except OSError as error:
            get_logger().error("recording not closed", file=str(self._part), error=str(error))
            return None
        return self.path
