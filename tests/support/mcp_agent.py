"""Agent that speaks the Model Context Protocol, using the official SDK's client."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

from mcp import Client, StdioServerParameters
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import create_mcp_http_client
from mcp.types import CallToolResult, TextContent

from robotouille import load_task
from robotouille.planning import solve
from robotouille.world.world import World
from robotouille_client.mcp_server.open_games import OpenGames
from robotouille_client.mcp_server.server import mcp_server

__all__ = [
    "COMMAND",
    "Agent",
    "agent",
    "http_server",
    "over",
    "over_stdio",
    "shortest_plan",
    "with_bearer",
    "words",
]

COMMAND = [
    sys.executable,
    "-c",
    "from robotouille_client.mcp_server.cli import main; main()",
]


def words(result: CallToolResult) -> str:
    """Return all text of a result, with separators between its blocks."""
    return "\n---\n".join(b.text for b in result.content if isinstance(b, TextContent))


class Agent:
    """MCP client that fails on tool errors unless a test expects one."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.read = ""

    async def call(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """Call a tool and return its structured content; `read` stores its text."""
        result = await self.client.call_tool(tool, arguments)
        self.read = words(result)
        assert not result.is_error, self.read
        assert result.structured_content is not None
        content: dict[str, Any] = result.structured_content
        return content

    async def refused(self, tool: str, **arguments: Any) -> str:
        """Call a tool that must fail and return the error message."""
        result = await self.client.call_tool(tool, arguments)
        assert result.is_error, words(result)
        return words(result)

    async def opened(self, task: str, **options: Any) -> str:
        """Create an episode and return its code."""
        created = await self.call("create_episode", task=task, **options)
        return str(created["code"])


@asynccontextmanager
async def over(target: Any, mode: str = "auto") -> AsyncIterator[Agent]:
    """Connect an agent to a transport, a URL, or a server in this process."""
    async with Client(target, mode=mode) as client:
        yield Agent(client)


@asynccontextmanager
async def agent(url: str, *, mode: str = "auto", **options: Any) -> AsyncIterator[Agent]:
    """Connect an agent to an MCP server in this process that uses a game server's URL."""
    async with over(mcp_server(lambda: OpenGames(url, **options)), mode) as connected:
        yield connected


@asynccontextmanager
async def with_bearer(
    url: str, token: str, mode: str = "auto", **headers: str
) -> AsyncIterator[Agent]:
    """Connect an agent that sends a bearer token and other headers to a URL."""
    sent = {"authorization": f"Bearer {token}", **headers}
    async with create_mcp_http_client(headers=sent) as http:
        async with over(streamable_http_client(url, http_client=http), mode) as connected:
            yield connected


def over_stdio(url: str, *flags: str) -> StdioServerParameters:
    """Return the parameters that start `robotouille-mcp` on standard input and output."""
    return StdioServerParameters(
        command=COMMAND[0], args=[*COMMAND[1:], "--url", url, *flags], env=dict(os.environ)
    )


@contextmanager
def http_server(url: str, *flags: str) -> Iterator[str]:
    """Run a `robotouille-mcp` process that serves HTTP and yield its URL."""
    command = [*COMMAND, "--url", url, "--listen", "127.0.0.1:0", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().split()[1]
            process.terminate()
            process.wait(10)
        finally:
            process.kill()


def shortest_plan(task: str) -> list[str]:
    """Return the sentences of a shortest plan for one player."""
    found = solve(World(load_task(task))).plan
    assert found is not None
    return [action.sentence for step in found for action in step]
