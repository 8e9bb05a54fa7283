"""Look of a recorded game, which is not part of its recording."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from robotouille.domain.related_files import rendering_path
from robotouille.domain.task import Task
from robotouille.replay.recording import Recording


def choose_look(recording: Recording, folders: Iterable[Path]) -> None:
    """Use the rendering of the first folder that has one for the recording's domain.

    A game without a rendering there looks as if it had no folder.
    """
    for folder in folders:
        rendering = _rendering_in(folder, recording.task)
        if rendering is not None:
            recording.task = replace(recording.task, source=str(rendering))
            return


def _rendering_in(folder: Path, task: Task) -> Path | None:
    path = rendering_path(task.domain, folder)
    return path if path.parent == folder else None
