"""Tasks and the files that define them: schemas, loading and checks."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.domain.loading import load_task, task_names
    from robotouille.domain.task import Task, Timing
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(__name__, "robotouille.domain.task", "robotouille.domain.loading")

__all__ = ["Task", "Timing", "load_task", "task_names"]
