"""An episode's recording as it grows: what has not been written is not published."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from typing import Any, Protocol

from robotouille.episode import Event
from robotouille.errors import RecordingError
from robotouille.replay.container import MAGIC, compress, frame_ends, frame_value
from robotouille.replay.recorder import Recorder
from robotouille_server.rooms.recordings.storage import Appender, FileCondition, Storage
from robotouille_server.runtime.logs import get_logger

__all__ = ["CLOSED", "OPEN", "Journal", "RecordedRoom", "close_recording", "file_name", "name_in"]

MAX_RECORDING_BYTES = 192 * 1024 * 1024
"""At which an episode is ended; what is written until then, and its end, can always be read."""
OPEN, CLOSED = ".rbt.part", ".rbt"


def file_name(created: str, task: str, episode: str) -> str:
    """`CREATED_TASK_EPISODE.rbt.part`, in letters that any file system takes."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{created}_{task}_{episode}") + OPEN


def name_in(head: dict[str, Any]) -> str:
    """The name under which the recording with a header began."""
    return file_name(head["created"], head["task"]["name"], head["episode"])


class Journal:
    """`NAME.rbt.part` while the episode runs, `NAME.rbt` when it is over.

    Bytes that cannot be written are kept and tried again; `problem` says why, or what others have
    done to the file, and is empty while all is well. A new file starts with `begin`; one that was
    `found` has `size` bytes already.
    """

    __slots__ = (
        "_damage",
        "_file",
        "_pending",
        "_storage",
        "_unwritten",
        "name",
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
        self.size = size
        self._unwritten = ""
        self._damage = ""
        self._storage = storage
        self._file = found
        self._pending = begin

    @property
    def full(self) -> bool:
        """Whether the episode has to end: readers take no more than so much."""
        return self.size > MAX_RECORDING_BYTES

    @property
    def problem(self) -> str:
        """What the operator should know; empty while all is well."""
        return self._unwritten or self._damage

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
            if problem != self._unwritten:
                get_logger().error("recording failed", file=self.name, error=problem)
            self._unwritten = problem
            return False
        self.size += len(self._pending)
        self._pending = b""
        if self._unwritten:
            get_logger().info("recording goes on", file=self.name)
        self._unwritten = ""
        return True

    def look(self) -> bool:
        """Notice what others have done to the file. One that was removed is written anew, which
        takes a while: True."""
        if self._file is None:
            return False
        try:
            condition = self._file.condition()
        except OSError as error:
            self._damaged(f"the recording is out of reach: {error.strerror or error}")
            return False
        if condition is FileCondition.REMOVED:
            self._write_anew(self._file)
            return True
        if condition is FileCondition.CUT_SHORT:
            self._damaged("somebody has cut the recording short; what is gone is lost")
        else:
            self._damage = ""
        return False

    def _write_anew(self, removed: Appender) -> None:
        """The content of a file without a name, in a new one that has it."""
        file = None
        try:
            content = removed.read()
            file = self._storage.create(self.name)
            file.append(content)
        except OSError as error:
            if file is not None:
                file.close()
                with contextlib.suppress(OSError):
                    self._storage.remove(self.name)
            reason = error.strerror or error
            self._damaged(f"somebody has removed the recording, and a new one fails: {reason}")
            return
        removed.close()
        self._file = file
        self._damage = ""
        get_logger().error("recording was removed, and is written anew", file=self.name)

    def _damaged(self, damage: str) -> None:
        if damage != self._damage:
            get_logger().error("recording damaged", file=self.name, error=damage)
        self._damage = damage

    def close(self) -> str:
        """Compress the recording and give it its final name; that name, or nothing if it failed
        (the file stays as it was, and the next start of a server closes it if it is whole)."""
        try:
            if self._file is None:
                raise FileNotFoundError(0, "nothing was written")
            return close_recording(self._storage, self.name, self._file.read(), self.size)
        except OSError as error:
            self._unwritten = f"the recording cannot be closed: {error.strerror or error}"
            get_logger().error("recording not closed", file=self.name, error=str(error))
            return ""
        except RecordingError as error:
            self._damaged(f"the recording is not closed, for it is {error}")
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


class RecordedRoom(Protocol):
    """A room, as far as its recording goes: see `Room`."""

    @property
    def journal(self) -> Journal | None: ...

    def players_of(self, session_id: str) -> tuple[str, ...]: ...


def close_recording(storage: Storage, name: str, content: bytes, size: int) -> str:
    """Replace a `.rbt.part` of so many bytes by its compressed `.rbt`; the new name.

    RecordingError, and the file stays, where its content is not whole up to the footer.
    """
    _check_whole(content, size)
    whole = name.removesuffix(OPEN) + CLOSED
    storage.replace(whole, compress(content))
    with contextlib.suppress(FileNotFoundError):
        storage.remove(name)
    return whole


def _check_whole(content: bytes, size: int) -> None:
    if len(content) < size:
        raise RecordingError(f"damaged: it has {len(content):,} bytes, {size:,} were written")
    last, end = len(MAGIC), len(MAGIC)
    for position in frame_ends(content):
        last, end = end, position
    if end < len(content):
        raise RecordingError(f"damaged at byte {end}")
    if frame_value(content, last, end).get("kind") != "footer":
        raise RecordingError(f"damaged at byte {end}: it has no end")
