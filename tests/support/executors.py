"""Executors for tests in virtual time."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from typing import Any

__all__ = ["ImmediateExecutor"]


class ImmediateExecutor(Executor):
    """Executor that runs each call immediately, so that virtual time stands still."""

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as failure:
            future.set_exception(failure)
        return future
