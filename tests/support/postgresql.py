"""Private PostgreSQL server in a folder, reached through a Unix socket."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

__all__ = ["USER", "PostgreSQL", "missing", "postgresql", "program"]

USER = "postgres"


def program(name: str) -> str | None:
    """Return the path of a PostgreSQL program; Debian installs them outside PATH."""
    packaged = sorted(Path("/usr/lib/postgresql").glob(f"*/bin/{name}"))
    return shutil.which(name) or (str(packaged[-1]) if packaged else None)


@cache
def missing() -> str:
    """Return why a server cannot run here, or an empty string."""
    if not program("initdb") or not program("pg_ctl"):
        return "PostgreSQL is not installed"
    if os.geteuid() == 0 and subprocess.run(["id", USER], capture_output=True).returncode:
        return f"PostgreSQL refuses to run as root, and there is no user {USER}"
    return ""


class PostgreSQL:
    """PostgreSQL server that tests may start and stop repeatedly."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._user = USER if os.geteuid() == 0 else None
        self.url = f"postgresql://{USER}@/postgres?host={folder}"
        self._run("initdb", "--auth=trust", f"--username={USER}", "--no-sync")

    def start(self) -> None:
        options = f"-k {self._folder} -c listen_addresses='' -c fsync=off"
        self._run("pg_ctl", "start", "--wait", f"--log={self._folder}/log", f"--options={options}")

    def stop(self) -> None:
        self._run("pg_ctl", "stop", "--mode=immediate")

    def kill(self) -> None:
        """Send SIGKILL to the server and all its processes, so that they write nothing more."""
        self.send_signal(signal.SIGKILL)
        for left in (self._lock, *self._folder.glob(".s.PGSQL.*.lock")):
            left.unlink()  # An unreaped process would make the next server trust its lock.

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal to the server and all its processes."""
        first = int(self._lock.read_text().split()[0])
        for pid in (first, *_children(first)):
            with suppress(ProcessLookupError):
                os.kill(pid, number)

    @property
    def _lock(self) -> Path:
        return self._folder / "data/postmaster.pid"

    def _run(self, name: str, *arguments: str) -> None:
        command = [str(program(name)), f"--pgdata={self._folder}/data", *arguments]
        subprocess.run(
            command, user=self._user, cwd=self._folder, stdout=subprocess.DEVNULL, check=True
        )


def _children(pid: int) -> list[int]:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(child) for child in found.split()]


@contextmanager
def postgresql() -> Iterator[PostgreSQL]:
    """Run a server in a folder that is deleted afterwards."""
    with tempfile.TemporaryDirectory(prefix="pg") as name:  # Socket paths must be short.
        folder = Path(name)
        if os.geteuid() == 0:
            shutil.chown(folder, USER)
        server = PostgreSQL(folder)
        server.start()
        try:
            yield server
        finally:
            server.stop()
