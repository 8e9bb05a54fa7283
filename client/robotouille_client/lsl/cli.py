"""Command `robotouille-lsl`: stream an episode to the Lab Streaming Layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from robotouille.terminal import options_from, printable, tell
from robotouille_client.console import (
    ServerOptions,
    VersionOption,
    failing,
    interruptible,
    unicode,
)


@dataclass(frozen=True, kw_only=True)
class LslOptions(ServerOptions):
    """Options of `robotouille-lsl`."""

    name: Annotated[str, typer.Option(callback=unicode, help="Name of the spectator.")] = "lsl"
    version: VersionOption = False


@interruptible
@failing
@options_from(LslOptions)
def command(
    episode: Annotated[
        str,
        typer.Argument(callback=unicode, help="Code or id of the episode.", show_default=False),
    ],
    options: LslOptions,
) -> None:
    """Watch an episode, and stream its steps and actions to the Lab Streaming Layer."""
    import asyncio

    from robotouille_client.client import connect
    from robotouille_client.game import Game
    from robotouille_client.lsl.stream import Outlets, load_pylsl, open_outlets, stream

    pylsl = load_pylsl()
    where = options.address

    def opening(game: Game, offsets: list[float]) -> Outlets:
        tell(printable(f"streaming {game.episode}: {game.world.task.name}"), err=True)
        return open_outlets(pylsl, game.episode, game.world.task.name, where, offsets)

    async def run() -> Game:
        async with connect(where, name=options.name, token=options.token) as client:
            return await stream(client, episode, opening)

    game = asyncio.run(run())
    reason = game.outcome["reason"] if game.outcome else "the connection was lost"
    tell(printable(f"ended at step {game.step}: {reason}"), err=True)


def main() -> None:
    """Run `robotouille-lsl`."""
    application = typer.Typer(add_completion=False, rich_markup_mode="rich")
    application.command()(command)
    application()


if __name__ == "__main__":
    main()
