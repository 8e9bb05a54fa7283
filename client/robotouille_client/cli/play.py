"""`robotouille play TASK`: play in a window without a server."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import ValidationError

from robotouille.episode.rules import Clock
from robotouille.errors import RobotouilleError
from robotouille_client.bots.kinds import BotKind, policy_maker
from robotouille_client.bots.names import given_names
from robotouille_client.console import explain, fail

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = ["play"]


COUNTDOWN = 3.0
"""Seconds before a game in real time."""
NO_CERTIFICATE = 1000
"""Steps for a task of which no shortest plan is known."""


def step_limit(task: Task, mode: Clock, step_rate: float) -> int:
    """The steps that somebody gets for a task."""
    from robotouille.certification.step_limit import people_step_limit

    limit = people_step_limit(task, step_rate if mode is Clock.REALTIME else None)
    return limit or NO_CERTIFICATE


def play(
    task: Annotated[str, typer.Argument(help="Task name or problem file.")],
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
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1280x720",
    screenshot: Annotated[
        Path | None, typer.Option(help="Draw without a screen, save one picture and exit.")
    ] = None,
) -> None:
    """Play a task in a window, without a server. Bots play the other seats."""
    import asyncio

    from robotouille import World, load_task
    from robotouille.episode import Episode, Rules
    from robotouille.planning.policies.standing import seat_out_of_the_way
    from robotouille_client.window import parse_size, require_pygame, require_screen

    try:
        require_pygame()
        if screenshot is not None and not screenshot.parent.is_dir():
            raise RobotouilleError(f"there is no folder {screenshot.parent}")
        from robotouille_client.window.sources.local import LocalSource
        from robotouille_client.window.window import Window

        profile = timing or ("people" if mode is Clock.REALTIME else "benchmark")
        world = World(load_task(task, seats=seats, timing=profile, seed=seed))
        limit = step_limit(world.task, mode, step_rate) if max_steps is None else max_steps
        rules = Rules(
            clock=mode,
            step_rate=step_rate,
            max_steps=limit,
            countdown=0.0 if screenshot else COUNTDOWN,
        )
        if partner is BotKind.SCRIPTED:
            raise RobotouilleError("partners are random or planner bots")
        make = policy_maker(partner, seed)
        me = seat_out_of_the_way(world.initial)
        others = [player for player in world.players if player != me]
        names = given_names(seed)
        bots = {p: (names[i], make(world.initial, p)) for i, p in enumerate(others)}
        if screenshot is None:
            require_screen()
        source = LocalSource(Episode(world, rules, time.monotonic()), me, bots, time.monotonic)
        window = Window(
            parse_size(size), caption=f"Robotouille: {world.task.name}", headless=bool(screenshot)
        )
        if screenshot is not None:
            window.frame(source)
            window.screenshot(screenshot)
            window.close()
        else:
            asyncio.run(window.run(source, linger=None))
    except (RobotouilleError, ValidationError, KeyError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
