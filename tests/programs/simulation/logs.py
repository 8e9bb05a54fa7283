"""Errors that the server logs instead of raising, which a simulation counts as faults."""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable, MutableMapping
from typing import Any

import structlog

__all__ = ["watch_logs"]

EXPECTED = (
    "recording failed",
    "recording not begun",
    "recording not closed",
    "recording not deleted",
    "episode not restored yet",
    "the node's report was not stored",
    "this node is cut off from NATS",
    "the cluster's buckets cannot be used",
    "streams or buckets of the cluster were deleted",
    "not written",
)
"""Messages that a server must log when the disk is full, or when NATS cannot be used or loses
buckets."""
LIBRARY_FAULTS = ("parser failed", "opening handshake failed", "unexpected internal")

_report: list[Callable[[str], None]] = []


def watch_logs(report: Callable[[str], None]) -> None:
    """Send logged errors to `report` instead of printing them."""
    _report[:] = [report]
    structlog.configure(
        processors=[structlog.processors.add_log_level, _take],
        wrapper_class=structlog.make_filtering_bound_logger(logging.ERROR),
        logger_factory=structlog.ReturnLoggerFactory(),
    )
    for name in ("websockets.server", "websockets.client", "asyncio"):
        logger = logging.getLogger(name)
        logger.setLevel(logging.ERROR)
        logger.propagate = False
        logger.handlers = [_Handler()]


def _take(logger: Any, method: str, event: MutableMapping[str, Any]) -> str:
    text = str(event.get("event"))
    if not text.startswith(EXPECTED):
        error = event.get("exc_info")
        trace = traceback.format_exc(limit=-4) if error else ""
        rest = {k: v for k, v in event.items() if k not in ("event", "exc_info", "level")}
        _report[0](f"logged: {text} {rest} {trace}")
    raise structlog.DropEvent


class _Handler(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if record.name == "asyncio" or text.startswith(LIBRARY_FAULTS):
            trace = ""
            if record.exc_info and record.exc_info[1] is not None:
                trace = "".join(traceback.format_exception(record.exc_info[1], limit=-4))
            _report[0](f"logged by {record.name}: {text} {trace}")
