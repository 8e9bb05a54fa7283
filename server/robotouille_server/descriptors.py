"""File descriptors: each connection has one, and each episode that is recorded.

The operating system gives the lowest number that is free. So the number of a new connection's
socket says how many there are, whatever they are for.
"""

from __future__ import annotations

import socket
import sys

from robotouille_server.logs import get_logger
from robotouille_server.settings import ServerSettings

__all__ = ["RESERVED", "few_left", "limit", "raise_limit", "reserve"]

RESERVED = 256
"""Descriptors that connections leave to recordings, the operator's port and files; of a limit that
is small, an eighth."""
UNLIMITED = sys.maxsize


def limit() -> int:
    """How many this process may have."""
    if sys.platform == "win32":
        return UNLIMITED
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return UNLIMITED if soft == resource.RLIM_INFINITY else soft


def reserve() -> int:
    """How many connections leave free."""
    return min(RESERVED, limit() // 8)


def raise_limit(settings: ServerSettings) -> None:
    """Have as many as this process may, and say so where the settings need more."""
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
        get_logger().warning(
            "fewer file descriptors than the settings need; newcomers are refused before they run "
            "out. Raise the limit (ulimit -Hn, LimitNOFILE=), or lower --max-connections",
            limit=limit(),
            needed=needed,
        )


def few_left(newcomer: socket.socket | None) -> bool:
    """Whether a new connection has one of those that are kept free."""
    return newcomer is not None and newcomer.fileno() >= limit() - reserve()
