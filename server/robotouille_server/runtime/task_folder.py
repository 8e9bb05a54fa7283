"""The operator's own tasks: a folder of problem files, by name, with what they look like.

All is read and checked when the server starts. A client is sent the domain with the task, and the
rendering and pictures when it asks for them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from robotouille.domain.files import read_json
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.loading import PROBLEM_KEYS, load_task, task_names
from robotouille.domain.pictures import PictureError, picture_digest, plain_picture
from robotouille.domain.rendering import rendering_of
from robotouille.domain.task import Task, Timing
from robotouille.errors import FileError, RobotouilleError
from robotouille.resources import data_folder
from robotouille.world.lint import sound_task

__all__ = ["Look", "TaskFolder", "TaskFolderError", "read_task_folder"]

MAX_FILES = 2_000
"""In the folder and all those in it."""
MAX_TOTAL_BYTES = 32 * 1024 * 1024
"""Of all pictures."""
MAX_TOLD = 20
"""Faults that are listed."""


class TaskFolderError(RobotouilleError):
    """A folder of tasks that cannot be served, and why."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a task looks like, and which keys its actions have.

    `rendering` and `bindings` are JSON values; `pictures` are the digests of pictures by the names
    that the rendering has for them, of those that are not shipped.
    """

    rendering: Mapping[str, Any]
    bindings: Mapping[str, Any]
    pictures: Mapping[str, str]


class TaskFolder:
    """The tasks of a folder. Without one there are none."""

    def __init__(
        self,
        paths: Mapping[str, Path] | None = None,
        looks: Mapping[str, Look] | None = None,
        pictures: Mapping[str, bytes] | None = None,
    ) -> None:
        self._paths = dict(paths or {})
        self._looks = dict(looks or {})
        self._pictures = dict(pictures or {})

    @property
    def names(self) -> tuple[str, ...]:
        """What its tasks are called."""
        return tuple(self._paths)

    def load(self, name: str, seats: int | None, timing: Timing, seed: int) -> Task | None:
        """A task by its name, with `@N` for N seats; None if there is none. FileError as
        `load_task` raises it."""
        base, _, count = name.partition("@")
        path = self._paths.get(base)
        if path is None:
            return None
        return _loaded(f"{path}@{count}" if count else str(path), seats, timing, seed)

    def look(self, name: str) -> Look | None:
        """What a task of this name looks like; None if it is not one of the folder's."""
        return self._looks.get(name)

    def picture(self, digest: str) -> bytes:
        """A picture that a `Look` names; KeyError if there is none."""
        return self._pictures[digest]


@lru_cache(maxsize=256)
def _loaded(name: str, seats: int | None, timing: Timing, seed: int) -> Task:
    return load_task(name, seats=seats, timing=timing, seed=seed)


def read_task_folder(folder: Path) -> TaskFolder:
    """Read and check all tasks of a folder.

    Raises:
        TaskFolderError: It is no folder, has too many files or a link that leads out of it, or a
            file in it is wrong: all faults are told.
    """
    if not folder.is_dir():
        raise TaskFolderError(f"--tasks {folder}: there is no such folder")
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
        faults.append("there is no problem file in it")
    if faults:
        raise _refused(folder, faults)
    return TaskFolder(reading.paths, reading.looks, reading.pictures)


def _refused(folder: Path, faults: list[str]) -> TaskFolderError:
    more = [f"… and {len(faults) - MAX_TOLD} more"] if len(faults) > MAX_TOLD else []
    return TaskFolderError("\n  ".join([f"--tasks {folder}:", *faults[:MAX_TOLD], *more]))


def _links_outside(folder: Path) -> Iterator[str]:
    """Links that lead out of a folder; TaskFolderError if there is too much in it."""
    whole, count = folder.resolve(), 0
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            count += 1
            if count > MAX_FILES:
                raise TaskFolderError(f"--tasks {folder}: has more than {MAX_FILES:,} files")
            path = Path(place, name)
            if path.is_symlink() and not path.resolve().is_relative_to(whole):
                yield f"{path.relative_to(folder)}: is a link that leads out of the folder"


class _Reading:
    """What has been read of a folder so far."""

    def __init__(self) -> None:
        self.paths: dict[str, Path] = {}
        self.looks: dict[str, Look] = {}
        self.pictures: dict[str, bytes] = {}

    def add(self, path: Path) -> None:
        """One more task."""
        name = path.stem
        if name in task_names() or len(name) > 64:
            raise TaskFolderError(f"{path.name}: a shipped task is called so, or it is too long")
        task = sound_task(load_task(str(path)))
        self.paths[name] = path
        self.looks[name] = self._look(task)

    def _look(self, task: Task) -> Look:
        rendering = rendering_of(task)
        pictures = {}
        for file in sorted(rendering.files()):
            found = next(
                (f / file for f in rendering.folders(task.folder) if (f / file).is_file()), None
            )
            if found is None or found.is_relative_to(data_folder("assets")):
                continue
            pictures[file] = self._picture(found)
        return Look(
            rendering.model_dump(mode="json", by_alias=True, exclude_defaults=True),
            bindings_of(task).model_dump(mode="json", by_alias=True, exclude_defaults=True),
            pictures,
        )

    def _picture(self, path: Path) -> str:
        try:
            content = plain_picture(path.name, path.read_bytes())
        except (OSError, PictureError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            raise PictureError(f"{path.parent.name}/{path.name}: {why}") from None
        digest = picture_digest(content)
        self.pictures[digest] = content
        if sum(map(len, self.pictures.values())) > MAX_TOTAL_BYTES:
            raise TaskFolderError(f"the pictures have more than {MAX_TOTAL_BYTES:,} bytes")
        return digest
