"""Limits of a process: file descriptors and garbage collection.

Each connection and each recorded episode has a file descriptor. The operating system assigns the
lowest free number, so the number of a new connection's socket shows how many descriptors are in
use.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import socket
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.settings import ServerSettings

NEW = 10_000
"""New objects after which Python collects the youngest generation, which is quick."""
MANY = 5
"""Number of young-generation collections between two of the middle generation.

At 100, a collection took half a second after many episodes had been opened and closed."""
NEVER = 1_000_000

CHECK_SECONDS = 1.0
CLOSED_AT_LEAST = 300
"""Minimum number of closed connections and rooms before a collection. A TLS connection that ends
before its handshake may leave 300 KiB of garbage."""
SHARE = 1 / 200
"""Maximum share of the processor's time for full collections."""


@asynccontextmanager
async def rare_collections(
    live: Callable[[], int], closed: Callable[[], int]
) -> AsyncIterator[None]:
    """Return a context in which full garbage collections are rare.

    A full collection with thousands of rooms stops the server for longer than a step may be late.
    It therefore runs only after half as many connections and rooms were closed as exist. Objects
    that exist at the start, mainly modules, are never examined. Clients that connect and disconnect
    all the time leave young objects, which the cheaper collections free.

    Args:
        live: Returns the number of connections and rooms.
        closed: Returns the number of connections and rooms that were ever closed.
    """
    collecting = asyncio.create_task(_collect(live, closed))
    try:
        yield
    finally:
        collecting.cancel()
        await asyncio.wait({collecting})


async def _collect(live: Callable[[], int], closed: Callable[[], int]) -> None:
    usual, now = gc.get_threshold(), asyncio.get_running_loop().time
    gc.set_threshold(NEW, MANY, NEVER)
    try:
        gc.collect()
        gc.freeze()
        before = young = closed()
        rested = now()
        while True:
            await asyncio.sleep(CHECK_SECONDS)
            if closed() - before >= max(CLOSED_AT_LEAST, live() // 2) and now() >= rested:
                rested = now() + _seconds(gc.collect) / SHARE
                before = young = closed()
            elif closed() - young >= CLOSED_AT_LEAST:
                gc.collect(1)
                young = closed()
    finally:
        gc.unfreeze()
        gc.set_threshold(*usual)


def _seconds(work: Callable[[], object]) -> float:
    # The time in which other processes have the processor does not count. Otherwise, collections
    # would be rarer on a busy machine, and garbage would fill the memory.
    begun = time.thread_time()
    work()
    return time.thread_time() - begun


RESERVED = 256
"""Descriptors reserved for recordings, the operator page and files. Of a small limit, an eighth is
reserved."""
UNLIMITED = sys.maxsize
OPEN = "/proc/self/fd"
"""Folder whose size is the number of open descriptors, since Linux 6.2; before, the size is 0."""


def limit() -> int:
    """Return the maximum number of descriptors of this process."""
    if sys.platform == "win32":
        return UNLIMITED
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return UNLIMITED if soft == resource.RLIM_INFINITY else soft


def in_use() -> int | None:
    """Return the number of open descriptors; None if it is unknown.

    They are not listed: listing 20,000 takes longer than a step may be late. If the system does
    not report the number, the lowest free one is returned. It is too low if a lower descriptor was
    closed just before, which is acceptable for an alert: new connections are refused by the same
    number.
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
    """Return the number of reserved descriptors."""
    return min(RESERVED, limit() // 8)


def raise_limit(settings: ServerSettings) -> None:
    """Raise the soft limit to the hard limit; warn if the settings need more.

    On a server that only this machine can reach, that is no warning but a debug message.
    """
    if sys.platform == "win32":
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        except (OSError, ValueError):  # macOS has a lower limit than it reports.
            get_logger().debug("descriptors not raised", soft=soft, hard=hard)
    needed = settings.max_connections + settings.max_episodes + RESERVED
    if limit() < needed:
        alone = settings.is_local and not settings.trust_proxy
        level = logging.DEBUG if alone else logging.WARNING
        get_logger().log(
            level,
            "the settings need more file descriptors; connections will be refused before they "
            "run out. Raise the limit (ulimit -Hn, LimitNOFILE=) or lower --max-connections",
            limit=limit(),
            needed=needed,
        )


def few_left(newcomer: socket.socket | None) -> bool:
    """Return whether a new connection uses a reserved descriptor."""
    return newcomer is not None and newcomer.fileno() >= limit() - reserve()
