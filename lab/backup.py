"""Save the data of a lab to one file, and restore it elsewhere.

    python lab/backup.py save BACKUP.tar
    python lab/backup.py restore BACKUP.tar

A backup contains recordings, the server's state (keys and audit log) and the catalogue. It can be
saved while episodes are running: recordings are append-only, so a copy is valid up to its last
complete frame. Only the owner can read the file, because it contains keys.

The script needs only Python. By default it reaches the database through Compose; with
`--database URL` it runs PostgreSQL's programs. `--database none` omits the database; the catalogue
can be rebuilt from the recordings.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[1]
MANIFEST = "manifest.json"
MAX_MANIFEST = 64 * 1024 * 1024
"""Limit on the size of a manifest, which has some 150 bytes for each file."""
DUMP = "catalogue.dump"
SUFFIXES = (".rbt", ".rbt.part")
COMPOSE = ("docker", "compose", "exec", "-T", "postgres")
USER = ("--username", "robotouille")
DUMPING = ("--format=custom", "--no-owner", "--no-privileges")
RESTORING = ("--clean", "--if-exists", "--no-owner", "--no-privileges", "--single-transaction")
BLOCK = 1 << 20
TELL_SECONDS = 2.0


class BackupError(Exception):
    """Failure to save or restore a backup. The message names the file, the fault and a remedy."""


@dataclass(frozen=True)
class Places:
    """Folders and database of a lab; `database` is `compose`, `none` or a URL."""

    recordings: Path
    state: Path
    database: str

    def folder(self, name: str) -> Path:
        """Return the folder of a part of the backup."""
        return {"recordings": self.recordings, "state": self.state}[name]


@dataclass
class _Archive:
    """Tar file being written, with the size and hash of each file in it."""

    tar: tarfile.TarFile
    files: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(self, name: str, source: IO[bytes]) -> None:
        """Add a file up to its current length, because the server may still append to it."""
        entry = tarfile.TarInfo(name)
        entry.size = os.fstat(source.fileno()).st_size
        entry.mtime = int(os.fstat(source.fileno()).st_mtime)
        entry.mode = 0o600
        reader = _Hashing(source)
        try:
            self.tar.addfile(entry, reader)  # type: ignore[arg-type]
        except OSError as error:
            if error.errno is not None:
                raise
            raise BackupError(f"{name} shrank while it was read; save again") from None
        self.files[name] = {"bytes": entry.size, "sha256": reader.digest.hexdigest()}


class _Hashing:
    """Reader that computes the SHA-256 of a file."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.digest = hashlib.sha256()

    def read(self, size: int) -> bytes:
        content = self._file.read(size)
        self.digest.update(content)
        return content


# Saving


def save(backup: Path, places: Places, progress: Callable[[int], None] = lambda count: None) -> int:
    """Write a backup atomically and return its number of files.

    Raises:
        BackupError: `backup` exists, or a file cannot be read or written.
    """
    for folder in (places.recordings, places.state):
        if not folder.is_dir():
            raise BackupError(f"no folder {folder}; set it with --recordings or --state")
    if backup.exists():
        raise BackupError(f"{backup} already exists; choose another name")
    new = backup.with_name(f".{backup.name}.{secrets.token_hex(4)}.new")
    try:
        descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            with tarfile.open(fileobj=file, mode="w") as tar:
                count = _write(_Archive(tar), places, backup.parent, progress)
            file.flush()
            os.fsync(file.fileno())
        os.link(new, backup)
    except OSError as error:
        raise BackupError(f"{error.filename or backup}: {error.strerror}") from None
    finally:
        new.unlink(missing_ok=True)
    return count


def _write(archive: _Archive, places: Places, beside: Path, progress: Callable[[int], None]) -> int:
    if places.database != "none":
        with tempfile.TemporaryFile(dir=beside) as dump:
            _postgresql(["pg_dump", *DUMPING], places.database, stdout=dump)
            dump.seek(0)
            archive.add(DUMP, dump)
    for name, path in _files(places.state):
        with path.open("rb") as file:
            archive.add(f"state/{name}", file)
    while _add_recordings(archive, places.recordings, progress):
        pass  # A recording is renamed when its episode ends, so look again.
    manifest = {"created": int(time.time()), "files": archive.files}
    with tempfile.TemporaryFile() as file:
        file.write(json.dumps(manifest, indent=1).encode())
        file.flush()
        file.seek(0)
        archive.add(MANIFEST, file)
    return len(archive.files) - 1


def _add_recordings(archive: _Archive, folder: Path, progress: Callable[[int], None]) -> bool:
    """Add recordings that are not in the backup; return whether one vanished before it was read."""
    gone = False
    for name, path in _files(folder):
        if not name.endswith(SUFFIXES) or f"recordings/{name}" in archive.files:
            continue
        try:
            with path.open("rb") as file:
                archive.add(f"recordings/{name}", file)
        except FileNotFoundError:
            gone = True
        progress(len(archive.files))
    return gone


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the files below a folder, except links and hidden temporary files."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.is_symlink() and not path.name.startswith("."):
            yield path.relative_to(folder).as_posix(), path


# Restoring


def restore(
    backup: Path, places: Places, progress: Callable[[int], None] = lambda count: None
) -> int:
    """Restore a backup to empty folders and the database; return the number of files.

    All files are checked before the first one is written.

    Raises:
        BackupError: The backup is damaged, a folder is not empty, or a file cannot be written.
    """
    for folder in (places.recordings, places.state):
        if folder.is_dir() and any(folder.iterdir()):
            raise BackupError(f"{folder} is not empty; restore to an empty folder")
    try:
        with tarfile.open(backup, mode="r:") as tar:
            manifest = _checked(tar)
            if places.database != "none" and DUMP in manifest:
                _restore_database(tar, places.database, backup.parent)
            for count, name in enumerate(_wanted(manifest)):
                _extract(tar, name, places)
                progress(count)
    except (tarfile.TarError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BackupError(f"{backup} is damaged or not a backup: {error}") from None
    except OSError as error:
        raise BackupError(f"{error.filename or backup}: {error.strerror}") from None
    return len(manifest)


def _checked(tar: tarfile.TarFile) -> Mapping[str, Any]:
    """Check every byte of a backup and return its manifest."""
    if tar.getmember(MANIFEST).size > MAX_MANIFEST:
        raise BackupError(f"{MANIFEST} is larger than {MAX_MANIFEST >> 20} MiB")
    manifest: dict[str, Any] = json.loads(_content(tar, MANIFEST).read())["files"]
    for name, known in manifest.items():
        if name != DUMP and not _has_place(name):
            raise BackupError(f"{name!r} is not a path in recordings or state")
        if _digest(_content(tar, name)) != known["sha256"]:
            raise BackupError(f"{name} is damaged")
    return manifest


def _has_place(name: str) -> bool:
    """Return whether a name is a normalized path below one of the two folders."""
    path = PurePosixPath(name)
    plain = str(path) == name and ".." not in path.parts and "\0" not in name
    return plain and len(path.parts) > 1 and path.parts[0] in ("recordings", "state")


def _wanted(manifest: Mapping[str, Any]) -> Iterator[str]:
    """Yield the files to restore. If an episode ended during `save`, skip its partial recording."""
    for name in manifest:
        ended = name.endswith(".part") and name.removesuffix(".part") in manifest
        if "/" in name and not ended:
            yield name


def _restore_database(tar: tarfile.TarFile, database: str, beside: Path) -> None:
    with tempfile.TemporaryFile(dir=beside) as dump:
        shutil.copyfileobj(_content(tar, DUMP), dump, BLOCK)
        dump.seek(0)
        _postgresql(["pg_restore", *RESTORING], database, stdin=dump)


def _content(tar: tarfile.TarFile, name: str) -> IO[bytes]:
    content = tar.extractfile(name)
    if content is None:
        raise BackupError(f"{name} is not a file")
    return content


def _digest(content: IO[bytes]) -> str:
    digest = hashlib.sha256()
    while block := content.read(BLOCK):
        digest.update(block)
    return digest.hexdigest()


def _extract(tar: tarfile.TarFile, name: str, places: Places) -> None:
    part, _, rest = name.partition("/")
    folder = places.folder(part)
    path = folder / rest
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        shutil.copyfileobj(_content(tar, name), file, BLOCK)
    if os.geteuid() == 0:
        owner = folder.stat()
        for each in (path, path.parent):
            os.chown(each, owner.st_uid, owner.st_gid)


# Both


def _postgresql(
    words: list[str],
    database: str,
    *,
    stdin: IO[bytes] | None = None,
    stdout: IO[bytes] | None = None,
) -> None:
    """Run one of PostgreSQL's programs, in its container or on this machine."""
    if database == "compose":
        command = [*COMPOSE, *words, *USER, "--dbname", "robotouille"]
    else:
        command = [*words, "--dbname", database]
    try:
        done = subprocess.run(  # noqa: S603
            command,
            stdin=stdin or subprocess.DEVNULL,
            stdout=stdout,
            stderr=subprocess.PIPE,
            cwd=ROOT,
            check=False,
        )
    except FileNotFoundError:
        raise BackupError(f"{command[0]} is not installed; try --database none") from None
    if done.returncode:
        raise BackupError(f"{words[0]}: {done.stderr.decode(errors='replace').strip()}")


@contextmanager
def _progress_lines() -> Iterator[Callable[[int], None]]:
    """Print the number of files to a terminal every two seconds."""
    last, shown = time.monotonic(), sys.stderr.isatty()

    def progress(count: int) -> None:
        nonlocal last
        if shown and time.monotonic() > last + TELL_SECONDS:
            last = time.monotonic()
            print(f"{count} files", file=sys.stderr)

    yield progress


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Save or restore the data of a lab.")
    parser.add_argument("what", choices=("save", "restore"))
    parser.add_argument("backup", type=Path, help="a tar file")
    parser.add_argument("--recordings", type=Path, default=ROOT / "lab/data/recordings")
    parser.add_argument("--state", type=Path, default=ROOT / "lab/data/recordings.state")
    parser.add_argument("--database", default="compose", help="compose, none, or postgresql://…")
    given = parser.parse_args()
    places = Places(given.recordings, given.state, given.database)
    try:
        with _progress_lines() as progress:
            count = {"save": save, "restore": restore}[given.what](given.backup, places, progress)
    except BackupError as error:
        sys.exit(str(error))
    print(f"{given.backup}: {count} files {given.what}d")


if __name__ == "__main__":
    main()
