"""Runs the Node client, and installs its two libraries if they are missing."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest

__all__ = ["run_node"]

FOLDER = Path(__file__).parent
OLDEST = 18


def run_node(task: str, **options: Any) -> Any:
    """Return the result of a task of `client.mjs`, or skip the test without Node."""
    _installed()
    done = subprocess.run(
        ["node", str(FOLDER / "client.mjs")],
        input=json.dumps({"do": task, **options}),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@cache
def _installed() -> None:
    """Install the libraries once for each change of the lock file."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        _without("Node and npm are not installed")
    version = subprocess.run(["node", "--version"], capture_output=True, text=True).stdout
    if int(version.lstrip("v").partition(".")[0] or 0) < OLDEST:
        _without(f"Node {OLDEST} or newer is needed, found {version.strip()}")
    wanted = hashlib.sha256((FOLDER / "package-lock.json").read_bytes()).hexdigest()
    stamp = FOLDER / "node_modules" / ".installed"
    with (FOLDER / ".install.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not stamp.is_file() or stamp.read_text() != wanted:
            _install()
            stamp.write_text(wanted)


def _install() -> None:
    command = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
    done = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        pytest.fail(f"npm could not install the conformance client's libraries: {done.stderr}")


def _without(reason: str) -> None:
    if os.environ.get("ROBOTOUILLE_REQUIRE_NODE"):
        pytest.fail(reason)
    pytest.skip(reason)
