"""Bring a catalogue up to date with folders of recordings, in several processes."""

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

from sqlalchemy.engine import URL, Engine, make_url
from sqlalchemy.exc import DataError, IntegrityError

from robotouille.certification.spawning import spawn_context
from robotouille.errors import RecordingError
from robotouille_data.database import database_errors, writing_engine
from robotouille_data.errors import UnavailableError
from robotouille_data.recordings.reading import (
    content_digest,
    episode_id,
    read_content,
    recorded_rows,
)
from robotouille_data.store import (
    ReadFile,
    Stamp,
    forget,
    known_files,
    lacking_steps_to_go,
    store,
)
from robotouille_data.versions import migrate

__all__ = ["Indexed", "Progress", "has_recordings", "index"]

SUFFIX, UNFINISHED = ".rbt", ".rbt.part"
FILES_AT_ONCE = 50
"""Files in one transaction: a database that goes away costs so many."""
MAX_BYTES = 4 * 1024 * 1024
"""Bytes of files in one transaction, unless it is a single one."""
MAX_FAULT = 500
UNFIT = (RecordingError, DataError, IntegrityError, OverflowError, UnicodeError)
"""What a recording is to blame for, if it is what cannot be written."""

Progress = Callable[[int, int], None]
"""Is told how many files are done, and how many there are to do."""
File = tuple[str, Stamp]


@dataclass(slots=True)
class Indexed:
    """What became of an index: how many files were read, had not changed, are gone, or are
    unfinished and were left out; and the faults of files that are no episodes of it, by path."""

    indexed: int = 0
    unchanged: int = 0
    forgotten: int = 0
    unfinished: int = 0
    faults: dict[str, str] = field(default_factory=dict)


def index(
    url: URL,
    folders: Sequence[Path],
    *,
    jobs: int = 1,
    unfinished: bool = False,
    anew: bool = False,
    steps_to_go: bool = False,
    progress: Progress = lambda done, total: None,
) -> Indexed:
    """Read what is new or has changed below some folders, and forget what is gone.

    Args:
        url: Of the database.
        jobs: Processes that read.
        unfinished: Also those recordings that have no end yet; those of them that the catalogue
            has already are kept up to date anyway.
        anew: Also those that have not changed.
        steps_to_go: Also how far from the goal episodes ended, which takes a search; of those, too,
            that have not changed and of which it is not known.
        progress: Is called when some more are done.

    Raises:
        UnavailableError: The database cannot be written now, or a folder not read; what was
            written before stays.
        CatalogueError: The catalogue is of a later version.
    """
    result, found = Indexed(), dict[str, Stamp]()
    roots = [str(folder.absolute()) for folder in folders]
    for root in roots:
        for path, stamp in _recordings(root):
            if not _is_text(path):
                result.faults[path] = "its name is not UTF-8, and no database takes it"
            else:
                found[path] = stamp
    known, lacking = _prepare(url, roots, found, result)
    if not unfinished:
        left_out = {p for p in found if p.endswith(UNFINISHED) and p not in known}
        found = {path: stamp for path, stamp in found.items() if path not in left_out}
        result.unfinished = len(left_out)
    if steps_to_go:
        known = {path: stamp for path, stamp in known.items() if path not in lacking}
    changed = [(p, s) for p, s in sorted(found.items()) if anew or known.get(p) != s]
    result.unchanged = len(found) - len(changed)
    done = 0
    progress(done, len(changed))
    for count, faults in _read_all(url, changed, jobs, steps_to_go):
        result.indexed += count - len(faults)
        result.faults |= faults
        done += count
        progress(done, len(changed))
    return result


def has_recordings(folder: Path) -> bool:
    """Whether there is any recording below a folder, unfinished ones included.

    Raises:
        UnavailableError: The folder cannot be read.
    """
    return any(True for _ in _recordings(str(folder.absolute())))


def _recordings(root: str) -> Iterator[File]:
    """The recordings below a folder; links are not followed."""

    def fail(error: OSError) -> None:
        raise UnavailableError(f"{error.filename}: cannot be read: {error.strerror}") from None

    for folder, _, names in os.walk(root, onerror=fail):
        names_here = set(names)
        for name in names:
            whole = name.removesuffix(".part")
            if not name.endswith((SUFFIX, UNFINISHED)) or (whole != name and whole in names_here):
                continue
            path = Path(folder, name)
            try:
                status = path.lstat()
            except FileNotFoundError:  # It has just been closed, and has another name.
                continue
            if stat.S_ISREG(status.st_mode):
                yield str(path), Stamp(status.st_size, status.st_mtime_ns)


def _is_text(path: str) -> bool:
    try:
        path.encode()
    except UnicodeEncodeError:  # Bytes of its name are kept as halves of surrogate pairs.
        return False
    return True


def _prepare(
    url: URL, roots: Sequence[str], found: Mapping[str, Stamp], result: Indexed
) -> tuple[dict[str, Stamp], set[str]]:
    """Migrate the catalogue and forget what is gone; what it knows of the rest, and of which it
    lacks steps to go."""
    engine, known = writing_engine(url), dict[str, Stamp]()
    with database_errors(url), engine.begin() as connection:
        migrate(connection)
        for root in roots:
            known |= known_files(connection, root)
        gone = known.keys() - found.keys()
        forget(connection, gone)
        lacking = lacking_steps_to_go(connection)
    result.forgotten = len(gone)
    return known, lacking


def _read_all(
    url: URL, files: Sequence[File], jobs: int, steps_to_go: bool
) -> Iterator[tuple[int, dict[str, str]]]:
    """How many files were done, and their faults, in pieces."""
    pieces = list(_pieces(files))
    text = url.render_as_string(hide_password=False)
    if min(jobs, len(pieces)) < 2:
        for piece in pieces:
            yield len(piece), _index_files(text, piece, steps_to_go)
        return
    with ProcessPoolExecutor(jobs, spawn_context(), _begin_reading) as pool:
        try:
            futures = {
                pool.submit(_index_files, text, piece, steps_to_go): len(piece) for piece in pieces
            }
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            raise UnavailableError("a process that read recordings was killed") from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _begin_reading() -> None:
    """Ctrl+C is for the parent. Rows and frames have no cycles, and looking for some among tens of
    thousands of new tuples again and again takes a third of the time."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()


def _pieces(files: Sequence[File]) -> Iterator[list[File]]:
    """Files that are read and written together."""
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


# In the processes that read


@cache
def _engine(url: str) -> Engine:
    return writing_engine(make_url(url))


def _index_files(url: str, files: Sequence[File], steps_to_go: bool) -> dict[str, str]:
    """Read some files and write their rows; the faults of those that have none."""
    faults: dict[str, str] = {}
    read = [each for file in files if (each := _read(*file, faults, steps_to_go))]
    engine = _engine(url)
    with database_errors(engine.url):
        try:
            with engine.begin() as connection:
                store(connection, read)
        except UNFIT:  # Maybe a long one is damaged far behind: which one, is seen one by one.
            for each in read:
                _store_alone(engine, each, faults, steps_to_go)
    return faults | {each.path: each.fault for each in read if each.fault}


def _store_alone(engine: Engine, file: ReadFile, faults: dict[str, str], steps_to_go: bool) -> None:
    again = _read(file.path, file.stamp, faults, steps_to_go)
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


def _read(path: str, stamp: Stamp, faults: dict[str, str], steps_to_go: bool) -> ReadFile | None:
    """A recording, with its rows or its fault; None if it cannot be read now.

    Of a short one all is known then; a long one is read on as it is written.
    """
    digest = ""
    try:
        content = read_content(Path(path))
        digest = content_digest(content)
        parts = recorded_rows(content, episode_id(digest), steps_to_go=steps_to_go)
        beginning = [part for _, part in zip(range(2), parts, strict=False)]
    except RecordingError as error:
        return ReadFile(path, stamp, digest, _fault(error))
    except FileNotFoundError:
        return None
    except OSError as error:
        faults[path] = f"cannot be read: {error.strerror or error}"
        return None
    return ReadFile(path, stamp, digest, parts=chain(beginning, parts))


def _fault(error: Exception) -> str:
    why = error.orig if isinstance(error, DataError | IntegrityError) else error
    return str(why).replace("\0", "\N{REPLACEMENT CHARACTER}")[:MAX_FAULT]
