"""Child processes that do not import modules from the current folder."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess

SAFE_PATH = "PYTHONSAFEPATH"
_changing = threading.Lock()


def spawn_context() -> SpawnContext:
    """Return a "spawn" context whose processes do not import from the current folder.

    A `socket.py` in the current folder is not executed.
    """
    if os.name == "posix":
        # Otherwise the first lock would start the resource tracker without the variable.
        with _safe_path():
            resource_tracker.ensure_running()
    return _Context()


class _Process(SpawnProcess):
    def start(self) -> None:
        with _safe_path():
            super().start()


class _Context(SpawnContext):
    Process = _Process


@contextmanager
def _safe_path() -> Iterator[None]:
    """Set the variable for processes started in the block, then restore the environment."""
    with _changing:
        before = os.environ.get(SAFE_PATH)
        os.environ[SAFE_PATH] = "1"
        try:
            yield
        finally:
            if before is None:
                del os.environ[SAFE_PATH]
            else:
                os.environ[SAFE_PATH] = before
