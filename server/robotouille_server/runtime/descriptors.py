"""File descriptors: each connection has one, and each episode that is recorded.

The operating system gives the lowest number that is free. So the number of a new connection's
socket says how many there are, whatever they are for.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
from pathlib import Path

from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.settings import ServerSettings

__all__ = ["RESERVED", "few_left", "in_use", "limit", "raise_limit", "reserve"]

RESERVED = 256
"""Descriptors that connections leave to recordings, the operator's port and files; of a limit that
is small, an eighth."""
UNLIMITED = sys.maxsize
OPEN = "/proc/self/fd"
"""Its size is the number of open descriptors (Linux 6.2 and later; before, 0)."""


def limit() -> int:
    """How many this process may have."""
    if sys.platform == "win32":
        return UNLIMITED
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return UNLIMITED if soft == resource.RLIM_INFINITY else soft


def in_use() -> int | None:
    """How many this process has open; None where nobody can say.

    They are never listed: of 20,000 that takes longer than a game's step may be late. Where the
    system does not say how many there are, it is the lowest number that is free: so many are open
    at least, and more where a lower one was closed just now. For an alert that is good enough:
    newcomers are refused by the same number.
    """
    if sys.platform == "win32":
        return None
    try:
        reported = Path(OPEN).stat().st_size
    except OSError:
        reported = 0
    return reported or _lowest_free()


def _lowest_free() -> int:
    try:
        number = os.open(os.devnull, os.O_RDONLY)
    except OSError:
        return limit()
    os.close(number)
    return number


def reserve() -> int:
    """How many connections leave free."""
    return min(RESERVED, limit() // 8)


def raise_limit(settings: ServerSettings) -> None:
    """Have as many as this process may, and say so where the settings need more.

    It is a warning where others can connect: on one machine alone so many do not come.
    """
    if sys.platform == "win32":
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        except (OSError, ValueError):  # macOS has a limit below the one it tells.
            get_logger().debug("descriptors not raised", soft=soft, hard=hard)
    needed = settings.max_connections + settings.max_episodes + RESERVED
    if limit() < needed:
        alone = settings.is_local and not settings.trust_proxy
        level = logging.DEBUG if alone else logging.WARNING
        get_logger().log(
            level,
            "fewer file descriptors than the settings need; newcomers are refused before they run "
            "out. Raise the limit (ulimit -Hn, LimitNOFILE=), or lower --max-connections",
            limit=limit(),
            needed=needed,
        )


def few_left(newcomer: socket.socket | None) -> bool:
    """Whether a new connection has one of those that are kept free."""
    return newcomer is not None and newcomer.fileno() >= limit() - reserve()
