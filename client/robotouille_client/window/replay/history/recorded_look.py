"""What the kitchen of a recording looks like, where its pictures are here.

A recording has the task, and not what it looks like: of a kitchen that is not shipped, that lies in
the folder of its files.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from robotouille.domain.companions import rendering_path
from robotouille.domain.task import Task
from robotouille.replay.recording import Recording, read_recording

__all__ = ["open_shown"]


def open_shown(path: Path, tasks: Path | None = None, *, damaged: bool = False) -> Recording:
    """A recording that looks as the files in `tasks` say; else those beside it, else those in the
    current folder. Of a kitchen that has none there, it looks as it would without a folder.

    Raises:
        RobotouilleError: It cannot be read.
    """
    recording = read_recording(path, damaged=damaged)
    folders = [path.parent, Path.cwd()]
    for folder in folders if tasks is None else [tasks, *folders]:
        rendering = _rendering_in(folder, recording.task)
        if rendering is not None:
            recording.task = replace(recording.task, source=str(rendering))
            break
    return recording


def _rendering_in(folder: Path, task: Task) -> Path | None:
    path = rendering_path(task.domain, folder)
    return path if path.parent == folder else None
