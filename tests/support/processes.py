"""Servers as processes of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

__all__ = ["COMMAND", "process", "program", "started"]


COMMAND = [sys.executable, "-c", "from robotouille_server.cli import main; main()"]


@contextmanager
def started(
    folder: Path, *flags: str, prefix: Sequence[str] = (), **environment: str
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server process that serves, and what it has printed; a `prefix` runs it elsewhere."""
    arguments = [*prefix, *COMMAND, "--port", "0", "--recordings", str(folder), *flags]
    server = subprocess.Popen(
        arguments,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    assert server.stdout is not None
    try:
        text = ""
        for line in server.stdout:
            text += line
            if "stop:" in line:
                break
        assert "stop:" in text, (text, server.stderr.read() if server.stderr else "")
        yield server, text
    finally:
        if server.poll() is None:
            server.kill()
        server.communicate()


@contextmanager
def process(
    folder: Path, *flags: str, prefix: Sequence[str] = (), **environment: str
) -> Iterator[tuple[subprocess.Popen[str], str, str]]:
    """A server process, its URL and the code of its first kitchen."""
    with started(folder, *flags, prefix=prefix, **environment) as (server, text):
        found = re.search(r"(ws://\S+)[\s\S]*code is ([A-Z-]+)", text)
        assert found, text
        yield server, found.group(1), found.group(2)


def program(module: str, *arguments: str, **environment: str) -> subprocess.Popen[str]:
    """A module's program as a process of its own."""
    code = f"from {module} import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        text=True,
    )
