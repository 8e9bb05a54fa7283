"""Test configuration.

Search kernels run as plain Python, because most tests end before a kernel would be compiled. Tests
of the compiled kernels start their own processes. Tests that start a process need the marker
`process`.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.support.thorough import FACTOR

os.environ.setdefault("ROBOTOUILLE_COMPILE", "0")
_state = tempfile.TemporaryDirectory(prefix="robotouille-state-")
os.environ["XDG_STATE_HOME"] = _state.name
# Shells ignore interrupts in background jobs, and child processes inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("scaled", max_examples=max(1, int(100 * FACTOR)))
settings.load_profile("scaled")

_BEGAN = time.monotonic()
_SECONDS = float(os.environ.get("ROBOTOUILLE_TEST_SECONDS", "inf"))
"""Time limit in seconds; tests that would start later are skipped."""

_WORKER = os.environ.get("PYTEST_XDIST_WORKER", "")

_started: list[str] = []
"""Programs that the running test has started."""


_start_program = subprocess.Popen.__init__


def _watch(self: subprocess.Popen[Any], args: Any, *more: Any, **options: Any) -> None:
    program = args if isinstance(args, str | bytes | os.PathLike) else args[0]
    # With an empty font cache, matplotlib runs fc-list once, in whichever test plots first.
    if not str(program).endswith("fc-list"):
        _started.append(str(program))
    _start_program(self, args, *more, **options)


# An audit hook would be called a hundred times a millisecond.
subprocess.Popen.__init__ = _watch  # type: ignore[assignment]


class _Freezer:
    """Exempts everything loaded before the tests from garbage collection.

    A server runs a full collection on start and unfreezes all objects on stop. Without this class,
    the next server would scan a million objects.
    """

    full_collections = 0

    def freeze(self) -> None:
        gc.freeze()
        self.full_collections = gc.get_stats()[2]["collections"]

    def freeze_again(self) -> None:
        """Freeze again if a full collection has run since the last freeze."""
        if gc.get_stats()[2]["collections"] != self.full_collections:
            gc.collect(1)
            self.freeze()


_freezer = _Freezer()


gc.set_threshold(20_000, 20, 20)
# When it ends, Python would scan a million objects again, for two seconds.
atexit.register(gc.freeze)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let each worker begin with another folder. On a fresh clone, rewriting the assertions takes
    half of the collection's time, and a worker reads from the cache what another has rewritten.
    """
    report = yield
    if _WORKER and collector.path == Path(__file__).parent:
        workers = int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        first = len(report.result) * int(_WORKER.removeprefix("gw")) // workers
        report.result[:] = report.result[first:] + report.result[:first]
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give all workers the same order, which pytest-xdist requires."""
    if _WORKER:
        items.sort(key=lambda item: item.path)


def pytest_collection_finish() -> None:
    gc.collect()
    _freezer.freeze()


def pytest_runtest_setup() -> None:
    _freezer.freeze_again()
    if time.monotonic() - _BEGAN > _SECONDS:
        pytest.skip(f"starts after the limit of ROBOTOUILLE_TEST_SECONDS={_SECONDS:g}")


def pytest_sessionfinish() -> None:
    """Unfreeze, so that unclosed resources are still reported."""
    gc.unfreeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    _started.clear()
    outcome = yield
    if _started and item.get_closest_marker("process") is None:
        pytest.fail(f"starts {_started[0]}, but is not marked as `process`")
    return outcome
