"""Raw connections before and during the `hello` handshake, with and without tokens."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from robotouille.protocol import messages
from robotouille_server import Server
from robotouille_server.auth.roles import Role
from tests.support.servers import Raw

__all__ = ["FORWARDED", "ONE_COOK", "TWO_COOKS", "hello", "mint_token", "opened", "status"]


FORWARDED = {"X-Forwarded-For": "203.0.113.9"}
"""Header that a proxy adds to a request from another machine."""


@asynccontextmanager
async def opened(server: Server, **headers: str) -> AsyncIterator[Raw]:
    """Open a connection that has not sent `hello`; `FORWARDED` makes it a remote one."""
    async with connect(
        server.url, additional_headers=headers, compression=None, proxy=None
    ) as socket:
        yield Raw(socket, text=True)


async def hello(connection: Raw, **fields: Any) -> dict[str, Any]:
    """Send `hello` and return the reply."""
    message = {"type": "hello", "protocol": 1, "name": "ada", **fields}
    return await connection.ask(message, "welcome", "bye")


async def status(server: Server, **headers: str) -> tuple[int, str]:
    """Return the HTTP status of a handshake, and its text; 101 if it is accepted."""
    try:
        async with opened(server, **headers):
            return 101, ""
    except InvalidStatus as error:
        return error.response.status_code, (error.response.body or b"").decode()


def mint_token(server: Server, role: Role, **options: Any) -> str:
    """Return a role token for the subject p-1 that is valid for an hour."""
    return server.tokens.mint_role(role, "p-1", **{"seconds": 3600, **options})


ONE_COOK = messages.Create(task="synchronous/01_cheese_sandwich")
TWO_COOKS = messages.Create(task="multi_agent/01_lettuce_burger")
