"""Kernels run as plain Python in tests, which are over before they would be compiled; the tests
of the compiled ones start processes of their own. A test that starts a process says so."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import settings

from tests.support.thorough import FACTOR

os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
# A shell starts what runs in the background with interrupts ignored, and programs inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("scaled", max_examples=max(1, int(100 * FACTOR)))
settings.load_profile("scaled")

_started: list[str] = []
"""The programs that the running test has started."""


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "subprocess.Popen":
        _started.append(str(arguments[0]))


sys.addaudithook(_watch)


def pytest_collection_finish() -> None:
    """What was collected stays: the garbage collector need not look at it again."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    _started.clear()
    outcome = yield
    if _started and item.get_closest_marker("process") is None:
        pytest.fail(f"starts {_started[0]} and is not marked as `process`")
    return outcome
