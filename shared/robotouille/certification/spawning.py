"""Processes of `multiprocessing` that do not take libraries from the current folder."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess

__all__ = ["spawn_context"]

SAFE_PATH = "PYTHONSAFEPATH"
_changing = threading.Lock()


def spawn_context() -> SpawnContext:
    """The context "spawn", whose processes begin without the current folder among their libraries:
    a `socket.py` that lies there is not run."""
    if os.name == "posix":  # Else the first lock would start it.
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
    """What is started meanwhile has the variable; our environment is afterwards as it was."""
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
