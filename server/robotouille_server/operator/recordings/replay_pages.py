"""Pages that show recordings: their data, made in a process of its own.

The data of a long game take seconds of Python, which would delay the steps of all episodes. So a
process with a low priority makes them; see `robotouille.web.recording_data`.
"""

from __future__ import annotations

import asyncio
import os
import sys
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from typing import BinaryIO

from robotouille_server.operator.load import BUSY_SECONDS
from robotouille_server.operator.principal import RequestRefusedError

AT_ONCE = 2
MAX_WAITING = 8
MAX_REPLAYED = 32 * 1024 * 1024
"""Largest recording that is shown as a page, in bytes of its file."""
SECONDS = 30.0
"""Time limit for the data of one recording."""
COMMAND = (sys.executable, "-P", "-m", "robotouille.web.recording_data")
"""`-P` keeps modules in the server's working directory from replacing installed ones."""


class ReplayPages:
    """Makes the data of a few pages at the same time."""

    def __init__(self, tasks: Path | None) -> None:
        self._tasks = tasks
        self._free = asyncio.Semaphore(AT_ONCE)
        self._unfinished = 0

    async def data(self, name: str, file: BinaryIO, size: int) -> bytes:
        """Return the data of a recording as compressed JSON, and close its file.

        Raises:
            RequestRefusedError: Too many pages wait, or the recording cannot be shown.
        """
        with file:
            if size > MAX_REPLAYED:
                raise _unshown(f"{name} is larger than {MAX_REPLAYED // 1024**2} MiB")
            if self._unfinished >= AT_ONCE + MAX_WAITING:
                message = f"{self._unfinished} requests for replays are waiting; try again"
                status = HTTPStatus.SERVICE_UNAVAILABLE
                raise RequestRefusedError(status, "operator/busy", message, BUSY_SECONDS)
            self._unfinished += 1
            try:
                async with self._free:
                    return await self._made(name, file, size)
            finally:
                self._unfinished -= 1

    async def _made(self, name: str, file: BinaryIO, size: int) -> bytes:
        folder = str(self._tasks or "")
        # `seek` of a buffered file may leave the position of its descriptor.
        os.lseek(file.fileno(), 0, os.SEEK_SET)
        process = await asyncio.create_subprocess_exec(
            *COMMAND, name, str(size), folder,
            stdin=file, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        try:
            async with asyncio.timeout(SECONDS):
                data, said = await process.communicate()
        except TimeoutError:
            raise _unshown(f"{name} takes more than {SECONDS:g} s") from None
        finally:
            # The request may be cancelled: the client has gone, or the server stops.
            with suppress(ProcessLookupError):
                process.kill()
        if process.returncode:
            reason = said.decode(errors="replace").strip().rpartition("\n")[2]
            raise _unshown(reason or f"the process for {name} has ended")
        return data


def _unshown(reason: str) -> RequestRefusedError:
    message = f"{reason}; download the recording and use `robotouille replay page`"
    return RequestRefusedError(HTTPStatus.UNPROCESSABLE_ENTITY, "recording/unshown", message)
