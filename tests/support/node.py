"""Node, and the libraries that a folder of tests pins in its `package-lock.json`."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import NoReturn

import pytest

__all__ = ["libraries", "node"]

OLDEST = 20


def node(oldest: int = OLDEST) -> str:
    """Return the path of Node, or skip the test if it is missing or too old."""
    path = shutil.which("node")
    version = subprocess.run([path or "true", "--version"], capture_output=True, text=True).stdout
    if path is None or int(version.strip().lstrip("v").partition(".")[0] or 0) < oldest:
        _without(f"Node {oldest} or newer is needed, found {version.strip() or 'none'}")
    return path


@cache
def libraries(folder: Path) -> Path:
    """Return the `node_modules` of a folder, installed once for each change of its lock file."""
    if shutil.which("npm") is None:
        _without("npm is not installed")
    modules = folder / "node_modules"
    wanted = hashlib.sha256((folder / "package-lock.json").read_bytes()).hexdigest()
    stamp = modules / ".installed"
    with (folder / ".install.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not stamp.is_file() or stamp.read_text() != wanted:
            _install(folder)
            stamp.write_text(wanted)
    return modules


def _install(folder: Path) -> None:
    command = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        _without(f"npm could not install the libraries of {folder.name}: {done.stderr}")


def _without(reason: str) -> NoReturn:
    if os.environ.get("ROBOTOUILLE_REQUIRE_NODE"):
        pytest.fail(reason)
    pytest.skip(reason)
