"""Logs of the server: structured lines on stderr, and the audit log of the operator page.

Events of connections and episodes are logged; messages and steps are not.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import structlog


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
    # It warns of each write to a client that has gone, which clients could use to fill the log.
    logging.getLogger("asyncio").setLevel(logging.ERROR)


def get_logger() -> Any:
    return structlog.get_logger()


MAX_AUDIT_BYTES = 8 * 1024 * 1024
"""Size at which a file is renamed and a new one is started."""
KEPT_FILES = 4
"""Number of renamed files that are kept; `.1` is the latest."""
_MODE = 0o600
_APPEND = (
    os.O_WRONLY
    | os.O_APPEND
    | os.O_CREAT
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_CLOEXEC", 0)
    # Opening or filling a named pipe without a reader would stop all episodes.
    | getattr(os, "O_NONBLOCK", 0)
)

Details = Mapping[str, str | int]
"""Further fields of a line."""


class AuditLog:
    """File in the state folder that records who used the operator page, and what they did there.

    Each line is a JSON object, and only the server's user may read the file. It is separate from
    the server's log, which may be turned off and which more people may read. Lines are rare, so the
    file is opened for each one and may be moved at any time.

    Args:
        path: The file.
        wall: Returns the time in seconds since 1970.

    Attributes:
        problem: The reason why the last line could not be written, or empty.
    """

    def __init__(self, path: Path, wall: Callable[[], float]) -> None:
        self.path = path
        self.problem = ""
        self._wall = wall

    def note(
        self,
        what: str,
        *,
        by: str,
        token: str = "",
        episode: str = "",
        result: str = "done",
        details: Details | None = None,
    ) -> None:
        """Write a line; if that fails, write it to the server's log.

        Args:
            what: The action.
            by: The subject of the operator's token.
            token: The id of the operator's token.
            episode: The id of the episode.
            result: `done`, or the code of a refusal.
            details: Further fields.
        """
        moment = datetime.fromtimestamp(self._wall(), UTC).isoformat(timespec="milliseconds")
        entry = {
            "time": moment.replace("+00:00", "Z"),
            "what": what,
            "by": by,
            "token": token,
            "episode": episode,
            **(details or {}),
            "result": result,
        }
        line = json.dumps({key: value for key, value in entry.items() if value != ""})
        try:
            self._append(line.encode() + b"\n")
        except OSError as error:
            self.problem = f"the audit log cannot be written: {error.strerror or error}"
            get_logger().error("audit log not written", file=str(self.path), line=line)
        else:
            self.problem = ""

    def _append(self, line: bytes) -> None:
        self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            if self.path.stat().st_size >= MAX_AUDIT_BYTES:
                self._put_aside()
        descriptor = os.open(self.path, _APPEND, _MODE)
        try:
            if sys.platform != "win32" and os.fstat(descriptor).st_mode & 0o077:
                os.fchmod(descriptor, _MODE)
            if os.write(descriptor, line) < len(line):
                raise OSError("only a part of the line was written")
        finally:
            os.close(descriptor)

    def _put_aside(self) -> None:
        """Rename `audit.log` to `audit.log.1`, that to `.2`, and so on; delete the last one."""
        names = [self.path, *(self._kept(number) for number in range(1, KEPT_FILES + 1))]
        for older, newer in zip(names[:0:-1], names[-2::-1], strict=True):
            with contextlib.suppress(FileNotFoundError):
                newer.replace(older)

    def _kept(self, number: int) -> Path:
        return self.path.with_name(f"{self.path.name}.{number}")
