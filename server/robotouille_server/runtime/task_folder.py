"""Folder of the operator's own tasks: problem files, with their renderings and pictures.

The server reads and checks all files when it starts. Clients receive the domain with the task, and
the rendering and pictures on request.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.json_files import read_json
from robotouille.domain.loading import PROBLEM_KEYS, load_task, task_names
from robotouille.domain.pictures import (
    PictureError,
    picture_digest,
    plain_picture,
    read_picture,
)
from robotouille.domain.rendering import rendering_of
from robotouille.domain.task import Task, Timing
from robotouille.errors import FileError, RobotouilleError
from robotouille.installation import data_folder
from robotouille.terminal import printable
from robotouille.world.lint import sound_task

MAX_FILES = 2_000
"""Files in the folder and its subfolders."""
MAX_TOTAL_BYTES = 32 * 1024 * 1024
"""Total size of all pictures."""
MAX_FAULTS = 20
"""Faults listed in an error."""


class TaskFolderError(RobotouilleError):
    """The folder of tasks cannot be served."""


@dataclass(frozen=True, slots=True)
class TaskAssets:
    """Rendering, key bindings and pictures of a task.

    Attributes:
        rendering: The rendering as a JSON value.
        bindings: The key bindings as a JSON value.
        pictures: The digests of pictures that are not shipped, by their names in the rendering.
    """

    rendering: Mapping[str, Any]
    bindings: Mapping[str, Any]
    pictures: Mapping[str, str]


class TaskFolder:
    """Tasks of a folder; empty without one."""

    def __init__(
        self,
        paths: Mapping[str, Path] | None = None,
        assets: Mapping[str, TaskAssets] | None = None,
        pictures: Mapping[str, bytes] | None = None,
        digests: Mapping[str, str] | None = None,
    ) -> None:
        self._paths = dict(paths or {})
        self._assets = dict(assets or {})
        self._pictures = dict(pictures or {})
        self._digests = dict(digests or {})

    @property
    def digest(self) -> str:
        """Digest of the names and contents of all tasks; empty without tasks."""
        if not self._digests:
            return ""
        return hashlib.sha256(repr(sorted(self._digests.items())).encode()).hexdigest()[:16]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the tasks."""
        return tuple(self._paths)

    def load(self, name: str, seats: int | None, timing: Timing, seed: int) -> Task | None:
        """Load a task by its name, with `@N` for N seats; return None if it is not in the folder.

        Raises:
            FileError: As `load_task`.
        """
        base, _, count = name.partition("@")
        path = self._paths.get(base)
        if path is None:
            return None
        return _loaded(f"{path}@{count}" if count else str(path), seats, timing, seed)

    def assets(self, name: str) -> TaskAssets | None:
        """Return the rendering and pictures of a task; None if it is not in the folder."""
        return self._assets.get(name)

    def picture(self, digest: str) -> bytes:
        """Return a picture by its digest; raise KeyError if it does not exist."""
        return self._pictures[digest]


@lru_cache(maxsize=256)
def _loaded(name: str, seats: int | None, timing: Timing, seed: int) -> Task:
    return load_task(name, seats=seats, timing=timing, seed=seed)


def read_task_folder(folder: Path) -> TaskFolder:
    """Read and check all tasks of a folder.

    Raises:
        TaskFolderError: The folder does not exist, has too many files or links that lead out of
            it, or contains invalid files. The error lists all faults.
    """
    # `Path.is_dir` raises if the path is too long.
    if not os.path.isdir(folder):  # noqa: PTH112
        raise TaskFolderError(printable(f"--tasks {folder}: the folder does not exist"))
    faults = list(_links_outside(folder))
    if faults:
        raise _refused(folder, faults)
    reading = _Reading()
    for path in sorted(folder.glob("*.json")):
        try:
            raw = read_json(path)
            if isinstance(raw, dict) and raw.keys() & PROBLEM_KEYS:
                reading.add(path)
        except FileError as error:
            faults += [f"{Path(error.file).name}: {fault}" for fault in error.faults]
        except (PictureError, TaskFolderError) as error:
            faults.append(str(error))
    if not faults and not reading.paths:
        faults.append("the folder has no problem file")
    if faults:
        raise _refused(folder, faults)
    return TaskFolder(reading.paths, reading.assets, reading.pictures, reading.digests)


def _refused(folder: Path, faults: list[str]) -> TaskFolderError:
    more = [f"… and {len(faults) - MAX_FAULTS} more"] if len(faults) > MAX_FAULTS else []
    # Files of other people may have any name.
    lines = [f"--tasks {folder}:", *faults[:MAX_FAULTS], *more]
    return TaskFolderError("\n  ".join(map(printable, lines)))


def _links_outside(folder: Path) -> Iterator[str]:
    """Yield the links that lead out of a folder; raise TaskFolderError if it has too many files.

    A link could let a client download files that the operator did not mean to serve.
    """
    whole, count = folder.resolve(), 0
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            count += 1
            if count > MAX_FILES:
                raise TaskFolderError(printable(f"--tasks {folder}: more than {MAX_FILES:,} files"))
            path = Path(place, name)
            if path.is_symlink() and not path.resolve().is_relative_to(whole):
                yield f"{path.relative_to(folder)}: a link that leads out of the folder"


class _Reading:
    """Content of a folder that has been read so far."""

    def __init__(self) -> None:
        self.paths: dict[str, Path] = {}
        self.assets: dict[str, TaskAssets] = {}
        self.pictures: dict[str, bytes] = {}
        self.digests: dict[str, str] = {}

    def add(self, path: Path) -> None:
        """Read a task."""
        name = path.stem
        if name in task_names() or len(name) > 64:
            raise TaskFolderError(f"{path.name}: the name is too long, or a shipped task has it")
        task = sound_task(load_task(str(path)))
        self.paths[name] = path
        self.digests[name] = task.digest
        self.assets[name] = self._read_assets(task)

    def _read_assets(self, task: Task) -> TaskAssets:
        rendering = rendering_of(task)
        pictures = {}
        for file in sorted(rendering.files()):
            found = next(
                (f / file for f in rendering.folders(task.folder) if (f / file).is_file()), None
            )
            if found is None or found.is_relative_to(data_folder("assets")):
                continue
            pictures[file] = self._picture(found)
        return TaskAssets(
            rendering.model_dump(mode="json", by_alias=True, exclude_defaults=True),
            bindings_of(task).model_dump(mode="json", by_alias=True, exclude_defaults=True),
            pictures,
        )

    def _picture(self, path: Path) -> str:
        try:
            content = plain_picture(path.name, read_picture(path))
        except (OSError, PictureError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise PictureError(f"{path.parent.name}/{path.name}: {why}") from None
        digest = picture_digest(content)
        self.pictures[digest] = content
        if sum(map(len, self.pictures.values())) > MAX_TOTAL_BYTES:
            raise TaskFolderError(f"the pictures have more than {MAX_TOTAL_BYTES:,} bytes")
        return digest
