"""Where stand-ins think in tests."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from typing import Any

__all__ = ["AtOnce"]


class AtOnce(Executor):
    """Thinks while time stands still."""

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> Future[Any]:
        thought: Future[Any] = Future()
        try:
            thought.set_result(function(*arguments, **options))
        except Exception as failure:
            thought.set_exception(failure)
        return thought
