"""Command `robotouille-mcp`: a Model Context Protocol server for playing on a game server."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.terminal import options_from, tell
from robotouille_client.console import (
    TokenOption,
    VersionOption,
    explain,
    fail,
    server_url,
    unicode,
)

if TYPE_CHECKING:
    from robotouille_client.mcp_server.open_games import OpenGames


@dataclass(frozen=True, kw_only=True)
class McpOptions:
    """Options of `robotouille-mcp`."""

    url: Annotated[
        str,
        typer.Option(
            help="URL of the game server, or several URLs of its nodes with commas between them.",
            envvar="ROBOTOUILLE_URL",
        ),
    ] = "ws://127.0.0.1:8765"
    token: TokenOption = None
    name: Annotated[
        str | None,
        typer.Option(
            callback=unicode, help="Name of the players. Default: the name of the MCP client."
        ),
    ] = None
    listen: Annotated[
        str | None,
        typer.Option(
            help="HOST:PORT on which to serve streamable HTTP for several clients. Each client "
            "sends its role token as bearer token. Default: serve one client over standard input "
            "and output."
        ),
    ] = None
    allow_host: Annotated[
        list[str] | None,
        typer.Option(
            help="HTTP: host name under which clients reach this server, such as that of a proxy. "
            "May be repeated. Requests with other host names are refused, and every request needs "
            "a token."
        ),
    ] = None
    max_games: Annotated[
        int, typer.Option(min=1, max=1000, help="Maximum number of open games.")
    ] = 64
    idle_seconds: Annotated[
        float,
        typer.Option(min=10, max=86_400, help="Seconds without a call after which a game is left."),
    ] = 600
    version: VersionOption = False

    def games(self) -> OpenGames:
        """Make the collection of open games."""
        from robotouille_client.mcp_server.open_games import OpenGames

        return OpenGames(
            server_url(self.url, "", 0),
            token=self.token,
            name=self.name,
            max_games=self.max_games,
            idle_seconds=self.idle_seconds,
        )


@options_from(McpOptions)
def command(options: McpOptions) -> None:
    """Let agents that speak the Model Context Protocol play on a game server."""
    try:
        _require_mcp()
        if options.listen is None:
            _serve_stdio(options)
        else:
            _serve_http(options, options.listen)
    except (RobotouilleError, OSError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def _serve_stdio(options: McpOptions) -> None:
    import asyncio

    from robotouille_client.mcp_server.server import serve

    asyncio.run(serve(options.games()))


def _serve_http(options: McpOptions, listen: str) -> None:
    from robotouille_client.mcp_server.http import (
        PATH,
        HttpService,
        http_app,
        is_loopback,
        listening_socket,
    )
    from robotouille_client.mcp_server.server import mcp_server

    if options.token is not None:
        raise RobotouilleError(
            "over HTTP, each client sends its own token as bearer token; leave out --token and "
            "ROBOTOUILLE_TOKEN"
        )
    host, port = _address(listen)
    if not is_loopback(host) and not options.allow_host:
        raise RobotouilleError(
            f"{host} can be reached from other machines: add the host names that clients use, "
            "such as --allow-host kitchen.example.org"
        )
    games = options.games()
    app = http_app(
        mcp_server(lambda: games),
        games,
        allowed_hosts=options.allow_host or (),
        idle_seconds=options.idle_seconds,
    )
    with listening_socket(host, port) as listening:
        shown = f"[{host}]" if ":" in host else host
        tell(f"MCP  http://{shown}:{listening.getsockname()[1]}{PATH}")
        HttpService(app, games).run(sockets=[listening])


def _address(listen: str) -> tuple[str, int]:
    host, _, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdigit() or int(port) > 65_535:
        raise RobotouilleError(f"--listen: expected HOST:PORT, found {listen!r}")
    return host, int(port)


def _require_mcp() -> None:
    if importlib.util.find_spec("mcp") is None:
        raise MissingExtraError("the Model Context Protocol", "mcp")


def main() -> None:
    """Run `robotouille-mcp`."""
    typer.run(command)


if __name__ == "__main__":
    main()
