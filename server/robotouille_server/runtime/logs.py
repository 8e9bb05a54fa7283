"""Structured logs. Events of connections and episodes are logged; messages and steps are not."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Callable
from typing import Any, Protocol

import structlog

LINE_SECONDS = 10.0
"""Minimum seconds between two equal lines of the event loop."""
MAX_KINDS = 100


def configure_logs(level: str, log_format: str) -> None:
    """Log to stderr, in a format for people (`console`) or programs (`json`)."""
    renderer: Any = (
        structlog.processors.JSONRenderer()
        if log_format == "json"
        else structlog.dev.ConsoleRenderer(colors=False)
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(getattr(logging, level.upper())),
        logger_factory=structlog.WriteLoggerFactory(file=sys.stderr),
    )
    logging.getLogger("websockets").setLevel(logging.CRITICAL)


def get_logger() -> Any:
    return structlog.get_logger()


class Suppressed(Protocol):
    """Counter of suppressed lines."""

    log_suppressed: int


class LoopErrors:
    """Logs errors of the event loop, equal ones only now and then.

    Without file descriptors, the loop reports hundreds of errors per second, with tracebacks.
    """

    def __init__(self, now: Callable[[], float], counts: Suppressed) -> None:
        self._now = now
        self._counts = counts
        self._logged: dict[str, tuple[float, int]] = {}

    def handle(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Handle an error; see `loop.set_exception_handler`."""
        text, error = str(context.get("message", "")), context.get("exception")
        kind = f"{text} {type(error).__name__}"
        logged, since = self._logged.get(kind, (-LINE_SECONDS, 0))
        if self._now() - logged < LINE_SECONDS:
            self._logged[kind] = logged, since + 1
            self._counts.log_suppressed += 1
            return
        if len(self._logged) >= MAX_KINDS:
            self._logged.pop(next(iter(self._logged)))
        self._logged[kind] = self._now(), 0
        trace = None if isinstance(error, OSError) else error
        get_logger().error(
            "event loop", message=text, error=repr(error), repeated=since, exc_info=trace
        )
