"""Connections that come in with tokens, or without."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from websockets.asyncio.client import connect

from robotouille.protocol import messages
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from tests.support.servers import Raw

__all__ = ["FORWARDED", "ONE_COOK", "TWO_COOKS", "hello", "minted", "opened"]


FORWARDED = {"X-Forwarded-For": "203.0.113.9"}
"""What a proxy adds to a request from elsewhere."""


@asynccontextmanager
async def opened(server: Server, **headers: str) -> AsyncIterator[Raw]:
    """A connection that has not said hello; one from elsewhere if it is forwarded."""
    async with connect(
        server.url, additional_headers=headers, compression=None, proxy=None
    ) as socket:
        yield Raw(socket, text=True)


async def hello(connection: Raw, **fields: Any) -> dict[str, Any]:
    """Say hello; the answer."""
    message = {"type": "hello", "protocol": 1, "name": "ada", **fields}
    return await connection.ask(message, "welcome", "bye")


def minted(server: Server, role: Role, **options: Any) -> str:
    """A role token of the subject p-1, for an hour."""
    return server.tokens.mint_role(role, "p-1", **{"seconds": 3600, **options})


ONE_COOK = messages.Create(task="synchronous/01_cheese_sandwich")
TWO_COOKS = messages.Create(task="multi_agent/01_lettuce_burger")
