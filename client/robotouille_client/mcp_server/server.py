"""The server of the Model Context Protocol: tools, resources and a prompt."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Annotated

from mcp.server.mcpserver import MCPServer
from mcp.types import ToolAnnotations
from pydantic import Field

from robotouille import load_task, task_names
from robotouille.release import VERSION
from robotouille_client.mcp_server.guide import GUIDE, INSTRUCTIONS, PROMPT
from robotouille_client.mcp_server.open_games import OpenGames
from robotouille_client.mcp_server.tools import TOOLS

__all__ = ["mcp_server"]

READ_ONLY = ("list_episodes", "observe", "list_actions", "wait")


def mcp_server(make_games: Callable[[], OpenGames]) -> MCPServer[OpenGames]:
    """A server without a transport; what it opens is left when it stops."""

    @asynccontextmanager
    async def lifespan(_: MCPServer[OpenGames]) -> AsyncIterator[OpenGames]:
        async with make_games().running() as games:
            yield games

    server = MCPServer(
        "robotouille",
        title="Robotouille",
        instructions=INSTRUCTIONS,
        version=VERSION,
        lifespan=lifespan,
        log_level="WARNING",
        subscriptions=False,
    )
    for tool in TOOLS:
        annotations = ToolAnnotations(
            read_only_hint=tool.__name__ in READ_ONLY, destructive_hint=False, open_world_hint=True
        )
        server.add_tool(tool, annotations=annotations)
    server.resource("robotouille://guide", title="How to play", mime_type="text/markdown")(guide)
    server.resource("robotouille://tasks", title="The tasks", mime_type="application/json")(tasks)
    server.prompt(title="Play an episode")(play)
    return server


def guide() -> str:
    """The rules of the kitchen, the clocks, and what to make of other players."""
    return GUIDE


def tasks() -> str:
    """The tasks that create_episode knows: names, seats and goals."""
    rows = []
    for name in task_names():
        task = load_task(name)
        counts = list(task.problem.seats or (task.seats,))
        rows.append({"task": name, "seats": counts, "goal": task.goal_description})
    return json.dumps(rows, indent=1)


def play(
    episode: Annotated[str, Field(description="An episode's code, if you have one.")] = "",
) -> str:
    """Play an episode to its goal."""
    task = f"Join the episode {episode}." if episode else "Join one that waits, or create one."
    return PROMPT.format(task=task)
