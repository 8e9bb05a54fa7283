"""Question to another node whether it is ready, without NATS."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from urllib.parse import urlsplit

READY_PATH = "/readyz"
SECONDS = 2.0
MAX_LINE = 1024


async def is_ready(url: str) -> bool:
    """Return whether a node answers that it is ready.

    Args:
        url: The address of the node for clients, `ws://…` or `wss://…`.
    """
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        return False
    encrypted = parts.scheme == "wss"
    port = port or (443 if encrypted else 80)
    tls = ssl.create_default_context() if encrypted else None
    path = parts.path.rstrip("/") + READY_PATH
    request = f"GET {path} HTTP/1.1\r\nHost: {parts.netloc}\r\nConnection: close\r\n\r\n"
    writer = None
    try:
        async with asyncio.timeout(SECONDS):
            reader, writer = await asyncio.open_connection(
                parts.hostname, port, ssl=tls, limit=MAX_LINE
            )
            writer.write(request.encode())
            status = await reader.readuntil(b"\r\n")
    except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
        return False
    finally:
        if writer is not None:
            with contextlib.suppress(OSError):
                writer.close()
    return status.split(b" ")[1:2] == [b"200"]
