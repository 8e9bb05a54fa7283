"""`robotouille-client`: a window onto an episode of a server."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robotouille.absence import Absence
from robotouille.errors import RobotouilleError
from robotouille.program import VersionOption
from robotouille_client.console import (
    LenientOption,
    RenderingOption,
    TokenOption,
    check_look,
    explain,
    fail,
    server_url,
)

if TYPE_CHECKING:
    from robotouille_client.client import Client
    from robotouille_client.game import Game
    from robotouille_client.window.pictures.kitchen_look import KitchenLook

__all__ = ["main"]

HERE = ("127.0.0.1", 8765)
PLAYER, WATCHER = "player", "watcher"
SIZE = "1280x720"


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
    rendering: str,
) -> None:
    import asyncio

    from robotouille_client.window.preferences import Preferences
    from robotouille_client.window.shell.games.remote_game import shown
    from robotouille_client.window.window import Window

    loop = asyncio.get_running_loop()
    source, strip, _ = shown(game, loop.time, connected, look)
    caption = f"Robotouille {game.code}"
    window = Window(
        size,
        caption=caption,
        headless=headless,
        look=look,
        preferences=Preferences(rendering=rendering),
        strip=strip,
        clock=loop.time,
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
    from robotouille_client.client import connect
    from robotouille_client.window.shell.games.remote_game import remote_game

    if code is None:
        async with connect(url, name=name, kind="human", token=token) as client:
            code = await _find_code(client, opening)
    opened = remote_game(url, code, name, seat=seat, watch=watch, token=token)
    async with opened as entered:
        connected = entered.client.connected.is_set
        await _show(entered.game, connected, look=entered.look, **show)  # type: ignore[arg-type]


def command(
    code: Annotated[str | None, typer.Argument(help="Code or id of the episode to join.")] = None,
    host: Annotated[str, typer.Option(help="The server's host.")] = HERE[0],
    port: Annotated[int, typer.Option(help="The server's port.")] = HERE[1],
    url: Annotated[str | None, typer.Option(help="The server's URL, instead of both.")] = None,
    name: Annotated[
        str | None, typer.Option(help="Your name, as others see it; else that of the settings.")
    ] = None,
    seat: Annotated[str | None, typer.Option(help="The seat to take, e.g. robot2.")] = None,
    watch: Annotated[bool, typer.Option(help="Watch instead of play.")] = False,
    ready: Annotated[
        bool, typer.Option(help="Be ready at once, without pressing a key before the game.")
    ] = False,
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
    menu: Annotated[
        bool | None,
        typer.Option(
            "--menu/--no-menu",
            help="A menu when the game is over; else the window closes, as it does after a CODE "
            "with a token if nothing is said.",
        ),
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT in pixels; else as it was last.")
    ] = None,
    rendering: RenderingOption = "",
    lenient: LenientOption = False,
    headless: Annotated[bool, typer.Option(help="Draw without a screen.")] = False,
    screenshot: Annotated[
        Path | None, typer.Option(help="Save a picture here at the end (or --screenshot-step).")
    ] = None,
    screenshot_step: Annotated[
        int | None, typer.Option(help="Save the picture at this step already.")
    ] = None,
    tasks: Annotated[
        Path | None, typer.Option(help="A folder of own kitchens, whose replays have its pictures.")
    ] = None,
    linger: Annotated[
        float | None,
        typer.Option(help="Close so many seconds after the end; else when you close it."),
    ] = None,
    version: VersionOption = False,
) -> None:
    """Play or watch an episode in a window; without arguments, a menu. H shows the keys."""
    from pydantic import ValidationError

    from robotouille_client.window import parse_size, require_pygame, require_screen

    try:
        require_pygame()
        if not headless:
            require_screen()
        check_look(None, rendering, lenient)
        if headless and linger is None:
            linger = 1.0
        opening = _opening(
            create, seats=seats, absence=absence, stand_in=stand_in and stand_in.value, grace=grace
        )
        address = server_url(url, host, port)
        if headless or screenshot is not None or linger is not None:
            _run_until_stopped(
                _run(
                    address, code, name or (WATCHER if watch else PLAYER), seat, watch, token,
                    opening,
                    size=parse_size(size or SIZE), headless=headless, screenshot=screenshot,
                    screenshot_step=screenshot_step, linger=linger, rendering=rendering,
                )
            )  # fmt: skip
            return
        asked = (code, create, url, seat) != (None,) * 4 or watch or (host, port) != HERE
        if menu is None:
            menu = code is None or token is None
        if not (menu or asked):
            raise RobotouilleError("without a menu there is nothing to show: name a CODE")
        _open_shell(
            address, code, name, seat, watch, token, opening, size, rendering, tasks, asked=asked,
            menu=menu, ready=ready,
        )  # fmt: skip
    except (RobotouilleError, ValidationError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None


def _open_shell(
    address: str,
    code: str | None,
    name: str | None,
    seat: str | None,
    watch: bool,
    token: str | None,
    opening: Opening | None,
    size: str | None,
    rendering: str,
    tasks: Path | None,
    *,
    asked: bool,
    menu: bool,
    ready: bool,
) -> None:
    """The window with its menu, if it has one; first the episode that was asked for."""
    from robotouille_client.window.shell.starting import open_shell

    shell = open_shell(
        size=size, name=name, token=token, menu=menu, rendering=rendering, tasks=tasks
    )
    games = shell.remote

    async def first() -> object:
        found = code
        if found is None:
            found = await games.ask_server(lambda client: _find_code(client, opening), address)
        if not found:
            return None
        return await games.join(found, watch=watch, seat=seat, url=address, ready=ready)

    _run_until_stopped(shell.run(first() if asked else None))


def _run_until_stopped(work: Coroutine[Any, Any, None]) -> None:
    """Run something to its end, or until SIGTERM: SDL would take that for a click on the window's
    ×, and whoever closes the window gives up a seat that a process which is stopped keeps."""
    import asyncio

    async def stoppable() -> None:
        task = asyncio.current_task()
        if task is not None:
            with contextlib.suppress(NotImplementedError):  # Windows has no such signals.
                asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
        await work

    try:
        asyncio.run(stoppable())
    except asyncio.CancelledError:
        raise typer.Exit(128 + signal.SIGTERM) from None


def main() -> None:
    """The entry point of `robotouille-client`."""
    typer.run(command)


if __name__ == "__main__":
    main()
