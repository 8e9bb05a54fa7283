"""The operator page as `robotouille-server` starts it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import httpx
import psutil
import pytest

from robotouille_server.auth.roles import Role
from tests.support.processes import started

pytestmark = pytest.mark.process

TOKEN = [sys.executable, "-c", "from robotouille_server.auth.token_cli import main; main()"]
TASK = ("--task", "synchronous/01")


def page_url(greeting: str) -> str:
    """Return the address of the operator page from the server's greeting."""
    found = re.search(r"operator page:\s+(http://127\.0\.0\.1:\d+/)\n", greeting)
    assert found, greeting
    return found[1]


def overview(greeting: str, token: str = "") -> tuple[int, str]:
    """Request the overview; return the status and the error code."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    with httpx.Client(base_url=page_url(greeting), trust_env=False, timeout=30) as http:
        answer = http.get("/api/overview", headers=headers)
    return answer.status_code, answer.json().get("code", "")


def mint_token(role: Role, recordings: Path) -> str:
    """Create a token with `robotouille-token`."""
    keys = recordings.with_name(f"{recordings.name}.state") / "keys.json"
    command = [*TOKEN, "mint", role.value, "--keys", str(keys)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip()


def listening(server: subprocess.Popen[str]) -> int:
    """Return the number of ports that a process listens on."""
    sockets = psutil.Process(server.pid).net_connections("tcp")
    return sum(one.status == psutil.CONN_LISTEN for one in sockets)


def test_greeting_shows_the_address(tmp_path: Path) -> None:
    with started(tmp_path / "r", *TASK) as (server, greeting):
        assert overview(greeting) == (200, "")
        assert listening(server) == 2


def test_require_token_requires_an_operator_token(tmp_path: Path) -> None:
    folder = tmp_path / "r"
    with started(folder, *TASK, "--require-token") as (_, greeting):
        assert overview(greeting) == (401, "auth/needed")
        assert overview(greeting, mint_token(Role.HOST, folder)) == (401, "auth/role")
        assert overview(greeting, mint_token(Role.OPERATOR, folder)) == (200, "")


def test_no_operator_opens_no_port(tmp_path: Path) -> None:
    with started(tmp_path / "r", *TASK, "--no-operator") as (server, greeting):
        assert "operator page" not in greeting
        assert listening(server) == 1
