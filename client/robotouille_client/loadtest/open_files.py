"""How many files, and so connections, a process may have open."""

from __future__ import annotations

from robotouille.errors import RobotouilleError

__all__ = ["TooFewFilesError", "allow_open_files"]

RESERVE = 64
"""Files that a process needs beside its connections."""


class TooFewFilesError(RobotouilleError):
    """The system's limit leaves no room for so many connections."""


def allow_open_files(connections: int) -> None:
    """Raise this process's own limit so that it, or a child, can hold these connections.

    TooFewFilesError where the system does not let it.
    """
    try:
        import resource
    except ImportError:
        return
    needed = connections + RESERVE
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        message = (
            f"{connections:,} connections in one process need {needed:,} open files, and at most "
            f"{hard:,} are allowed: more --processes, or a higher hard limit (ulimit -Hn)"
        )
        raise TooFewFilesError(message)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
    except (OSError, ValueError) as error:
        raise TooFewFilesError(f"the limit of open files stays at {soft:,}: {error}") from None
