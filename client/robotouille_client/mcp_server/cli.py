"""`robotouille-mcp`: any agent that speaks the Model Context Protocol plays on a game server."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.program import VersionOption, tell
from robotouille_client.console import TokenOption, explain, fail, server_url, unicode

if TYPE_CHECKING:
    from robotouille_client.mcp_server.open_games import OpenGames

__all__ = ["command", "main"]


def command(
    url: Annotated[
        str, typer.Option(help="The game server.", envvar="ROBOTOUILLE_URL")
    ] = "ws://127.0.0.1:8765",
    token: TokenOption = None,
    name: Annotated[
        str | None,
        typer.Option(
            callback=unicode,
            help="What the others call the players; the client's name if left out.",
        ),
    ] = None,
    listen: Annotated[
        str | None,
        typer.Option(
            help="Serve streamable HTTP on HOST:PORT, for several clients; each gives its role "
            "token as bearer. Standard input and output, for one client, if left out."
        ),
    ] = None,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(
            help="HTTP: a host name by which clients reach us, e.g. that of a proxy; may be "
            "repeated. Requests with any other are refused, and all need a token then."
        ),
    ] = None,
    max_games: Annotated[
        int, typer.Option(min=1, max=1000, help="Games that may be open at once.")
    ] = 64,
    idle_seconds: Annotated[
        float,
        typer.Option(min=10, max=86_400, help="A game is left that no call has used for so long."),
    ] = 600,
    version: VersionOption = False,
) -> None:
    """Let agents that speak the Model Context Protocol play on a game server."""
    try:
        _require_mcp()
        if listen is not None and token is not None:
            raise RobotouilleError(
                "over HTTP each client gives its own token as bearer; leave --token and "
                "ROBOTOUILLE_TOKEN out"
            )

        def make_games() -> OpenGames:
            from robotouille_client.mcp_server.open_games import OpenGames

            return OpenGames(
                server_url(url, "", 0),
                token=token,
                name=name,
                max_games=max_games,
                idle_seconds=idle_seconds,
            )

        if listen is None:
            _serve_stdio(make_games)
        else:
            _serve_http(make_games, listen, tuple(allow_host or ()), idle_seconds)
    except (RobotouilleError, OSError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def _serve_stdio(make_games: Callable[[], OpenGames]) -> None:
    import asyncio

    from robotouille_client.mcp_server.transports.stdio import serve

    asyncio.run(serve(make_games()))


def _serve_http(
    make_games: Callable[[], OpenGames],
    listen: str,
    allowed_hosts: tuple[str, ...],
    idle_seconds: float,
) -> None:
    from robotouille_client.mcp_server.server import mcp_server
    from robotouille_client.mcp_server.transports.http import (
        PATH,
        HttpService,
        http_app,
        is_loopback,
        listening_socket,
    )

    host, port = _address(listen)
    if not is_loopback(host) and not allowed_hosts:
        raise RobotouilleError(
            f"{host} can be reached from elsewhere: name the hosts that clients say, "
            "e.g. --allow-host kitchen.example.org"
        )
    games = make_games()
    app = http_app(
        mcp_server(lambda: games),
        games,
        allowed_hosts=allowed_hosts,
        idle_seconds=idle_seconds,
    )
    with listening_socket(host, port) as listening:
        shown = f"[{host}]" if ":" in host else host
        tell(f"MCP  http://{shown}:{listening.getsockname()[1]}{PATH}")
        HttpService(app, games).run(sockets=[listening])


def _address(listen: str) -> tuple[str, int]:
    """HOST:PORT, with brackets around the address for IPv6."""
    host, _, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65_535:
        raise RobotouilleError(f"--listen takes HOST:PORT, found {listen!r}")
    return host, int(port)


def _require_mcp() -> None:
    if importlib.util.find_spec("mcp") is None:
        raise MissingExtraError("the Model Context Protocol", "mcp")


def main() -> None:
    """The entry point of `robotouille-mcp`."""
    typer.run(command)


if __name__ == "__main__":
    main()
