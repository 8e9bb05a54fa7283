"""Errors that no code handles are lines of the log, and few."""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
import warnings
from collections.abc import Callable, Iterator

import pytest
from structlog.testing import capture_logs

from robotouille_server.runtime.logs import configure_logs
from robotouille_server.runtime.stray_errors import LINE_SECONDS, MAX_LINES, StrayErrors
from tests.support.virtual_time import virtual


class Counts:
    log_suppressed = 0


def test_equal_errors_are_logged_rarely() -> None:
    now, counts = 0.0, Counts()
    errors = StrayErrors(lambda: now, counts)
    loop = asyncio.new_event_loop()
    context = {"message": "socket.accept() out of system resource", "exception": OSError(24, "x")}
    with capture_logs() as lines:
        for _ in range(1000):
            errors.handle(loop, context)
        errors.handle(loop, {"message": "another", "exception": ValueError("y")})
        assert [line["message"] for line in lines] == [context["message"], "another"]
        assert counts.log_suppressed == 999
        now += LINE_SECONDS
        errors.handle(loop, context)
    assert lines[-1]["repeated"] == 999
    loop.close()


def test_flood_of_different_errors_is_limited() -> None:
    now, counts = 0.0, Counts()
    errors = StrayErrors(lambda: now, counts)
    loop = asyncio.new_event_loop()
    with capture_logs() as lines:
        for number in range(2 * MAX_LINES):
            errors.handle(loop, {"message": "x" * number})
        for number in range(1000):
            errors.handle(loop, {"message": f"Exception in <function f at 0x7f8e60ee{number:04x}>"})
        assert len(lines) == MAX_LINES
        now += LINE_SECONDS
        errors.handle(loop, {"message": "y"})
        assert lines[-1]["message"] == "y"
    assert counts.log_suppressed == MAX_LINES + 1000
    loop.close()


@pytest.fixture
def _warnings_in_the_log() -> Iterator[None]:
    configure_logs("warning", "console")
    yield
    configure_logs("error", "console")


class Fragile:
    def __del__(self) -> None:
        raise ValueError("in a destructor")


def fail() -> None:
    raise ValueError("in a thread")


def fail_in_a_thread() -> None:
    thread = threading.Thread(target=fail, name="fragile")
    thread.start()
    thread.join()


def warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.warn("in a library", stacklevel=1)


@pytest.mark.parametrize(
    ("cause", "source", "words"),
    [
        (Fragile, "destructor or callback", "ValueError('in a destructor')"),
        (fail_in_a_thread, "thread", "ValueError('in a thread')"),
        (warn, "py.warnings", "UserWarning: in a library"),
        (lambda: logging.getLogger("lib").error("failed: %s", "x"), "lib", "failed: x"),
    ],
    ids=["destructor", "thread", "warning", "log"],
)
@pytest.mark.usefixtures("_warnings_in_the_log")
@virtual
async def test_error_that_no_code_handles_is_a_line_of_the_log(
    cause: Callable[[], object], source: str, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    loop, counts = asyncio.get_running_loop(), Counts()
    hooks = sys.unraisablehook, threading.excepthook, warnings.showwarning
    with capture_logs() as lines, StrayErrors(loop.time, counts).logged(loop):
        for _ in range(3):
            cause()
        await asyncio.sleep(0)
    (line,) = lines
    assert line["event"] == source
    assert words in f"{line['message']} {line.get('error')}"
    assert counts.log_suppressed == 2
    assert capfd.readouterr().err == ""
    assert hooks == (sys.unraisablehook, threading.excepthook, warnings.showwarning)
