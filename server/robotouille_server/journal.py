"""An episode's recording as it grows: what has not been written is not told either."""

from __future__ import annotations

import re
from collections.abc import Iterable

from robotouille.episode import Event
from robotouille.replay.frames import compress
from robotouille.replay.recorder import Recorder
from robotouille_server.logs import get_logger
from robotouille_server.storage import Appender, Storage

__all__ = ["CLOSED", "OPEN", "Journal", "file_name"]

MAX_RECORDING_BYTES = 192 * 1024 * 1024
"""At which an episode is ended; what is written until then, and its end, can always be read."""
OPEN, CLOSED = ".rbt.part", ".rbt"


def file_name(created: str, task: str, episode: str) -> str:
    """`CREATED_TASK_EPISODE.rbt.part`, in letters that any file system takes."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{created}_{task}_{episode}") + OPEN


class Journal:
    """`NAME.rbt.part` while the episode runs, `NAME.rbt` when it is over.

    Bytes that cannot be written are kept and tried again; `problem` says why, and is empty while
    all is well. A new file starts with `begin`; one that was `found` has `size` bytes already.
    """

    __slots__ = (
        "_file",
        "_pending",
        "_storage",
        "name",
        "problem",
        "recorder",
        "size",
    )

    def __init__(
        self,
        storage: Storage,
        name: str,
        recorder: Recorder,
        *,
        begin: bytes = b"",
        found: Appender | None = None,
        size: int = 0,
    ) -> None:
        self.name = name
        self.recorder = recorder
        self.problem = ""
        self.size = size
        self._storage = storage
        self._file = found
        self._pending = begin

    @property
    def full(self) -> bool:
        """Whether the episode has to end: readers take no more than so much."""
        return self.size > MAX_RECORDING_BYTES

    def add(self, events: Iterable[Event]) -> None:
        """What happened; it is written by the next `write`."""
        self._pending += self.recorder.record(events)

    @property
    def waiting(self) -> int:
        """Bytes that are not written yet."""
        return len(self._pending)

    def write(self) -> bool:
        """Hand everything to the operating system; False if that failed (see `problem`)."""
        if not self._pending:
            return True
        try:
            if self._file is None:
                self._file = self._storage.create(self.name)
            self._file.append(self._pending)
        except OSError as error:
            problem = f"the recording cannot be written: {error.strerror or error}"
            if problem != self.problem:
                get_logger().error("recording failed", file=self.name, error=problem)
            self.problem = problem
            return False
        self.size += len(self._pending)
        self._pending = b""
        if self.problem:
            get_logger().info("recording goes on", file=self.name)
        self.problem = ""
        return True

    def close(self) -> str:
        """Compress the recording and give it its final name; that name, or nothing if it failed
        (the file stays as it was, and the next start of a server closes it)."""
        try:
            return close_recording(self._storage, self.name)
        except OSError as error:
            self.problem = f"the recording cannot be closed: {error.strerror or error}"
            get_logger().error("recording not closed", file=self.name, error=str(error))
            return ""
        finally:
            self.release()

    def discard(self) -> None:
        """Delete the file: nobody ever took part."""
        try:
            self._storage.remove(self.name)
        except FileNotFoundError:
            pass
        except OSError as error:
            get_logger().error("recording not deleted", file=self.name, error=str(error))
        finally:
            self.release()

    def release(self) -> None:
        """Leave the file to whoever goes on with it."""
        if self._file is not None:
            self._file.close()
            self._file = None


def close_recording(storage: Storage, name: str) -> str:
    """Replace a whole `.rbt.part` by its compressed `.rbt`; the new name."""
    whole = name.removesuffix(OPEN) + CLOSED
    storage.replace(whole, compress(storage.read(name)))
    storage.remove(name)
    return whole
