"""Kernels run as plain Python in tests, which are over before they would be compiled; the tests
of the compiled ones start processes of their own. A test that starts a process says so."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
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

_BEGAN = time.monotonic()
_SECONDS = float(os.environ.get("ROBOTOUILLE_TEST_SECONDS", "inf"))
"""Tests that would begin later than this are skipped."""

_started: list[str] = []
"""The programs that the running test has started."""


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "subprocess.Popen":
        _started.append(str(arguments[0]))


sys.addaudithook(_watch)


class _Freezer:
    """Keeps the garbage collector from looking at what stays: all that tests have loaded.

    A server looks at everything when it starts, and in the end it gives back all that was frozen,
    so that the next one would look at a million objects.
    """

    full_collections = 0

    def freeze(self) -> None:
        gc.freeze()
        self.full_collections = gc.get_stats()[2]["collections"]

    def freeze_again(self) -> None:
        """Once somebody has looked at everything."""
        if gc.get_stats()[2]["collections"] != self.full_collections:
            gc.collect(1)
            self.freeze()


_freezer = _Freezer()


def pytest_collection_finish() -> None:
    gc.collect()
    _freezer.freeze()


def pytest_runtest_setup() -> None:
    _freezer.freeze_again()
    if time.monotonic() - _BEGAN > _SECONDS:
        pytest.skip(f"begins more than ROBOTOUILLE_TEST_SECONDS={_SECONDS:g} after the first")


def pytest_sessionfinish() -> None:
    """Whatever was not closed is told after all."""
    gc.unfreeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    _started.clear()
    outcome = yield
    if _started and item.get_closest_marker("process") is None:
        pytest.fail(f"starts {_started[0]} and is not marked as `process`")
    return outcome
