"""Command `robotouille-client`: play or watch in a window."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Coroutine, Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robotouille.episode.lifecycle import Absence
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.terminal import one_of, options_from
from robotouille_client.console import (
    SERVER_HOST,
    SERVER_PORT,
    HostOption,
    LenientOption,
    PortOption,
    RenderingOption,
    TokenOption,
    UrlOption,
    VersionOption,
    check_look,
    explain,
    failing,
    finite,
    folder,
    interruptible,
    server_url,
    unicode,
)

if TYPE_CHECKING:
    from robotouille_client.client import Client
    from robotouille_client.window.app.remote_game import RemoteGame
    from robotouille_client.window.app.remote_games import RemoteGames
    from robotouille_client.window.preferences import Preferences

PLAYER, WATCHER = "player", "watcher"
SIZE = "1280x720"


class SubstituteKind(StrEnum):
    """Bots that can play for an absent participant."""

    PLANNER = "planner"
    RANDOM = "random"


@dataclass(frozen=True, slots=True)
class Opening:
    """Episode to open: its task, and the rules that differ from the server's settings."""

    task: str
    rules: dict[str, object]


@dataclass(frozen=True, slots=True)
class JoinOptions:
    """Options for entering an episode on a server.

    Without a `code`, enter the `opening`, or else the first episode that waits for players.
    """

    url: str
    code: str | None
    opening: Opening | None
    seat: str | None
    watch: bool
    token: str | None
    ready: bool


@dataclass(frozen=True, slots=True)
class Unattended:
    """Options of a window that nobody uses.

    It closes `linger` seconds after the end, and saves a picture at a step or at the end.
    """

    size: tuple[int, int]
    preferences: Preferences
    headless: bool
    linger: float | None
    screenshot: Path | None
    screenshot_step: int | None


async def _find_code(client: Client, entry: JoinOptions) -> str:
    """Open an episode, or find the first one that waits for players; return its code."""
    from robotouille_client.window.app.server_menus import require_whole_kitchens

    if entry.opening is not None:
        if not entry.watch:
            require_whole_kitchens(client)
        return (await client.create(entry.opening.task, **entry.opening.rules)).code
    waiting = await client.waiting_episode(partial=entry.watch)
    if waiting is None:
        raise RobotouilleError(
            "no episode is waiting for players; use --create TASK, or watch one by its code"
        )
    return waiting.code


async def run_unattended(entry: JoinOptions, name: str, shown: Unattended) -> None:
    """Enter an episode, and show it until the window closes.

    Raises:
        RobotouilleError: The server refused the participant, or removed them before the end.
    """
    from robotouille_client.client import connect
    from robotouille_client.window.app.remote_game import remote_game

    code = entry.code
    if code is None:
        async with connect(entry.url, name=name, kind="human", token=entry.token) as client:
            code = await _find_code(client, entry)
    opened = remote_game(
        entry.url, code, name, seat=entry.seat, watch=entry.watch, token=entry.token
    )
    async with contextlib.AsyncExitStack() as stack:
        with _pointing_at_watch():
            entered = await stack.enter_async_context(opened)
        await _show(entered, shown)
        game = entered.game
        if game.ended and game.outcome is None:
            raise RobotouilleError(game.farewell or "the connection was lost")


async def _show(entered: RemoteGame, shown: Unattended) -> None:
    import asyncio

    from robotouille_client.window.app.local_game import recordings_folder
    from robotouille_client.window.app.remote_game import views_of
    from robotouille_client.window.options import DisplayOptions, TimeSource, WindowStyle
    from robotouille_client.window.window import Window

    loop, game, screenshot = asyncio.get_running_loop(), entered.game, shown.screenshot
    connected = entered.client.connected.is_set
    source, strip, _ = views_of(game, loop.time, connected, entered.look)
    window = Window(
        DisplayOptions(
            shown.size,
            f"Robotouille {game.code}",
            headless=shown.headless,
            screenshots=recordings_folder(),
        ),
        style=WindowStyle(shown.preferences, entered.look, strip=strip),
        time_source=TimeSource(loop.time),
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


@dataclass(frozen=True, slots=True)
class ClientOptions:
    """Flags of `robotouille-client`."""

    host: HostOption = SERVER_HOST
    port: PortOption = SERVER_PORT
    url: UrlOption = None
    name: Annotated[
        str | None,
        typer.Option(
            callback=unicode, help="Your name, as others see it. Default: the name in the settings."
        ),
    ] = None
    seat: Annotated[str | None, typer.Option(help="The seat to take, e.g. robot2.")] = None
    watch: Annotated[bool, typer.Option(help="Watch instead of playing.")] = False
    ready: Annotated[bool, typer.Option(help="Be ready at once, without pressing a key.")] = False
    create: Annotated[str | None, typer.Option(help="Open an episode of this task.")] = None
    seats: Annotated[int | None, typer.Option(help="With --create: the number of seats.")] = None
    absence: Annotated[
        Absence | None,
        typer.Option(
            parser=one_of(Absence), help="With --create: what happens while a participant is away."
        ),
    ] = None
    substitute: Annotated[
        SubstituteKind | None,
        typer.Option(
            parser=one_of(SubstituteKind),
            help="With --absence bot: the bot that plays for an absent participant.",
        ),
    ] = None
    grace: Annotated[
        float | None,
        typer.Option(help="With --create: seconds for which an absent participant's seat is kept."),
    ] = None
    token: TokenOption = None
    menu: Annotated[
        bool | None,
        typer.Option(
            "--menu/--no-menu",
            help="Whether to show a menu after the game or close the window. Default: close it "
            "only if CODE and a token are given.",
        ),
    ] = None
    size: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT in pixels. Default: the last size.")
    ] = None
    rendering: RenderingOption = ""
    lenient: LenientOption = False
    headless: Annotated[bool, typer.Option(help="Draw without a screen.")] = False
    screenshot: Annotated[
        Path | None,
        typer.Option(help="Save a picture to this path at the end, or at --screenshot-step."),
    ] = None
    screenshot_step: Annotated[
        int | None, typer.Option(help="The step at which to save the picture.")
    ] = None
    tasks: Annotated[
        Path | None,
        typer.Option(
            callback=folder, help="Folder of your own kitchens, whose pictures replays of them use."
        ),
    ] = None
    linger: Annotated[
        float | None,
        typer.Option(
            min=0,
            callback=finite,
            help="Close this many seconds after the end. Default: stay open.",
        ),
    ] = None
    version: VersionOption = False

    @property
    def opening(self) -> Opening | None:
        """The episode to open.

        Raises:
            RobotouilleError: There are rules for an episode but no task.
        """
        rules: dict[str, object] = {
            "seats": self.seats,
            "absence": self.absence,
            "substitute": self.substitute and self.substitute.value,
            "grace": self.grace,
        }
        given = {name: value for name, value in rules.items() if value is not None}
        if self.create is not None:
            return Opening(self.create, given)
        if given:
            raise RobotouilleError(f"--{next(iter(given))} requires --create TASK")
        return None

    @property
    def unattended(self) -> Unattended | None:
        """Options of a window that closes by itself; None if a person uses the window."""
        from robotouille_client.window import parse_size
        from robotouille_client.window.preferences import Preferences

        if not (self.headless or self.screenshot is not None or self.linger is not None):
            return None
        return Unattended(
            parse_size(self.size or SIZE),
            Preferences(rendering=self.rendering),
            self.headless,
            1.0 if self.headless and self.linger is None else self.linger,
            self.screenshot,
            self.screenshot_step,
        )


def _code(value: str | None) -> str | None:
    """Reject an empty code, such as that of a script whose variable is not set."""
    if value is not None and not value.strip():
        raise typer.BadParameter("the code is empty; leave it out to see the menu")
    return unicode(value)


@interruptible
@failing
@options_from(ClientOptions)
def command(
    options: ClientOptions,
    code: Annotated[
        str | None,
        typer.Argument(callback=_code, help="Code of the episode to join; hosts may use its id."),
    ] = None,
) -> None:
    """Play or watch an episode in a window; without arguments, show a menu. H shows the keys."""
    from robotouille_client.window import require_pygame, require_screen

    require_pygame()
    if not options.headless:
        require_screen()
    check_look(None, options.rendering, options.lenient)
    entry = JoinOptions(
        server_url(options.url, options.host, options.port),
        code,
        options.opening,
        options.seat,
        options.watch,
        options.token,
        options.ready,
    )
    shown = options.unattended
    if shown is not None:
        name = options.name or (WATCHER if options.watch else PLAYER)
        _run_until_stopped(run_unattended(entry, name, shown))
        return
    default_server = (options.host, options.port) == (SERVER_HOST, SERVER_PORT)
    named = (code, options.create, options.url, options.seat) != (None,) * 4
    enters = named or options.watch or not default_server
    menu = options.menu
    if menu is None:
        # A study gives its participants a code and a token, and wants no menu after the game.
        menu = code is None or options.token is None
    if not (menu or enters):
        raise RobotouilleError("--no-menu requires the CODE of an episode")

    from robotouille_client.window import StartOptions, open_app

    app = open_app(
        StartOptions(
            size=options.size,
            name=options.name,
            server=None if options.url is None and default_server else entry.url,
            token=options.token,
            menu=menu,
            rendering=options.rendering,
            tasks=options.tasks,
        )
    )
    _run_until_stopped(app.run(_enter(app.remote, entry) if enters else None))


async def _enter(games: RemoteGames, entry: JoinOptions) -> object:
    """Show the requested episode."""
    code = entry.code
    if code is None:
        code = await games.ask_server(lambda client: _find_code(client, entry), entry.url)
    if not code:
        return None
    with _pointing_at_watch():
        return await games.join(
            code, watch=entry.watch, seat=entry.seat, url=entry.url, ready=entry.ready
        )


@contextlib.contextmanager
def _pointing_at_watch() -> Iterator[None]:
    """Mention --watch in the error if the episode has no free seat."""
    try:
        yield
    except ProtocolError as error:
        from robotouille.protocol.error_codes import ErrorCode

        if error.code != ErrorCode.EPISODE_FULL:
            raise
        raise RobotouilleError(f"{explain(error)}; use --watch to watch it") from error


def _run_until_stopped(work: Coroutine[Any, Any, None]) -> None:
    # SDL treats SIGTERM as a click on the window's close button. A player who closes the window
    # gives up the seat, but a stopped process must keep it. So SIGTERM cancels the work instead.
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
    """Run `robotouille-client`."""
    typer.run(command)


if __name__ == "__main__":
    main()
