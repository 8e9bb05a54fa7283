"""`robotouille-lsl`: gives an episode to the Lab Streaming Layer."""

from __future__ import annotations

from typing import Annotated

import typer

from robotouille.program import VersionOption, printable, tell
from robotouille_client.console import (
    SERVER_HOST,
    SERVER_PORT,
    HostOption,
    PortOption,
    TokenOption,
    UrlOption,
    failing,
    interruptible,
    server_url,
    unicode,
)

__all__ = ["command", "main"]


@interruptible
@failing
def command(
    episode: Annotated[
        str,
        typer.Argument(callback=unicode, help="The episode's code or id.", show_default=False),
    ],
    url: UrlOption = None,
    host: HostOption = SERVER_HOST,
    port: PortOption = SERVER_PORT,
    name: Annotated[str, typer.Option(callback=unicode, help="The spectator's name.")] = "lsl",
    token: TokenOption = None,
    version: VersionOption = False,
) -> None:
    """Watch an episode, and give its steps and actions to the Lab Streaming Layer until it is
    over."""
    import asyncio

    from robotouille_client.client import connect
    from robotouille_client.game import Game
    from robotouille_client.lsl.outlets import Outlets, load_pylsl, open_outlets
    from robotouille_client.lsl.stream import stream

    pylsl = load_pylsl()
    where = server_url(url, host, port)

    def opening(game: Game, offsets: list[float]) -> Outlets:
        tell(printable(f"streams {game.episode}: {game.world.task.name}"), err=True)
        return open_outlets(pylsl, game.episode, game.world.task.name, where, offsets)

    async def run() -> Game:
        async with connect(where, name=name, token=token) as client:
            return await stream(client, episode, opening)

    game = asyncio.run(run())
    reason = game.outcome["reason"] if game.outcome else "the connection is over"
    tell(printable(f"over at step {game.step}: {reason}"), err=True)


def main() -> None:
    """The entry point of `robotouille-lsl`."""
    application = typer.Typer(add_completion=False, rich_markup_mode="rich")
    application.command()(command)
    application()


if __name__ == "__main__":
    main()
