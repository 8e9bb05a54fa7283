"""Errors and warnings that Python and libraries would print to stderr.

They would not have the format of the log, and no limit: without file descriptors, the event loop
reports hundreds of errors per second, with tracebacks.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import logging
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, Protocol

from robotouille_server.runtime.logs import get_logger

LINE_SECONDS = 10.0
"""Minimum seconds between two similar lines."""
MAX_LINES = 100
"""Maximum number of lines in `LINE_SECONDS`."""
_VARIABLE = re.compile("[0-9][0-9a-f]*")
"""Numbers and addresses of objects, which do not distinguish lines."""


class Suppressed(Protocol):
    """Counter of suppressed lines."""

    log_suppressed: int


class _Line(NamedTuple):
    source: str
    message: str
    error: BaseException | None = None
    level: int = logging.ERROR


class StrayErrors:
    """Logs errors that no code handles, similar ones only now and then.

    Args:
        now: Returns the event loop's time.
        counts: Counts suppressed lines.
    """

    def __init__(self, now: Callable[[], float], counts: Suppressed) -> None:
        self._now = now
        self._counts = counts
        # The kind that was logged longest ago comes first.
        self._logged: dict[str, tuple[float, int]] = {}

    @contextmanager
    def logged(self, loop: asyncio.AbstractEventLoop) -> Iterator[None]:
        """Log the errors of the event loop, threads, destructors and libraries, and warnings."""

        def later(source: str, message: str, error: BaseException | None) -> None:
            # A destructor may run while its thread writes to the log and holds the log's lock.
            loop.call_soon_threadsafe(self._log, _Line(source, message, error))

        def unraisable(found: sys.UnraisableHookArgs) -> None:
            # The object may be half destroyed, so it is neither kept nor shown.
            place = found.object if inspect.isroutine(found.object) else type(found.object)
            message = f"{found.err_msg or 'Exception ignored in'}: {place.__qualname__}"
            later("destructor or callback", message, found.exc_value)

        def failed(thread: threading.ExceptHookArgs) -> None:
            if thread.exc_type is not SystemExit:
                later("thread", thread.thread.name if thread.thread else "", thread.exc_value)

        records = _LogRecords(lambda line: loop.call_soon_threadsafe(self._log, line))
        before = sys.unraisablehook, threading.excepthook, loop.get_exception_handler()
        sys.unraisablehook, threading.excepthook = unraisable, failed
        loop.set_exception_handler(self.handle)
        logging.getLogger().addHandler(records)
        logging.captureWarnings(True)
        try:
            yield
        finally:
            logging.captureWarnings(False)
            logging.getLogger().removeHandler(records)
            sys.unraisablehook, threading.excepthook = before[:2]
            loop.set_exception_handler(before[2])

    def handle(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Handle an error of the event loop; see `loop.set_exception_handler`."""
        self._log(_Line("event loop", str(context.get("message", "")), context.get("exception")))

    def _log(self, line: _Line) -> None:
        kind = _VARIABLE.sub("", f"{line.source} {line.message} {type(line.error).__name__}")
        logged, since = self._logged.get(kind, (-LINE_SECONDS, 0))
        if not self._may_log(kind, logged):
            self._counts.log_suppressed += 1
            if kind in self._logged:
                self._logged[kind] = logged, since + 1
            return
        self._logged.pop(kind, None)
        self._logged[kind] = self._now(), 0
        more: dict[str, Any] = {"error": repr(line.error)} if line.error is not None else {}
        if not isinstance(line.error, OSError):
            more["exc_info"] = line.error
        # If stderr is closed, an error here would be one more error of the event loop.
        with contextlib.suppress(OSError, ValueError):
            get_logger().log(line.level, line.source, message=line.message, repeated=since, **more)

    def _may_log(self, kind: str, logged: float) -> bool:
        if self._now() - logged < LINE_SECONDS:
            return False
        if kind not in self._logged and len(self._logged) >= MAX_LINES:
            oldest = next(iter(self._logged))
            if self._now() - self._logged[oldest][0] < LINE_SECONDS:
                return False
            del self._logged[oldest]
        return True


class _LogRecords(logging.Handler):
    """Handler of the standard library's log, which some libraries use."""

    def __init__(self, log: Callable[[_Line], object]) -> None:
        super().__init__(logging.WARNING)
        self._pass_on = log

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        try:
            message = record.getMessage().strip()
        except (TypeError, ValueError):  # The arguments do not match.
            message = str(record.msg)
        self._pass_on(_Line(record.name, message, error, record.levelno))
