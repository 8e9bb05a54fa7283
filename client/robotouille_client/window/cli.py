"""`robotouille-client`: a window onto an episode of a server."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Coroutine, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robotouille.absence import Absence
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.program import VersionOption
from robotouille_client.console import (
    SERVER_HOST,
    SERVER_PORT,
    HostOption,
    LenientOption,
    PortOption,
    RenderingOption,
    TokenOption,
    UrlOption,
    check_look,
    explain,
    failing,
    finite,
    interruptible,
    server_url,
    unicode,
)

if TYPE_CHECKING:
    from robotouille_client.client import Client
    from robotouille_client.window.preferences import Preferences
    from robotouille_client.window.shell.games.remote_game import RemoteGame
    from robotouille_client.window.shell.remote_games import RemoteGames

__all__ = ["main"]

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


@dataclass(frozen=True, slots=True)
class JoinOptions:
    """Which episode of a server to enter, and how. Without a `code` it is the one that is opened,
    or the first that waits for players."""

    url: str
    code: str | None
    opening: Opening | None
    seat: str | None
    watch: bool
    token: str | None
    ready: bool


@dataclass(frozen=True, slots=True)
class Unattended:
    """A window that closes by itself, `linger` seconds after the end; a picture of it is saved at a
    step, or at the end."""

    size: tuple[int, int]
    preferences: Preferences
    headless: bool
    linger: float | None
    screenshot: Path | None
    screenshot_step: int | None


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
    waiting = await client.waiting_episode()
    if waiting is None:
        raise RobotouilleError(
            "no episode waits for players; open one with --create TASK, or watch one by its code"
        )
    return waiting.code


async def _run(entry: JoinOptions, name: str, shown: Unattended) -> None:
    """Enter an episode, and show it until the window closes.

    Raises:
        RobotouilleError: There is no way in, or one was out of it before its end.
    """
    from robotouille_client.client import connect
    from robotouille_client.window.shell.games.remote_game import remote_game

    code = entry.code
    if code is None:
        async with connect(entry.url, name=name, kind="human", token=entry.token) as client:
            code = await _find_code(client, entry.opening)
    opened = remote_game(
        entry.url, code, name, seat=entry.seat, watch=entry.watch, token=entry.token
    )
    async with contextlib.AsyncExitStack() as stack:
        with _pointing_at_watch():
            entered = await stack.enter_async_context(opened)
        await _show(entered, shown)
        game = entered.game
        if game.ended and game.outcome is None:
            raise RobotouilleError(game.farewell or "the connection was lost for good")


async def _show(entered: RemoteGame, shown: Unattended) -> None:
    import asyncio

    from robotouille_client.window.shell.games.local_game import recordings_folder
    from robotouille_client.window.shell.games.remote_game import views_of
    from robotouille_client.window.window import Window

    loop, game, screenshot = asyncio.get_running_loop(), entered.game, shown.screenshot
    connected = entered.client.connected.is_set
    source, strip, _ = views_of(game, loop.time, connected, entered.look)
    window = Window(
        shown.size,
        caption=f"Robotouille {game.code}",
        headless=shown.headless,
        look=entered.look,
        preferences=shown.preferences,
        screenshots=recordings_folder(),
        strip=strip,
        clock=loop.time,
    )
    showing = asyncio.create_task(window.run(source, linger=shown.linger))
    try:
        while not showing.done():
            due = shown.screenshot_step is not None and game.step >= shown.screenshot_step
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


@interruptible
@failing
def command(
    code: Annotated[
        str | None, typer.Argument(callback=unicode, help="Code or id of the episode to join.")
    ] = None,
    host: HostOption = SERVER_HOST,
    port: PortOption = SERVER_PORT,
    url: UrlOption = None,
    name: Annotated[
        str | None,
        typer.Option(
            callback=unicode, help="Your name, as others see it; else that of the settings."
        ),
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
        typer.Option(
            min=0,
            callback=finite,
            help="Close so many seconds after the end; else when you close it.",
        ),
    ] = None,
    version: VersionOption = False,
) -> None:
    """Play or watch an episode in a window; without arguments, a menu. H shows the keys."""
    from robotouille_client.window import parse_size, require_pygame, require_screen

    require_pygame()
    if not headless:
        require_screen()
    check_look(None, rendering, lenient)
    opening = _opening(
        create, seats=seats, absence=absence, stand_in=stand_in and stand_in.value, grace=grace
    )
    entry = JoinOptions(server_url(url, host, port), code, opening, seat, watch, token, ready)
    if headless or screenshot is not None or linger is not None:
        from robotouille_client.window.preferences import Preferences

        shown = Unattended(
            parse_size(size or SIZE), Preferences(rendering=rendering), headless,
            1.0 if headless and linger is None else linger, screenshot, screenshot_step,
        )  # fmt: skip
        whom = name or (WATCHER if watch else PLAYER)
        _run_until_stopped(_run(entry, whom, shown))
        return
    here = (host, port) == (SERVER_HOST, SERVER_PORT)
    asked = (code, create, url, seat) != (None,) * 4 or watch or not here
    if menu is None:
        menu = code is None or token is None
    if not (menu or asked):
        raise RobotouilleError("without a menu there is nothing to show: name a CODE")

    from robotouille_client.window.shell.starting import open_shell

    shell = open_shell(
        size=size, name=name, server=None if url is None and here else entry.url, token=token,
        menu=menu, rendering=rendering, tasks=tasks,
    )  # fmt: skip
    _run_until_stopped(shell.run(_enter(shell.remote, entry) if asked else None))


async def _enter(games: RemoteGames, entry: JoinOptions) -> object:
    """What the window shows first: the episode that was asked for."""
    code = entry.code
    if code is None:
        code = await games.ask_server(lambda client: _find_code(client, entry.opening), entry.url)
    if not code:
        return None
    with _pointing_at_watch():
        return await games.join(
            code, watch=entry.watch, seat=entry.seat, url=entry.url, ready=entry.ready
        )


@contextlib.contextmanager
def _pointing_at_watch() -> Iterator[None]:
    """Who finds no free seat is told what can be done without one."""
    try:
        yield
    except ProtocolError as error:
        from robotouille.protocol.error_codes import ErrorCode

        if error.code != ErrorCode.EPISODE_FULL:
            raise
        raise RobotouilleError(f"{explain(error)}: --watch shows the game") from error


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
