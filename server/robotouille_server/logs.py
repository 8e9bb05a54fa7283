"""Structured logs: one line an event of a connection or an episode, none a message or a step."""

from __future__ import annotations

import logging
import sys
from typing import Any

import structlog

__all__ = ["configure_logs", "get_logger"]


def configure_logs(level: str, log_format: str) -> None:
    """Log at `level` and above, for people (`console`) or programs (`json`), to stderr."""
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
