"""Processes do not run files of the folder they are started from."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from robotouille_client.bots.partners import COMMAND as PARTNERS
from robotouille_client.loadtest.worker_pool import COMMAND as LOAD_WORKER
from robotouille_server.rooms.substitutes.bot_worker import COMMAND as SUBSTITUTES
from robotouille_server.runtime.workers import COMMAND as SERVER_WORKER

COMMANDS = {
    "server": (*SERVER_WORKER, "--version"),
    "load": LOAD_WORKER,
    "partners": PARTNERS,
    "substitutes": SUBSTITUTES,
}


@pytest.mark.process
@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_json_py_in_the_folder_is_not_imported(command: Sequence[str], tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('this is the folder')")
    ended = subprocess.run(command, cwd=tmp_path, input=b"\n", capture_output=True, timeout=60)
    assert b"this is the folder" not in ended.stderr
    assert not (tmp_path / "__pycache__").exists()


LIBRARIES = ("json", "multiprocessing", "pickle", "selectors", "socket", "threading")
POOL = """
import os
import sys
from concurrent.futures import ProcessPoolExecutor

from robotouille.processes import spawn_context

if __name__ == "__main__":
    context = spawn_context()
    context.RawArray("q", 3)
    with ProcessPoolExecutor(2, context) as pool:
        print(pool.submit(os.getcwd).result(), pool.submit(os.getenv, "PYTHONSAFEPATH").result())
    print(os.environ.get("PYTHONSAFEPATH"))
"""


@pytest.mark.process
def test_processes_of_pools_do_not_import_it(tmp_path: Path) -> None:
    """The variable that prevents this is removed afterwards."""
    folder, program = tmp_path / "folder", tmp_path / "program.py"
    folder.mkdir()
    for library in LIBRARIES:
        (folder / f"{library}.py").write_text("raise SystemExit('this is the folder')")
    program.write_text(POOL)
    ended = subprocess.run(
        (sys.executable, program), cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert ended.stderr == ""
    assert ended.stdout.splitlines() == [f"{folder} 1", "None"]


def test_all_pools_are_protected() -> None:
    root = Path(__file__).parents[2]
    sources = [
        path
        for package in ("shared", "server", "client", "evaluation", "data")
        for path in (root / package).rglob("*.py")
        if path.name != "spawning.py"
    ]
    assert sources
    for path in sources:
        text = path.read_text()
        assert "get_context(" not in text, path
        assert "ProcessPoolExecutor(" not in text or "spawn_context()" in text, path
