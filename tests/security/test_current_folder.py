"""Processes that are started from a folder do not run what lies there."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from robotouille_client.bots.partner_process import COMMAND as PARTNERS
from robotouille_client.loadtest.worker_pool import COMMAND as LOAD_WORKER
from robotouille_server.rooms.substitutes.worker_process import COMMAND as SUBSTITUTES
from robotouille_server.runtime.supervisor import COMMAND as SERVER_WORKER

COMMANDS = {
    "server": (*SERVER_WORKER, "--version"),
    "load": LOAD_WORKER,
    "partners": PARTNERS,
    "substitutes": SUBSTITUTES,
}


@pytest.mark.process
@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_json_py_of_the_folder_is_no_library(command: Sequence[str], tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('this is the folder')")
    ended = subprocess.run(command, cwd=tmp_path, input=b"\n", capture_output=True, timeout=60)
    assert b"this is the folder" not in ended.stderr
    assert not (tmp_path / "__pycache__").exists()
