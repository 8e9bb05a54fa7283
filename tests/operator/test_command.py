"""The operator's view as `robotouille-server` starts it."""

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


def view(greeting: str) -> str:
    """The address that the server says its operator's view has."""
    found = re.search(r"watch over it:\s+(http://127\.0\.0\.1:\d+/)\n", greeting)
    assert found, greeting
    return found[1]


def overview(greeting: str, token: str = "") -> tuple[int, str]:
    """What the view answers to somebody with this token: status, and the error's code."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    with httpx.Client(base_url=view(greeting), trust_env=False, timeout=30) as http:
        answer = http.get("/api/overview", headers=headers)
    return answer.status_code, answer.json().get("code", "")


def minted(role: Role, recordings: Path) -> str:
    """A token as the server's operator makes one."""
    keys = recordings.with_name(f"{recordings.name}.state") / "keys.json"
    command = [*TOKEN, "mint", role.value, "--keys", str(keys)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip()


def listening(server: subprocess.Popen[str]) -> int:
    """On how many ports a process listens."""
    sockets = psutil.Process(server.pid).net_connections("tcp")
    return sum(one.status == psutil.CONN_LISTEN for one in sockets)


def test_the_greeting_says_where_it_is(tmp_path: Path) -> None:
    with started(tmp_path / "r", *TASK) as (server, greeting):
        assert overview(greeting) == (200, "")
        assert listening(server) == 2


def test_where_tokens_are_needed_it_needs_an_operators(tmp_path: Path) -> None:
    folder = tmp_path / "r"
    with started(folder, *TASK, "--require-token") as (_, greeting):
        assert overview(greeting) == (401, "auth/needed")
        assert overview(greeting, minted(Role.HOST, folder)) == (401, "auth/role")
        assert overview(greeting, minted(Role.OPERATOR, folder)) == (200, "")


def test_without_it_no_port_is_opened(tmp_path: Path) -> None:
    with started(tmp_path / "r", *TASK, "--no-operator") as (server, greeting):
        assert "watch over it" not in greeting
        assert listening(server) == 1
