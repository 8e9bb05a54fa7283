"""What keeps somebody's own task from being used, told before anything is done with it."""

from __future__ import annotations

from robotouille.domain.task import Task
from robotouille.errors import FileError
from robotouille.resources import data_folder
from robotouille.world.lint.linting import lint_task

__all__ = ["sound_task"]


def sound_task(task: Task) -> Task:
    """The same task, if nothing is wrong with its file that lint calls an error.

    Shipped tasks are not looked at again, nor those that were not read from a file.

    Raises:
        FileError: Something is; the error has all of it.
    """
    if task.folder is None or task.folder.resolve().is_relative_to(data_folder("problems")):
        return task
    errors = [fault for fault in lint_task(task) if fault.severity == "error"]
    if errors:
        raise FileError(task.source, errors)
    return task
