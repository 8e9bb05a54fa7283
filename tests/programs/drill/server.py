"""The real server process, which is killed and restarted on the same port and folder."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any

__all__ = ["ServerProcess", "free_port"]

COMMAND = (sys.executable, "-c", "from robotouille_server.cli import main; main()")
STOP_SECONDS = 30.0


def free_port() -> int:
    """Return an unused TCP port that is followed by another unused one."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port: int = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


class ServerProcess:
    """Consecutive lives of the server.

    Args:
        folder: The folder for recordings and logs.
        faults: Gets errors in the logs and unexpected ends.
        flags: More options of the server.
        ready: The entry of the log after which the server accepts players.
        patience: The seconds in which the server must end after a signal.

    Attributes:
        allowed: Entries of the log that are errors, but not faults at the moment.
    """

    def __init__(
        self,
        folder: Path,
        port: int,
        faults: list[str],
        *flags: str,
        ready: str = "listening",
        patience: float = STOP_SECONDS,
    ) -> None:
        self.url = f"ws://127.0.0.1:{port}"
        self.folder = folder
        self.lives = 0
        self.started = 0.0
        self.listening = asyncio.Event()
        self.start_seconds: list[float] = []
        self.stop_seconds: list[float] = []
        self.restored: list[int] = []
        self.faults = faults
        self.allowed: frozenset[str] = frozenset()
        self._ready = ready
        self._patience = patience
        recordings = str(folder / "recordings")
        self._arguments = (*COMMAND, "--port", str(port), "--recordings", recordings,
                           "--log-format", "json", "--drain-seconds", "0", *flags)  # fmt: skip
        self._process: asyncio.subprocess.Process | None = None
        self._reading: asyncio.Task[None] | None = None
        self._ending = False

    @property
    def ended(self) -> bool:
        """True if this life has ended."""
        return self._process is not None and self._process.returncode is not None

    async def start(self) -> None:
        """Start another life; `listening` is set once it accepts connections."""
        self.lives += 1
        self.listening = asyncio.Event()
        self._ending = False
        self.restored.append(0)
        self.started = time.monotonic()
        self._process = await asyncio.create_subprocess_exec(
            *self._arguments,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "ROBOTOUILLE_COMPILE": "0"},
        )
        self._reading = asyncio.create_task(self._read(self._process))

    @property
    def pid(self) -> int:
        """The id of this life's process."""
        assert self._process is not None
        return self._process.pid

    def send(self, number: signal.Signals) -> None:
        """Send a signal that does not end this life."""
        os.kill(self.pid, number)

    async def kill(self, number: signal.Signals = signal.SIGKILL) -> None:
        """End this life and check how it ended."""
        process, reading = self._process, self._reading
        if process is None or reading is None:
            return
        self._ending = True
        begun = time.monotonic()
        polite = number is not signal.SIGKILL and self.listening.is_set()
        with contextlib.suppress(ProcessLookupError):  # It has ended by itself.
            process.send_signal(number)
        try:
            async with asyncio.timeout(self._patience):
                status = await process.wait()
        except TimeoutError:
            self.faults.append(
                f"life {self.lives} did not end within {self._patience:g} s of {number!r}"
            )
            process.kill()
            status = await process.wait()
        await reading
        if polite:
            self.stop_seconds.append(time.monotonic() - begun)
            if status != 0:
                self.faults.append(f"life {self.lives} ended with status {status} after {number!r}")

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        life, others = self.lives, list[bytes]()
        assert process.stderr is not None
        with (self.folder / f"server-{life:04}.log").open("wb") as log:
            async for line in process.stderr:
                log.write(line)
                log.flush()
                if line.startswith(b"{"):
                    self._heed(life, json.loads(line))
                elif line.strip():
                    others.append(line)
        await process.wait()
        if others:
            last = b"".join(others[-3:]).decode(errors="replace")
            self.faults.append(f"life {life} wrote {len(others)} unexpected lines, last: {last}")
        if not self._ending:
            self.faults.append(f"life {life} ended by itself with status {process.returncode}")

    def _heed(self, life: int, row: dict[str, Any]) -> None:
        match row.get("event"):
            case event if event == self._ready:
                self.start_seconds.append(time.monotonic() - self.started)
                self.listening.set()
            case "episode restored":
                self.restored[-1] += 1
        bad = row.get("level") in ("error", "critical")
        if bad and row.get("event") not in self.allowed:
            self.faults.append(f"life {life}: {json.dumps(row)[:2000]}")
