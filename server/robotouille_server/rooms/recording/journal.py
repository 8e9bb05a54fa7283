"""Recording of a running episode."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Protocol, TypeVar

from robotouille.episode import Event
from robotouille.errors import RecordingError
from robotouille.replay.compression import compress, plain
from robotouille.replay.container import MAGIC, Totals, frame_ends, frame_value
from robotouille.replay.file_names import CLOSED, OPEN, file_name
from robotouille.replay.recorder import Recorder
from robotouille_server.rooms.recording.storage import Appender, FileCondition, Storage
from robotouille_server.rooms.recording.write_ahead import EventLog
from robotouille_server.runtime.logs import get_logger

T = TypeVar("T")

MAX_RECORDING_BYTES = 192 * 1024 * 1024
"""Size at which an episode is ended, so that readers can always read its recording."""
MAX_RECORDING_FRAMES = 1_200_000
"""Number of frames at which an episode is ended, for the same reason."""
MAX_RECORDING_NOTES = 280_000
"""Number of notes at which an episode is ended, for the same reason."""
MAX_RECORDING_REASONS = 3_700_000
"""Number of reasons for rejections, with a quarter of their objects, for the same reason."""
MAX_RECORDING_TEXTS = 224 * 1024 * 1024
"""Bytes of the texts of notes at which an episode is ended, for the same reason."""
MAX_RECORDING_CHANGES = 24_000_000
"""Number of changes of facts at which an episode is ended, for the same reason."""
MAX_RECORDING_CREATED = 900_000
"""Number of created objects and their facts at which an episode is ended, for the same reason."""
FRAMES_A_TURN = 500
"""Number of frames that are checked before the checking thread rests."""
REST_SECONDS = 0.0005
"""Length of such a rest. Without it, the event loop would wait for 5 ms after each of its system
calls. Within a shorter rest, it may not wake up."""

_closing_thread = ThreadPoolExecutor(1, "closing")


def is_full(size: int, totals: Totals) -> bool:
    """Return whether a recording of this size must end, so that readers can read it."""
    return (
        size > MAX_RECORDING_BYTES
        or totals.frames > MAX_RECORDING_FRAMES
        or totals.notes > MAX_RECORDING_NOTES
        or totals.reasons > MAX_RECORDING_REASONS
        or totals.texts > MAX_RECORDING_TEXTS
        or totals.changes > MAX_RECORDING_CHANGES
        or totals.created > MAX_RECORDING_CREATED
    )


def name_in(head: dict[str, Any]) -> str:
    """Return the original file name of the recording with this header."""
    return file_name(head["created"], head["task"]["name"], head["episode"])


class EpisodeJournal(EventLog, Protocol):
    """Recording of a running episode: a file (`Journal`), or a replicated one."""

    @property
    def name(self) -> str:
        """File name, with the suffix of an open recording."""

    @property
    def size(self) -> int:
        """Number of written bytes."""

    @property
    def full(self) -> bool:
        """True if the recording has reached its maximum size."""

    def listen(self, changed: Callable[[], None]) -> None:
        """Call `changed` when a write that took longer has succeeded, or when it has failed."""

    def repair_if_changed(self) -> bool:
        """Repair the recording if another program has changed it; see `Journal`."""

    def finish(self, *, kept: bool) -> asyncio.Future[str]:
        """Close the recording and return its final name, or delete it if it is not `kept`."""

    def release(self) -> None:
        """Stop writing, so that another process can continue the recording."""


class Journal:
    """Recording that is being written: `NAME.rbt.part`, and `NAME.rbt` after the end.

    Bytes that cannot be written are kept for the next attempt.

    Args:
        storage: Where the file is.
        name: The name of the file.
        recorder: Encodes events.
        begin: The first bytes of a new file.
        found: An existing file, which has `size` bytes.
        size: The size of the existing file.
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
        """True if the recording has reached its maximum size."""
        return is_full(self.size, self.recorder.totals)

    @property
    def problem(self) -> str:
        """Problem with the file, for the operator, or empty."""
        return self._unwritten or self._damage

    def add(self, events: Iterable[Event]) -> None:
        """Encode events for the next `write`."""
        self._pending += self.recorder.record(events)

    @property
    def waiting(self) -> int:
        """Bytes that are not written yet."""
        return len(self._pending)

    def write(self) -> bool:
        """Hand all bytes to the operating system; return False if that failed (see `problem`)."""
        if not self._pending:
            return True
        try:
            if self._file is None:
                self._file = self._storage.create(self.name)
            # The data is not synced, because syncing takes milliseconds and would block all
            # episodes. A killed process loses nothing; a power cut may lose seconds
            # (docs/decisions/0013).
            self._file.append(self._pending)
        except OSError as error:
            problem = f"the recording cannot be written: {error.strerror or error}"
            # Each problem is logged once, because the driver retries every second.
            if problem != self._unwritten:
                get_logger().error("recording failed", file=self.name, error=problem)
            self._unwritten = problem
            return False
        self.size += len(self._pending)
        self._pending = b""
        if self._unwritten:
            get_logger().info("recording works again", file=self.name)
        self._unwritten = ""
        return True

    def check_ownership(self) -> bool:
        """Return True, because an open file is locked."""
        return True

    def listen(self, changed: Callable[[], None]) -> None:
        """Do nothing, because every write succeeds or fails at once."""

    def repair_if_changed(self) -> bool:
        """Check whether another program has changed the file; write a removed file again.

        Returns:
            True if the file was written again, which takes a while.
        """
        if self._file is None:
            return False
        try:
            # This costs a few microseconds per file, so all open recordings can be inspected every
            # five seconds.
            condition = self._file.condition()
        except OSError as error:
            self._damaged(f"the recording cannot be reached: {error.strerror or error}")
            return False
        if condition is FileCondition.REMOVED:
            self._write_again(self._file)
            return True
        if condition is FileCondition.CUT_SHORT:
            self._damaged("another program has cut the recording short; the removed part is lost")
        else:
            self._damage = ""
        return False

    def _write_again(self, removed: Appender) -> None:
        """Copy a file that has lost its name to a new file with the name."""
        file = None
        try:
            # The data of a removed file exists as long as the descriptor is open.
            content = removed.read()
            file = self._storage.create(self.name)
            file.append(content)
        except OSError as error:
            # An incomplete copy would later be restored in place of the recording.
            if file is not None:
                file.close()
                with contextlib.suppress(OSError):
                    self._storage.remove(self.name)
            reason = error.strerror or error
            self._damaged(f"the recording was removed and cannot be written again: {reason}")
            return
        removed.close()
        self._file = file
        self._damage = ""
        get_logger().error("recording was removed and has been written again", file=self.name)

    def _damaged(self, damage: str) -> None:
        if damage != self._damage:
            get_logger().error("recording damaged", file=self.name, error=damage)
        self._damage = damage

    def finish(self, *, kept: bool) -> asyncio.Future[str]:
        """Close the recording and return its final name, or delete it if it is not `kept`."""
        # A thread closes the file, because compressing a long recording would delay steps.
        return in_closing_thread(partial(_finish, self, kept=kept))

    def close(self) -> str:
        """Compress the recording and give it its final name.

        Returns:
            The final name; empty if that failed. The file then stays as it was, and the next
            server process closes it if it is complete.
        """
        try:
            if self._file is None:
                raise FileNotFoundError(0, "nothing was written")
            # The content is read through the descriptor, because another file may have the name by
            # now.
            return close_recording(self._storage, self.name, self._file.read(), self.size)
        except OSError as error:
            self._unwritten = f"the recording cannot be closed: {error.strerror or error}"
            get_logger().error("recording not closed", file=self.name, error=str(error))
            return ""
        except RecordingError as error:
            self._damaged(f"the recording is not closed: it is {error}")
            return ""
        finally:
            self.release()

    def discard(self) -> None:
        """Delete the file, because nobody took part in the episode."""
        try:
            self._storage.remove(self.name)
        except FileNotFoundError:
            pass
        except OSError as error:
            get_logger().error("recording not deleted", file=self.name, error=str(error))
        finally:
            self.release()

    def release(self) -> None:
        """Close the file, so that another process can continue it."""
        if self._file is not None:
            self._file.close()
            self._file = None


def in_closing_thread(work: Callable[[], T]) -> asyncio.Future[T]:
    """Do some work in the thread that closes recordings, one after another.

    Players can end several long games at once. With a thread for each, these threads would take
    turns at the interpreter, and the event loop would wait for all of them.
    """
    return asyncio.get_running_loop().run_in_executor(_closing_thread, work)


def _finish(journal: Journal, *, kept: bool) -> str:
    if kept:
        return journal.close()
    journal.discard()
    return ""


class RecordedRoom(Protocol):
    """Part of a room that its recording needs; see `Room`."""

    @property
    def journal(self) -> EpisodeJournal | None: ...

    def players_of(self, session_id: str) -> tuple[str, ...]: ...


def close_recording(storage: Storage, name: str, content: bytes, size: int) -> str:
    """Replace a `.rbt.part` of `size` bytes by its compressed `.rbt`; return the new name.

    Raises:
        RecordingError: The content is not complete up to the footer, or another recording has the
            new name. The file stays.
    """
    _check_whole(content, size)
    whole = name.removesuffix(OPEN) + CLOSED
    if not _is_stored(storage, whole, content):
        storage.replace(whole, compress(content))
    # The open file is removed only now, when the closed one exists and is synced. A crash in
    # between leaves both, and the next start closes the recording again.
    with contextlib.suppress(FileNotFoundError):
        storage.remove(name)
    return whole


def _is_stored(storage: Storage, whole: str, content: bytes) -> bool:
    """Return whether a closed recording exists. RecordingError if its content differs."""
    try:
        existing = storage.read(whole)
    except FileNotFoundError:
        return False
    if plain(existing)[0] != content:
        raise RecordingError(f"another recording than {whole}, which exists already")
    return True


def _check_whole(content: bytes, size: int) -> None:
    if len(content) < size:
        raise RecordingError(f"damaged: it has {len(content):,} bytes, but {size:,} were written")
    last, end = len(MAGIC), len(MAGIC)
    # Only the positions are computed, because decoding every frame would take much longer.
    for number, position in enumerate(frame_ends(content), 1):
        last, end = end, position
        if number % FRAMES_A_TURN == 0:
            time.sleep(REST_SECONDS)
    if end < len(content):
        raise RecordingError(f"damaged at byte {end}")
    if frame_value(content, last, end).get("kind") != "footer":
        raise RecordingError(f"damaged at byte {end}: it has no end")
