"""`robotouille-client`: a window onto an episode of a server."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robotouille.absence import Absence
from robotouille.errors import RobotouilleError
from robotouille.program import VersionOption, printable, tell
from robotouille_client.console import TokenOption, explain, fail, server_url

if TYPE_CHECKING:
    from robotouille_client.client import Client
    from robotouille_client.game import Game
    from robotouille_client.window.pictures.kitchen_look import KitchenLook

__all__ = ["main"]


class SubstituteKind(StrEnum):
    """Bots that play for somebody who is away."""

    PLANNER = "planner"
    RANDOM = "random"


@dataclass(frozen=True, slots=True)
class Opening:
    """The episode to open: its task and the rules that are not left to the server."""

    task: str
    rules: dict[str, object]


def _opening(task: str | None, **rules: object) -> Opening | None:
    """What to open; RobotouilleError where rules are given for nothing."""
    given = {name: value for name, value in rules.items() if value is not None}
    if task is not None:
        return Opening(task, given)
    if given:
        option = next(iter(given)).replace("_", "-")
        raise RobotouilleError(f"--{option} is for an episode that you open: name a --create TASK")
    return None


async def _find_code(client: Client, opening: Opening | None) -> str:
    """A new episode's code, or that of the first one which waits for players."""
    if opening is not None:
        return (await client.create(opening.task, **opening.rules)).code
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
    look: KitchenLook | None,
) -> None:
    import asyncio

    from robotouille_client.window.replay.spectator import Spectator
    from robotouille_client.window.sources.remote import RemoteSource
    from robotouille_client.window.window import Window

    loop = asyncio.get_running_loop()
    language = None if look is None else look.rendering.language
    watched = None if game.own_seats else Spectator(game, loop.time, connected, language)
    source = watched or RemoteSource(game, loop.time, connected, language)
    strip = watched.strip if watched else None
    caption = f"Robotouille {game.code}"
    window = Window(
        size, caption=caption, headless=headless, look=look, strip=strip, clock=loop.time
    )
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
    token: str | None,
    opening: Opening | None,
    **show: object,
) -> None:
    import asyncio

    from robotouille_client.client import connect
    from robotouille_client.console.kept_seat import came_back, keep_seat, kept_seat, state_folder
    from robotouille_client.window.sources.remote_look import fetch_look

    if code is None:
        async with connect(url, name=name, kind="human", token=token) as client:
            code = await _find_code(client, opening)
    role: Literal["player", "spectator"] = "spectator" if watch else "player"
    with kept_seat(state_folder(), url, code, name) as kept:
        asked = (seat,) if seat is not None else ()
        resume = kept.token_for(asked) if kept is not None and not watch else None
        async with connect(url, name=name, kind="human", token=token, resume=resume) as client:
            game = await client.join(code, seat=seat, role=role)
            if not watch and (back := came_back(client, game, kept)):
                tell(printable(f"came back into {back}"), err=True)
            does = "watches" if watch else f"plays {game.seat}"
            tell(printable(f"{game.name or name} {does} in {game.code}"), err=True)
            keeping = asyncio.create_task(keep_seat(client, game, None if watch else kept))
            try:
                with TemporaryDirectory(prefix="robotouille-") as folder:
                    look = await fetch_look(client, Path(folder))
                    await _show(game, client.connected.is_set, look=look, **show)  # type: ignore[arg-type]
            finally:
                keeping.cancel()


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
    absence: Annotated[
        Absence | None,
        typer.Option(help="What happens in the episode to open while a participant is away."),
    ] = None,
    stand_in: Annotated[
        SubstituteKind | None,
        typer.Option(help="The bot that plays meanwhile, with --absence bot."),
    ] = None,
    grace: Annotated[
        float | None, typer.Option(help="Seconds for which an absent one's seat is kept.")
    ] = None,
    token: TokenOption = None,
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
    version: VersionOption = False,
) -> None:
    """Play or watch an episode in a window. Click to walk, take and put; H shows the keys."""
    import asyncio

    from pydantic import ValidationError

    from robotouille_client.window import parse_size, require_pygame, require_screen

    try:
        require_pygame()
        if not headless:
            require_screen()
        if headless and linger is None:
            linger = 1.0
        opening = _opening(
            create, seats=seats, absence=absence, stand_in=stand_in and stand_in.value, grace=grace
        )
        asyncio.run(
            _run(
                server_url(url, host, port), code, name, seat, watch, token, opening,
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
