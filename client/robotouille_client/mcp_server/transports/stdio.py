"""Standard input and output: one client, which is this process's parent."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from typing import Any

from robotouille_client.mcp_server.open_games import OpenGames
from robotouille_client.mcp_server.server import mcp_server

__all__ = ["serve"]


async def serve(games: OpenGames) -> None:
    """Serve until the client closes its end; all games are left then.

    A signal that says stop ends the process, once the games are left: the library's thread that
    reads standard input would not wake up before the client says something.
    """
    loop = asyncio.get_running_loop()
    stopped: asyncio.Future[int] = loop.create_future()
    with contextlib.suppress(NotImplementedError):  # Windows has no such handlers.
        for signum in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(signum, _stop, stopped, signum)
    serving = asyncio.create_task(mcp_server(lambda: games).run_stdio_async())
    either: set[asyncio.Future[Any]] = {serving, stopped}
    await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
    if stopped.done():
        await games.close_all()
        os._exit(128 + stopped.result())
    await serving


def _stop(stopped: asyncio.Future[int], signum: int) -> None:
    if not stopped.done():
        stopped.set_result(signum)
