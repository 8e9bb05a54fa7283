"""Indexing folders of recordings into a catalogue, with several processes."""

from __future__ import annotations

import gc
import os
import signal
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from pathlib import Path
from threading import Event

from sqlalchemy.engine import URL, Engine, make_url
from sqlalchemy.exc import DataError, IntegrityError

from robotouille.errors import RecordingError
from robotouille.processes import spawn_context
from robotouille.replay.compression import plain_size
from robotouille.replay.file_names import CLOSED, OPEN
from robotouille_data.database import (
    UnavailableError,
    create_file,
    database_errors,
    migrate,
    writing_engine,
)
from robotouille_data.recording_rows import (
    NO_SEARCHES,
    Searches,
    content_digest,
    episode_id,
    read_content,
    recorded_rows,
)
from robotouille_data.store import ReadFile, Stamp, forget, known_files, lacking_measures, store

FILES_AT_ONCE = 50
"""Files in one transaction. A lost database connection repeats at most this many."""
MAX_BYTES = 4 * 1024 * 1024
"""Bytes of files in one transaction of several files."""
MAX_HELD_BYTES = 32 * 1024 * 1024
"""Memory of rows and recordings after which a transaction takes no more files. A recording of a
few kilobytes can expand to 256 MiB, or to millions of rows."""
MAX_FAULT = 500
UNFIT = (RecordingError, DataError, IntegrityError, OverflowError, UnicodeError)
"""Errors that a damaged recording can cause, as opposed to the database."""

Progress = Callable[[int, int], None]
"""Called with the number of finished files and their total."""
File = tuple[str, Stamp]


@dataclass(slots=True)
class IndexResult:
    """Counts of files, and the faults of files without an episode by their paths.

    Attributes:
        unfinished: Files without an end that were left out.
    """

    indexed: int = 0
    unchanged: int = 0
    removed: int = 0
    unfinished: int = 0
    faults: dict[str, str] = field(default_factory=dict)


def index(
    url: URL,
    folders: Sequence[Path],
    *,
    jobs: int = 1,
    unfinished: bool = False,
    reindex: bool = False,
    searches: Searches = NO_SEARCHES,
    progress: Progress = lambda done, total: None,
) -> IndexResult:
    """Index new and changed recordings below some folders, and remove deleted ones.

    Args:
        url: URL of the database.
        jobs: Processes that read recordings.
        unfinished: Index recordings without an end, too. Those that are already in the catalogue
            are always updated.
        reindex: Read unchanged recordings again.
        searches: The measures to compute that take a search. Unchanged recordings without a value
            are read again.
        progress: Called after each group of files.

    Raises:
        UnavailableError: The database cannot be written or a folder cannot be read now. Earlier
            transactions remain.
        CatalogueError: The catalogue has a later version.
    """
    result, found = IndexResult(), dict[str, Stamp]()
    roots = [str(folder.absolute()) for folder in folders]
    for root in roots:
        for path, stamp in _recordings(root):
            if not _is_text(path):
                result.faults[path] = "the name is not UTF-8, so a database cannot store it"
            else:
                found[path] = stamp
    known, lacking = _prepare(url, roots, found, result, searches)
    # An unfinished recording that is already known must be updated, or its rows would go stale.
    if not unfinished:
        left_out = {p for p in found if p.endswith(OPEN) and p not in known}
        found = {path: stamp for path, stamp in found.items() if path not in left_out}
        result.unfinished = len(left_out)
    if any(searches):
        known = {path: stamp for path, stamp in known.items() if path not in lacking}
    changed = [(p, s) for p, s in sorted(found.items()) if reindex or known.get(p) != s]
    result.unchanged = len(found) - len(changed)
    done = 0
    progress(done, len(changed))
    for count, faults in _read_all(url, changed, jobs, searches):
        result.indexed += count - len(faults)
        result.faults |= faults
        done += count
        progress(done, len(changed))
    return result


def has_recordings(folder: Path) -> bool:
    """Return whether a folder contains recordings, including unfinished ones.

    Raises:
        UnavailableError: The folder cannot be read.
    """
    return any(True for _ in _recordings(str(folder.absolute())))


def _recordings(root: str) -> Iterator[File]:
    """Yield the recordings below a folder. Links are not followed."""

    def fail(error: OSError) -> None:
        raise UnavailableError(f"{error.filename}: cannot be read: {error.strerror}") from None

    for folder, _, names in os.walk(root, onerror=fail):
        names_here = set(names)
        for name in names:
            # While a server closes a recording, both files exist. The closed one is complete.
            whole = name.removesuffix(".part")
            if not name.endswith((CLOSED, OPEN)) or (whole != name and whole in names_here):
                continue
            path = Path(folder, name)
            try:
                status = path.lstat()
            except FileNotFoundError:  # The server has just finished and renamed it.
                continue
            if stat.S_ISREG(status.st_mode):
                yield str(path), Stamp(status.st_size, status.st_mtime_ns)


def _is_text(path: str) -> bool:
    try:
        path.encode()
    except UnicodeEncodeError:  # Python keeps such bytes as lone surrogates.
        return False
    return True


def _prepare(
    url: URL,
    roots: Sequence[str],
    found: Mapping[str, Stamp],
    result: IndexResult,
    searches: Searches,
) -> tuple[dict[str, Stamp], set[str]]:
    """Migrate the catalogue and remove deleted recordings.

    Returns:
        The known files, and the files without a measure of `searches`.
    """
    create_file(url)
    engine, known = writing_engine(url), dict[str, Stamp]()
    with database_errors(url), engine.begin() as connection:
        migrate(connection)
        for root in roots:
            known |= known_files(connection, root)
        gone = known.keys() - found.keys()
        forget(connection, gone)
        lacking = lacking_measures(connection, searches)
    result.removed = len(gone)
    return known, lacking


def _read_all(
    url: URL, files: Sequence[File], jobs: int, searches: Searches
) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the number of files and the faults of each group."""
    pieces = list(_pieces(files))
    # An engine cannot be pickled, so each reading process gets the URL and makes its own.
    text = url.render_as_string(hide_password=False)
    if min(jobs, len(pieces)) < 2:
        for piece in pieces:
            yield len(piece), _index_files(text, piece, searches)
        return
    with ProcessPoolExecutor(jobs, spawn_context(), _begin_reading) as pool:
        try:
            futures = {
                pool.submit(_index_files, text, piece, searches): len(piece) for piece in pieces
            }
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            raise UnavailableError("a process that read recordings was killed") from None
        finally:
            # Do not wait for groups that have not started, for example after Ctrl+C.
            pool.shutdown(wait=False, cancel_futures=True)


def _begin_reading() -> None:
    """Prepare a reading process.

    The parent handles Ctrl+C. Rows and frames have no reference cycles, and collecting garbage
    among tens of thousands of new tuples takes a third of the time.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()


def _pieces(files: Sequence[File]) -> Iterator[list[File]]:
    """Yield groups of files for one transaction."""
    piece: list[File] = []
    size = 0
    for path, stamp in files:
        if piece and (len(piece) == FILES_AT_ONCE or size + stamp.size > MAX_BYTES):
            yield piece
            piece, size = [], 0
        piece.append((path, stamp))
        size += stamp.size
    if piece:
        yield piece


# In the reading processes


@cache
def _engine(url: str) -> Engine:
    return writing_engine(make_url(url))


def _index_files(url: str, files: Sequence[File], searches: Searches) -> dict[str, str]:
    """Read files and write their rows. Return the faults of files without rows."""
    faults: dict[str, str] = {}
    engine = _engine(url)
    with database_errors(engine.url):
        for read in _transactions(files, faults, searches):
            try:
                with engine.begin() as connection:
                    store(connection, read)
            except UNFIT:
                # A long recording may be damaged further on, after its first rows were inserted.
                # The transaction is rolled back, and storing one file at a time finds the damaged
                # one.
                for each in read:
                    _store_alone(engine, each, faults, searches)
            faults |= {each.path: each.fault for each in read if each.fault}
            # Otherwise these files stay in memory while the next ones are read.
            read.clear()
    return faults


def _transactions(
    files: Sequence[File], faults: dict[str, str], searches: Searches
) -> Iterator[list[ReadFile]]:
    """Yield the files in parts whose rows fit into memory together."""
    read: list[ReadFile] = []
    size = 0
    for file in files:
        if each := _read(*file, faults, searches):
            read.append(each)
            size += each.size
        del each  # Otherwise it stays in memory while the next file is read.
        if size > MAX_HELD_BYTES:
            yield read
            read, size = [], 0
    if read:
        yield read


def _store_alone(
    engine: Engine, file: ReadFile, faults: dict[str, str], searches: Searches
) -> None:
    # The rows of the first attempt are partly consumed, so the file is read again.
    again = _read(file.path, file.stamp, faults, searches)
    if again is None:
        return
    try:
        with engine.begin() as connection:
            store(connection, [again])
    except UNFIT as error:
        faults[file.path] = _fault(error)
        broken = ReadFile(file.path, file.stamp, again.digest, faults[file.path])
        with engine.begin() as connection:
            store(connection, [broken])


def _read(path: str, stamp: Stamp, faults: dict[str, str], searches: Searches) -> ReadFile | None:
    """Read a recording. Return None if the file cannot be read now.

    The rows of a short recording are complete. A long one is read further while it is stored.
    """
    digest = ""
    try:
        content = read_content(Path(path))
        digest = content_digest(content)
        parts = recorded_rows(content, episode_id(digest), searches)
        # Reading two parts completes every recording with up to `MAX_ROWS` rows, so its damage is
        # found before a transaction begins.
        beginning = [part for _, part in zip(range(2), parts, strict=False)]
    except RecordingError as error:
        return ReadFile(path, stamp, digest, _fault(error))
    except FileNotFoundError:
        return None
    except OSError as error:
        faults[path] = f"cannot be read: {error.strerror or error}"
        return None
    size = sum(part.size for part in beginning)
    if len(beginning) > 1:  # The recording is held, because there may be more parts.
        size += plain_size(content)
    return ReadFile(path, stamp, digest, parts=chain(beginning, parts), size=size)


def _fault(error: Exception) -> str:
    why = error.orig if isinstance(error, DataError | IntegrityError) else error
    return str(why).replace("\0", "\N{REPLACEMENT CHARACTER}")[:MAX_FAULT]


MAX_PAUSE = 60.0
"""Longest pause between two attempts to reach the database."""


def watch(
    url: URL,
    folders: Sequence[Path],
    stop: Event,
    *,
    jobs: int = 1,
    interval: float = 5.0,
    fetch: Callable[[], None] = lambda: None,
    report: Callable[[IndexResult], None],
    trouble: Callable[[str, float], None],
) -> None:
    """Index the folders repeatedly.

    Each scan compares the folders with the catalogue, so nothing is missed while the database or
    this process is down.

    Args:
        stop: Event that ends the loop after the current scan.
        interval: Seconds between two scans.
        fetch: Called before each scan. It may raise UnavailableError.
        report: Called with the result of each scan.
        trouble: Called with the reason why the database, a folder or what `fetch` needs is
            unavailable, and the seconds until the next attempt.

    Raises:
        CatalogueError: An error that a retry cannot fix.
    """
    failed = 0
    while not stop.is_set():
        try:
            fetch()
            found = index(url, folders, jobs=jobs)
        except UnavailableError as error:
            # Exponential backoff, so that a database that restarts is not flooded.
            pause = min(MAX_PAUSE, 2.0**failed)
            failed += 1
            trouble(str(error), pause)
            stop.wait(pause)
            continue
        failed = 0
        report(found)
        stop.wait(interval)
