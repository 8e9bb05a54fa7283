"""What a kitchen is made of: the schemas of its files, loading, checks, and the shipped tasks."""

from robotouille.domain.catalogue import load_task, task_names
from robotouille.domain.task import Task, Timing

__all__ = ["Task", "Timing", "load_task", "task_names"]
