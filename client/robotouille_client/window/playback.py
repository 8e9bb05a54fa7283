"""Recordings on the screen and on film."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from robotouille.errors import RobotouilleError
from robotouille.replay.recording import Recording
from robotouille.world.unmet import from_words
from robotouille_client.window import require_pygame, require_screen

__all__ = ["film", "parse_size", "watch"]

T = TypeVar("T")
FPS = 24


def parse_size(size: str) -> tuple[int, int]:
    """`1280x720` as two numbers; RobotouilleError if it is anything else."""
    width, _, height = size.lower().partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise RobotouilleError(f"a size is WIDTHxHEIGHT, e.g. 1280x720; found {size!r}")
    if not (160 <= int(width) <= 4096 and 120 <= int(height) <= 4096):
        raise RobotouilleError(f"a size is between 160x120 and 4096x4096; found {size!r}")
    return int(width), int(height)


def watch(recording: Recording, speed: float) -> None:
    """Show a recording in a window until it is closed."""
    require_pygame()
    require_screen()
    from robotouille_client.window.sources.replay import ReplaySource
    from robotouille_client.window.window import Window

    source = ReplaySource(recording, speed, time.monotonic)
    keys = {"space": source.pause, "left": lambda: source.seek(-1), "right": lambda: source.seek(1)}
    window = Window(caption=f"Robotouille: {recording.task.name}", extra_keys=keys)
    asyncio.run(window.run(source, linger=None))


def film(recording: Recording, output: Path, speed: float, size: str) -> int:
    """Write a recording as a video; returns the number of frames."""
    require_pygame()
    from robotouille_client.window.sources.replay import NOTICE_SECONDS, notices_at, seats_at
    from robotouille_client.window.sources.texts import outcome_words
    from robotouille_client.window.video import frames_of, write_video
    from robotouille_client.window.view import Bubble

    bubbles: dict[int, tuple[Bubble, ...]] = {}
    for note in recording.notes():
        if note["note"] in ("said", "rejected") and note["step"] is not None and note["player"]:
            if note["note"] == "said":
                bubble = Bubble(note["player"], note["text"], "chat")
            else:
                bubble = Bubble.rejection(note["player"], from_words(*note["reasons"]))
            for step in range(note["step"], note["step"] + 3):
                bubbles[step] = (*bubbles.get(step, ()), bubble)
    fps = 12 if output.suffix == ".gif" else FPS
    frames = frames_of(
        recording.states(),
        size=parse_size(size),
        frames_per_step=max(1, round(fps / speed)),
        seats=seats_at(recording),
        bubbles=bubbles,
        notices=notices_at(recording, round(speed * NOTICE_SECONDS)),
        max_steps=recording.header["rules"]["max_steps"],
        outcome=outcome_words(recording.outcome) if recording.outcome else "",
        hold=2 * fps,
    )
    total = (len(recording.steps) + 1) * max(1, round(fps / speed)) + 2 * fps
    try:
        return write_video(output, _progress(frames, total, output.name), fps)
    except ValueError as error:
        raise RobotouilleError(str(error)) from None
    except OSError as error:
        raise RobotouilleError(f"{output}: cannot be written: {error.strerror}") from None


def _progress(items: Iterable[T], total: int, what: str) -> Iterator[T]:
    """The same items, with a progress bar on a terminal."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    quiet = not console.is_terminal
    yield from track(items, what, total=total, console=console, disable=quiet, transient=True)
