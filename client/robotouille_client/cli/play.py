"""`robotouille play TASK`: play in a window without a server."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille.world.lint import sound_task
from robotouille_client.bots.kinds import BotKind
from robotouille_client.console import (
    LenientOption,
    RenderingOption,
    check_look,
    failing,
    interruptible,
)

if TYPE_CHECKING:
    from robotouille_client.window.shell.games.local_game import GameSetup

__all__ = ["play"]


@interruptible
@failing
def play(
    task: Annotated[
        str | None, typer.Argument(help="Task name or problem file; none: a menu.")
    ] = None,
    mode: Annotated[Clock, typer.Option(help="Clock.")] = Clock.REALTIME,
    seats: Annotated[int | None, typer.Option(help="Number of seats.")] = None,
    partner: Annotated[BotKind, typer.Option(help="Who plays the other seats.")] = BotKind.PLANNER,
    step_rate: Annotated[float, typer.Option(help="Steps a second in real time.")] = 5.0,
    timing: Annotated[
        str | None, typer.Option(help="benchmark or people; people in real time by default.")
    ] = None,
    max_steps: Annotated[
        int | None,
        typer.Option(help="Step limit; else six times the shortest plan, three minutes at least."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of everything random.")] = 0,
    size: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT in pixels; else as it was last.")
    ] = None,
    lenient: LenientOption = False,
    rendering: RenderingOption = "",
    screenshot: Annotated[
        Path | None, typer.Option(help="Draw without a screen, save one picture and exit.")
    ] = None,
    tasks: Annotated[
        Path | None,
        typer.Option(help="A folder of own kitchens, whose replays have its pictures; TASK's own."),
    ] = None,
) -> None:
    """Play a task in a window, without a server. Bots play the other seats.

    Games that are played to their end are recorded: the menu has them under "Replays".
    """
    import asyncio

    from robotouille_client.window import require_pygame

    require_pygame()
    if partner is BotKind.SCRIPTED:
        raise RobotouilleError("partners are random or planner bots")
    from robotouille_client.window.shell.games.local_game import GameSetup

    setup = task and GameSetup(task, seats, mode, step_rate, partner, timing, max_steps, seed)
    check_look(setup.load() if setup else None, rendering, lenient)
    if screenshot is not None:
        if not setup:
            raise RobotouilleError("a picture is of a task: name one")
        _picture(setup, size or "1280x720", screenshot, rendering)
        return
    if setup:
        sound_task(setup.load())
    from robotouille_client.window.shell.starting import open_shell

    if tasks is None and task is not None and task.partition("@")[0].endswith(".json"):
        tasks = Path(task).parent
    shell = open_shell(size=size, rendering=rendering, tasks=tasks)
    asyncio.run(shell.run(shell.local.play(setup) if setup else None))


def _picture(setup: GameSetup, size: str, path: Path, rendering: str) -> None:
    """Save a game's first picture."""
    from robotouille_client.window import parse_size
    from robotouille_client.window.preferences import Preferences
    from robotouille_client.window.shell.games.local_game import LocalGame
    from robotouille_client.window.window import Window

    if not path.parent.is_dir():
        raise RobotouilleError(f"there is no folder {path.parent}")
    game = LocalGame(replace(setup, countdown=0.0), "you", time.monotonic, None)
    window = Window(parse_size(size), headless=True, preferences=Preferences(rendering=rendering))
    try:
        window.frame(game.source)
        window.screenshot(path)
    finally:
        window.close()
        game.finish(over=False)
