"""`robotouille-client`: a window onto an episode of a server."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from robotouille.errors import RobotouilleError
from robotouille_client.cli.console import explain, fail, server_url
from robotouille_client.connection import Client, connect
from robotouille_client.game import Game

__all__ = ["main"]


async def _find_code(client: Client, create: str | None, seats: int | None) -> str:
    """A new episode's code, or that of the first one which waits for players."""
    if create is not None:
        return (await client.create(create, seats=seats)).code
    for info in await client.episodes():
        if info.phase == "waiting":
            return info.code
    raise RobotouilleError(
        "no episode waits for players; open one with --create TASK, or watch one by its code"
    )


async def _show(
    game: Game,
    connected: Callable[[], bool],
    size: tuple[int, int],
    headless: bool,
    screenshot: Path | None,
    screenshot_step: int | None,
    linger: float | None,
) -> None:
    from robotouille_client.window.sources import RemoteSource
    from robotouille_client.window.window import Window

    loop = asyncio.get_running_loop()
    source = RemoteSource(game, loop.time, connected)
    window = Window(size, caption=f"Robotouille {game.code}", headless=headless)
    showing = asyncio.create_task(window.run(source, linger=linger))
    try:
        while not showing.done():
            due = screenshot_step is not None and game.step >= screenshot_step
            if screenshot is not None and (due or game.ended) and window.frames > 1:
                await asyncio.sleep(0.5 if game.ended else 0)
                window.screenshot(screenshot)
                screenshot = None
            await asyncio.sleep(0.05)
    finally:
        if not showing.done():
            showing.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await showing


async def _run(
    url: str,
    code: str | None,
    name: str,
    seat: str | None,
    watch: bool,
    create: str | None,
    seats: int | None,
    **show: object,
) -> None:
    async with connect(url, name=name, kind="human") as client:
        episode = code or await _find_code(client, create, seats)
        game = await client.join(episode, seat=seat, role="spectator" if watch else "player")
        role = "watches" if watch else f"plays {game.seat}"
        typer.echo(f"{name} {role} in {game.code}", err=True)
        await _show(game, client.connected.is_set, **show)  # type: ignore[arg-type]


def command(
    code: Annotated[str | None, typer.Argument(help="Code or id of the episode to join.")] = None,
    host: Annotated[str, typer.Option(help="The server's host.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="The server's port.")] = 8765,
    url: Annotated[str | None, typer.Option(help="The server's URL, instead of both.")] = None,
    name: Annotated[str, typer.Option(help="Your name, as others see it.")] = "player",
    seat: Annotated[str | None, typer.Option(help="The seat to take, e.g. robot2.")] = None,
    watch: Annotated[bool, typer.Option(help="Watch instead of play.")] = False,
    create: Annotated[str | None, typer.Option(help="Open an episode of this task.")] = None,
    seats: Annotated[int | None, typer.Option(help="Seats of the episode to open.")] = None,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1280x720",
    headless: Annotated[bool, typer.Option(help="Draw without a screen.")] = False,
    screenshot: Annotated[
        Path | None, typer.Option(help="Save a picture here at the end (or --screenshot-step).")
    ] = None,
    screenshot_step: Annotated[
        int | None, typer.Option(help="Save the picture at this step already.")
    ] = None,
    linger: Annotated[
        float | None,
        typer.Option(help="Close so many seconds after the end; else when you close it."),
    ] = None,
) -> None:
    """Play or watch an episode in a window. Click to walk, take and put; H shows the keys."""
    from robotouille_client.window import require_pygame, require_screen
    from robotouille_client.window.theatre import parse_size

    try:
        require_pygame()
        if not headless:
            require_screen()
        if headless and linger is None:
            linger = 1.0
        asyncio.run(
            _run(
                server_url(url, host, port), code, name, seat, watch, create, seats,
                size=parse_size(size), headless=headless, screenshot=screenshot,
                screenshot_step=screenshot_step, linger=linger,
            )
        )  # fmt: skip
    except (RobotouilleError, ValidationError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def main() -> None:
    """The entry point of `robotouille-client`."""
    typer.run(command)
