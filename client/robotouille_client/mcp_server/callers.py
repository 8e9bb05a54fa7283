"""Who calls a tool, and with which token."""

from __future__ import annotations

from typing import Any

from mcp.server.mcpserver import Context

from robotouille_client.mcp_server.open_games import Caller, OpenGames

__all__ = ["bearer", "caller_of"]

MAX_NAME = 40
SESSION_HEADER = "mcp-session-id"


def bearer(authorization: str | None) -> str | None:
    """The token of an `Authorization` header."""
    scheme, _, token = (authorization or "").partition(" ")
    return token.strip() or None if scheme.lower() == "bearer" else None


def caller_of(ctx: Context[OpenGames, Any], name: str | None = None) -> Caller:
    """The client that calls: over HTTP with its own token, otherwise with this process's."""
    games = ctx.request_context.lifespan_context
    called = (name or games.name or _client_name(ctx))[:MAX_NAME]
    if ctx.headers is None:
        return Caller(games.token, called)
    token = bearer(ctx.headers.get("authorization"))
    return Caller(token, called, alone=False, mcp_session=ctx.headers.get(SESSION_HEADER))


def _client_name(ctx: Context[OpenGames, Any]) -> str:
    """What the client's program calls itself."""
    params = ctx.session.client_params
    return (params.client_info.name if params is not None else "") or "mcp-agent"
