"""Queries of SQLite catalogues in a process of their own, which can be limited and killed.

SQLite notices an interruption only between two instructions of its virtual machine. One call of a
function such as `instr` or `replace` is a single instruction and may take hours. The process
imports only what it needs, because it starts for each query.
"""

from __future__ import annotations

import contextlib
import math
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, cast

import msgpack

COMMAND = (sys.executable, "-P", "-m", "robotouille_data.sqlite_process")
"""Command of the process. With -P, files in the current folder cannot replace libraries."""
MAX_MEMORY = 1 << 30
"""Bytes of memory of the process, where the operating system supports a limit."""
MAX_VALUE = 64 << 20
"""Bytes of one value or row."""
CHUNK = 1 << 16
# The list has the allowed actions, because later versions of SQLite may add others.
ALLOWED = frozenset({
    sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_RECURSIVE
})  # fmt: skip

Row = tuple[Any, ...]


@contextmanager
def sqlite_answer(
    uri: str, query: str, *, seconds: float, lock_seconds: float
) -> Iterator[tuple[list[str], Iterator[Row]]]:
    """Run a query, and return the names of its columns and its rows.

    Args:
        uri: URI of the database, which should open it read-only.
        seconds: Time limit for the whole answer.
        lock_seconds: Time to wait for a writer.

    Raises:
        sqlite3.Error: The query is invalid or not allowed, or exceeds a limit. Reading the rows
            may raise it, too.
        sqlite3.Warning: The query has several statements.
    """
    request = {"uri": uri, "query": query, "seconds": seconds, "lock_seconds": lock_seconds}
    late = threading.Event()
    # A session of its own: Ctrl-C reaches only the caller, which then kills the process.
    with subprocess.Popen(  # noqa: S603
        COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as process:

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(min(seconds, threading.TIMEOUT_MAX), stop)
        timer.daemon = True
        timer.start()
        try:
            with contextlib.suppress(BrokenPipeError), cast("IO[bytes]", process.stdin) as asked:
                asked.write(msgpack.packb(request))
            rows = _received(process, late, seconds)
            columns = next(rows)
            yield list(columns), rows
        finally:
            timer.cancel()
            process.kill()


def _received(
    process: subprocess.Popen[bytes], late: threading.Event, seconds: float
) -> Iterator[Row]:
    """Yield the columns and the rows that the process sends, and raise its errors."""
    unpacker = msgpack.Unpacker(use_list=False, max_buffer_size=2 * MAX_MEMORY - 1)
    while chunk := cast("Any", process.stdout).read1(CHUNK):
        unpacker.feed(chunk)
        for frame in unpacker:
            if frame is None:
                return
            if isinstance(frame, dict):
                raise getattr(sqlite3, frame["error"])(frame["text"])
            yield frame
    # The process ended without an end frame.
    if late.is_set():
        raise sqlite3.OperationalError(f"interrupted: the query takes longer than {seconds:g} s")
    raise sqlite3.OperationalError("interrupted: the query needs too much memory or time")


# In the process


def main() -> None:
    """Answer the query on standard input with frames on standard output."""
    request = msgpack.unpackb(sys.stdin.buffer.read())
    output = sys.stdout.buffer
    try:
        _limit(request["seconds"])
        for frame in answer_frames(request["uri"], request["query"], request["lock_seconds"]):
            output.write(msgpack.packb(frame))
        output.write(msgpack.packb(None))
        output.flush()
    except (sqlite3.Error, sqlite3.Warning) as error:
        output.write(msgpack.packb({"error": type(error).__name__, "text": str(error)}))
    except MemoryError:
        text = f"the query needs more than {MAX_MEMORY >> 20} MiB of memory"
        output.write(msgpack.packb({"error": "OperationalError", "text": text}))


def _limit(seconds: float) -> None:
    """Limit the process, which may outlive a caller that was killed."""
    try:
        import resource
    except ImportError:  # Windows
        return
    processor = math.ceil(min(seconds, 1e6)) + 1
    for kind, most in ((resource.RLIMIT_AS, MAX_MEMORY), (resource.RLIMIT_CPU, processor)):
        # macOS refuses to limit the address space.
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))


def answer_frames(uri: str, query: str, lock_seconds: float) -> Iterator[Row]:
    """Yield the names of the columns and then the rows. A statement without rows has no columns."""
    connection = sqlite3.connect(uri, uri=True, timeout=lock_seconds)
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE)
    # Three barriers: the file is opened read-only, writes are disabled, and the authorizer allows
    # only reading. Without it, `ATTACH` could open other files.
    connection.execute("PRAGMA query_only=ON")
    connection.execute("PRAGMA trusted_schema=OFF")
    connection.set_authorizer(
        lambda action, *_: sqlite3.SQLITE_OK if action in ALLOWED else sqlite3.SQLITE_DENY
    )
    cursor = connection.execute(query)
    yield tuple(column[0] for column in cursor.description or ())
    yield from cursor


if __name__ == "__main__":
    main()
