"""The documentation of the MCP server matches the code."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille.web.bounded_requests import MAX_HEAD_BYTES, MAX_HEAD_LINES
from robotouille_client.mcp_server import server as mcp
from robotouille_client.mcp_server.limits import (
    MAX_BODY_BYTES,
    MAX_BODY_VALUES,
    MAX_CALLS_OF_GAME,
    MAX_CONNECTIONS,
    MAX_CONNECTIONS_OF_ADDRESS,
    MAX_GAMES_OF_TOKEN,
    MAX_NEWCOMERS,
    MAX_REQUESTS_OF_TOKEN,
    MAX_SESSIONS,
    MAX_SESSIONS_OF_ADDRESS,
    MAX_SESSIONS_OF_TOKEN,
    MAX_VISITS_OF_TOKEN,
)
from robotouille_client.mcp_server.open_game import MAX_LINES
from robotouille_client.mcp_server.results import GameView
from robotouille_client.mcp_server.sessions import CHECKS_AT_ONCE, MAX_ACCEPTED
from robotouille_client.mcp_server.tools import TOOLS
from robotouille_client.mcp_server.turns import TURNS_AT_ONCE
from robotouille_server import Server
from tests.support.mcp_agent import COMMAND, agent
from tests.support.pages import read, table, titled
from tests.support.server_process import server_process
from tests.support.servers import serving
from tests.support.virtual_time import opening, run

PAGE = "write_an_agent.md"


def test_all_tools_arguments_and_fields_are_documented(tmp_path: Path) -> None:
    rows = {row[0]: row for row in table(PAGE, "MCP tools")[: len(TOOLS)]}
    assert list(rows) == [tool.__name__ for tool in TOOLS]

    async def main() -> None:
        async with serving(tmp_path) as server, agent(server.url) as ada:
            for tool in (await ada.client.list_tools()).tools:
                arguments = ", ".join(f"`{name}`" for name in tool.input_schema["properties"])
                assert rows[tool.name][1] == arguments.strip("`")
                assert tool.description
                assert tool.output_schema
                for schema in tool.input_schema["properties"].values():
                    assert schema["description"], tool.name

    run(main())
    assert all(f"`{field}`" in read(PAGE) for field in GameView.model_fields)


ADDRESS = "address (IPv6: /64 network; not on loopback)"


def test_documented_limits_match_the_code() -> None:
    rows = {row[0]: row[1] for row in table(PAGE, "MCP limits")}
    assert rows["open games with one token"] == str(MAX_GAMES_OF_TOKEN)
    assert rows["request body (HTTP)"] == f"{MAX_BODY_BYTES // 1024} KiB"
    assert rows["sessions, in MCP versions with a handshake (HTTP)"] == str(MAX_SESSIONS)
    values = "values in a request body (HTTP); each list or object counts as one more"
    assert rows[values] == f"{MAX_BODY_VALUES:,}"
    called = "calls of one game in progress, also those whose client has closed its connection"
    assert rows[called] == str(MAX_CALLS_OF_GAME)
    visits = "calls of one token that wait for the game server, to join or for one request"
    assert rows[visits] == str(MAX_VISITS_OF_TOKEN)
    assert rows["sessions with one token"] == str(MAX_SESSIONS_OF_TOKEN)
    assert rows["calls of one token in progress (HTTP)"] == str(MAX_REQUESTS_OF_TOKEN)
    assert rows[f"sessions from one {ADDRESS}"] == str(MAX_SESSIONS_OF_ADDRESS)
    checked = "accepted tokens that the game server checks again at the same time (HTTP)"
    assert rows[checked] == str(CHECKS_AT_ONCE)
    served = "requests that are served at the same time, except while they wait for the game (HTTP)"
    assert rows[served] == str(TURNS_AT_ONCE)
    assert rows["requests with unknown tokens in progress (HTTP)"] == str(MAX_NEWCOMERS)
    assert rows["accepted tokens that are remembered (HTTP)"] == str(MAX_ACCEPTED)
    head = f"{MAX_HEAD_BYTES // 1024} KiB, {MAX_HEAD_LINES} lines"
    assert rows["request head (HTTP)"] == head
    assert rows["connections (HTTP)"] == str(MAX_CONNECTIONS)
    assert rows["connections from one address (not on loopback)"] == str(MAX_CONNECTIONS_OF_ADDRESS)
    assert f"the last {MAX_LINES} lines" in read(PAGE)


@opening(serving)
async def test_texts_for_models_name_existing_tools(server: Server) -> None:
    async with agent(server.url) as ada:
        guide = (await ada.client.read_resource("robotouille://guide")).contents[0]
        assert "until" in guide.text
        tasks = (await ada.client.read_resource("robotouille://tasks")).contents[0]
        assert "synchronous/01_cheese_sandwich" in [r["task"] for r in json.loads(tasks.text)]
        prompt = await ada.client.get_prompt("play", {"episode": "KQXZB-MHTWA"})
        assert "KQXZB-MHTWA" in prompt.messages[0].content.text


def test_tasks_are_loaded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first = mcp.tasks()
    monkeypatch.delattr(mcp, "load_task")
    assert mcp.tasks() == first


@pytest.mark.parametrize("name", ["mcp.json", "mcp-http.json"])
def test_documented_configurations_are_json(name: str) -> None:
    assert json.loads(titled(PAGE, name))["mcpServers"]["robotouille"]


@pytest.mark.process
def test_documented_program_plays_a_game(tmp_path: Path) -> None:
    script = tmp_path / "mcp_agent.py"
    script.write_text(titled(PAGE, "mcp_agent.py"), encoding="utf-8")
    program = tmp_path / "robotouille-mcp"
    found = f"import sys; sys.path[:] = {sys.path!r}"  # clients pass few variables on
    program.write_text(f"#!{sys.executable}\n{found}\n{COMMAND[2]}\n", encoding="utf-8")
    program.chmod(0o755)
    path = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    with server_process(tmp_path, "--log-level", "error") as server:
        done = subprocess.run(
            [sys.executable, str(script), server.url], capture_output=True, text=True, env=path
        )
    assert done.returncode == 0, done.stderr
    assert "You are robot1." in done.stdout
    assert "'reason': 'goal'" in done.stdout
