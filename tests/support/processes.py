"""Server processes."""

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
    """Run a server process and yield it with its output; `prefix` wraps the command."""
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
    """Run a server process and yield it with its URL and the code of its first episode."""
    with started(folder, *flags, prefix=prefix, **environment) as (server, text):
        found = re.search(r"(ws://\S+)[\s\S]*code is ([A-Z-]+)", text)
        assert found, text
        yield server, found.group(1), found.group(2)


def program(module: str, *arguments: str, **environment: str) -> subprocess.Popen[str]:
    """Start a module's program in a process."""
    code = f"from {module} import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        text=True,
    )
