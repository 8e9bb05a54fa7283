"""Server process on a free port, for tests that use it from outside."""

from __future__ import annotations

import os
import re
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tests.support.processes import COMMAND

__all__ = ["ServerProcess", "server_process"]


@dataclass(frozen=True, slots=True)
class ServerProcess:
    """A running server with its URL, its recordings folder and its log."""

    process: subprocess.Popen[str]
    url: str
    recordings: Path
    log: Path

    @property
    def port(self) -> int:
        return int(self.url.rsplit(":", 1)[1])


@contextmanager
def server_process(folder: Path, *flags: str) -> Iterator[ServerProcess]:
    """Run a server that records in a subfolder and logs to a file, and kill it at the end."""
    recordings, log = folder / "recordings", folder / "server.log"
    command = [*COMMAND, "--port", "0", "--recordings", str(recordings), *flags]
    with log.open("w") as errors:
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
    try:
        assert process.stdout is not None
        url = _listening(process.stdout)
        assert url, log.read_text()
        rest = threading.Thread(target=process.stdout.read, daemon=True)
        rest.start()
        yield ServerProcess(process, url, recordings, log)
        process.kill()
        rest.join(10)
    finally:
        process.kill()
        process.communicate()


def _listening(output: IO[str]) -> str:
    for line in output:
        if found := re.search(r"wss?://[^\s,;]+", line):
            return found[0]
    return ""
