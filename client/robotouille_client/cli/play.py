"""Command `robotouille play`: play in a window without a server."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille.files.writing import check_file
from robotouille.terminal import one_of, options_from
from robotouille.world.lint import sound_task
from robotouille_client.bots.kinds import OfferedBot
from robotouille_client.console import (
    LenientOption,
    RenderingOption,
    check_look,
    failing,
    folder,
    interruptible,
)

if TYPE_CHECKING:
    from robotouille_client.window.app.local_game import GameSetup


@dataclass(frozen=True, kw_only=True)
class PlayOptions:
    """Options of `robotouille play`."""

    mode: Annotated[Clock, typer.Option(parser=one_of(Clock), help="Clock of the episode.")] = (
        Clock.REALTIME
    )
    seats: Annotated[int | None, typer.Option(help="Number of seats.")] = None
    partner: Annotated[
        OfferedBot,
        typer.Option(
            parser=one_of(OfferedBot),
            help="Bots that play the other seats: planners with the skill of a learner, partner or "
            "expert, or random ones.",
        ),
    ] = OfferedBot.PARTNER
    step_rate: Annotated[float, typer.Option(help="Steps per second in real time.")] = 5.0
    timing: Annotated[
        str | None,
        typer.Option(help="Timing profile: benchmark or people. Default in real time: people."),
    ] = None
    max_steps: Annotated[
        int | None,
        typer.Option(
            help="Step limit. Default: six times the shortest plan, but at least three minutes."
        ),
    ] = None
    seed: Annotated[int, typer.Option(help="Seed of all random choices.", min=0, max=2**53)] = 0
    size: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT in pixels. Default: the last size.")
    ] = None
    lenient: LenientOption = False
    rendering: RenderingOption = ""
    screenshot: Annotated[
        Path | None, typer.Option(help="Save one picture without opening a window, and exit.")
    ] = None
    tasks: Annotated[
        Path | None,
        typer.Option(
            callback=folder,
            help="Folder of your own kitchens, with the pictures for their replays. Default: the "
            "folder of TASK.",
        ),
    ] = None


@interruptible
@failing
@options_from(PlayOptions)
def play(
    options: PlayOptions,
    task: Annotated[
        str | None, typer.Argument(help="Task name or problem file. Default: show a menu.")
    ] = None,
) -> None:
    """Play a task in a window, without a server. Bots play the other seats.

    Finished games are recorded and listed in the menu under "Replays".
    """
    import asyncio

    from robotouille_client.window import require_pygame

    require_pygame()
    from robotouille_client.window.app.local_game import GameSetup

    rendering, size, tasks = options.rendering, options.size, options.tasks
    setup = task and GameSetup(
        task,
        options.seats,
        options.mode,
        options.step_rate,
        options.partner,
        options.timing,
        options.max_steps,
        options.seed,
    )
    check_look(setup.load() if setup else None, rendering, options.lenient)
    if options.screenshot is not None:
        if not setup:
            raise RobotouilleError("--screenshot needs a task")
        _picture(setup, size or "1280x720", options.screenshot, rendering)
        return
    if setup:
        sound_task(setup.load())
    from robotouille_client.window import StartOptions, open_app

    if tasks is None and task is not None and task.partition("@")[0].endswith(".json"):
        tasks = Path(task).parent
    app = open_app(StartOptions(size=size, rendering=rendering, tasks=tasks))
    asyncio.run(app.run(app.local.play(setup) if setup else None))


def _picture(setup: GameSetup, size: str, path: Path, rendering: str) -> None:
    from robotouille_client.window import parse_size
    from robotouille_client.window.app.local_game import LocalGame
    from robotouille_client.window.options import DisplayOptions, WindowStyle
    from robotouille_client.window.preferences import Preferences
    from robotouille_client.window.window import Window

    check_file(path, "--screenshot")
    game = LocalGame(replace(setup, countdown=0.0), "you", time.monotonic, None)
    window = Window(
        DisplayOptions(parse_size(size), headless=True),
        style=WindowStyle(Preferences(rendering=rendering)),
    )
    try:
        window.frame(game.source)
        window.screenshot(path)
    finally:
        window.close()
        game.finish(ended=False)
