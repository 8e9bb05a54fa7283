"""Start and stop of the operator port."""

from __future__ import annotations

import asyncio
import builtins
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from robotouille.errors import MissingExtraError
from robotouille_server.app import CannotListenError
from robotouille_server.auth.roles import Role
from robotouille_server.operator import operator_view
from robotouille_server.operator.event_streams import MAX_STREAMS
from tests.support.operator import table, viewing
from tests.support.processes import started
from tests.support.servers import serving
from tests.support.virtual_time import virtual


@virtual
async def test_stop_with_open_pages_leaves_no_task_and_no_socket(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        before = asyncio.all_tasks()
        http = httpx.AsyncClient(timeout=None, trust_env=False, verify=False)
        async with operator_view(server, port=0) as port:
            streams = [
                await http.send(
                    http.build_request("GET", f"{port.url}api/overview/events"), stream=True
                )
                for _ in range(3)
            ]
            assert {answer.status_code for answer in streams} == {200}
        for answer in streams:
            rest = [line async for line in answer.aiter_lines()]
            assert rest[0].startswith("data: ")
        assert asyncio.all_tasks() == before
        with pytest.raises(httpx.ConnectError):
            await http.get(port.url)
        await http.aclose()
        async with operator_view(server, port=port.port) as again:
            assert again.port == port.port


@virtual
async def test_signal_handlers_do_not_change(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
        async with operator_view(server, port=0) as port:
            async with httpx.AsyncClient(timeout=None, trust_env=False, verify=False) as http:
                assert (await http.get(port.url)).status_code == 200
            assert handlers == [
                signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)
            ]


@virtual
async def test_port_in_use_is_reported(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            number = taken.getsockname()[1]
            with pytest.raises(CannotListenError, match=f"127.0.0.1:{number}: Address already"):
                async with operator_view(server, port=number):
                    pass


@pytest.mark.parametrize("library", ["fastapi", "uvicorn"])
@virtual
async def test_missing_library_is_reported_with_the_extra(
    tmp_path: Path, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def without(name: str, *arguments: Any, **options: Any) -> Any:
        if name.partition(".")[0] == library:
            raise ImportError(name)
        return real(name, *arguments, **options)

    async with serving(tmp_path) as server:
        monkeypatch.setattr(builtins, "__import__", without)
        with pytest.raises(MissingExtraError, match=r"pip install 'robotouille\[operator\]'"):
            async with operator_view(server, port=0):
                pass


def test_server_without_the_extra_can_ask_for_the_page() -> None:
    # The server asks, and learns from `operator_view` that libraries are missing.
    without = "import sys; sys.modules.update(dict.fromkeys(('fastapi', 'starlette', 'uvicorn')))"
    program = f"{without}; import robotouille_server.operator"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@virtual
async def test_streams_are_limited_until_one_closes(tmp_path: Path) -> None:
    async with viewing(tmp_path) as (_, _, api):
        request = api.http.build_request("GET", "/api/overview/events")
        streams = [await api.http.send(request, stream=True) for _ in range(MAX_STREAMS)]
        for stream in streams:
            await anext(stream.aiter_lines())
        answer = await api.http.get("/api/overview/events")
        assert (answer.status_code, answer.json()["code"]) == (503, "operator/busy")
        await streams[0].aclose()
        await asyncio.sleep(2)
        again = await api.http.send(request, stream=True)
        assert again.status_code == 200
        for stream in [*streams, again]:
            await stream.aclose()


@virtual
async def test_failing_request_does_not_disturb_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robotouille_server.operator.service import OperatorService

    def fail(*arguments: object) -> None:
        raise ZeroDivisionError

    async with viewing(tmp_path) as (server, _, api), table(server) as play:
        monkeypatch.setattr(OperatorService, "overview", fail)
        answer = await api.http.get("/api/overview")
        assert (answer.status_code, answer.json()["code"]) == (500, "operator/internal")
        assert "ZeroDivision" not in answer.text
        await play.until(lambda game: game.step >= 5)


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
