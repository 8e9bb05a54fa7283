"""A history, or a span of it, as a video."""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path

import pygame

from robotouille.errors import RobotouilleError
from robotouille.world.world import State
from robotouille_client.window import parse_size
from robotouille_client.window.pictures.kitchen_look import KitchenLook
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.source import NOTICE_SECONDS, bubbles_at, notices_at
from robotouille_client.window.sources.texts import outcome_words
from robotouille_client.window.video import VIDEOS, frames_of, writing_video

__all__ = ["draft_of", "film", "filming"]

FPS = 24
GIF_FPS = 12

_Span = tuple[int | None, int | None]


def film(
    history: History,
    output: Path,
    speed: float,
    size: str,
    span: _Span = (None, None),
    rendering: str = "",
) -> int:
    """Write a history as `filming` does, with a bar on the terminal; returns the number of frames.

    Raises:
        RobotouilleError: There are no such steps, or it cannot be written.
    """
    from robotouille_client.console.progress import tracked

    written = filming(history, output, speed, size, span, rendering)
    _, total = next(written)
    for _ in tracked(written, output.name, total):
        pass
    return total


def filming(
    history: History,
    output: Path,
    speed: float,
    size: str,
    span: _Span = (None, None),
    rendering: str = "",
    look: KitchenLook | None = None,
) -> Generator[tuple[int, int], None, None]:
    """Write a history as a video, a frame at a time: how many of how many are written.

    The file is there when the last one is; whoever stops before that leaves nothing.

    Args:
        speed: Steps a second.
        size: WIDTHxHEIGHT in pixels.
        span: The first and the last step; None for those of the history.
        rendering: The name of the one to draw it with; else the domain's own.
        look: That of a kitchen which is not installed, in place of a rendering.

    Raises:
        RobotouilleError: There are no such steps, or it cannot be written.
    """
    first, last = checked_span(history, span)
    if output.suffix.lower() not in VIDEOS:
        endings = " or ".join(VIDEOS)
        raise RobotouilleError(f"a video's name ends in {endings}, found {output.name!r}")
    fps = GIF_FPS if output.suffix.lower() == ".gif" else FPS
    frames_per_step = max(1, round(fps / speed))
    ended = last == history.length and history.outcome is not None
    frames = frames_of(
        _states(history, first, last),
        size=parse_size(size),
        frames_per_step=frames_per_step,
        seats=[history.seats(step) for step in range(first, last + 1)],
        bubbles={step: bubbles_at(history, step) for step in range(first, last + 1)},
        notices=notices_at(history.interludes, round(speed * NOTICE_SECONDS)),
        max_steps=history.max_steps,
        outcome=outcome_words(history.outcome) if ended and history.outcome else "",
        hold=2 * fps,
        rendering=look.rendering if look else rendering,
        pictures=look.pictures if look else None,
    )
    yield from _written(frames, output, fps, (last - first + 1) * frames_per_step + 2 * fps)


def _written(
    frames: Iterable[pygame.Surface], output: Path, fps: int, total: int
) -> Iterator[tuple[int, int]]:
    """Write frames beside where they are to be, and move the file there when it is whole."""
    draft = draft_of(output)
    try:
        if draft.is_fifo():
            draft.unlink()
        for done in writing_video(draft, frames, fps):
            yield min(done, total - 1), total
        draft.replace(output)
        yield total, total
    except ValueError as error:
        raise RobotouilleError(str(error)) from None
    except OSError as error:
        raise RobotouilleError(f"{output}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)


def draft_of(output: Path) -> Path:
    """The file that is written until all of a video is there."""
    return output.with_name(f"{output.stem}.part{output.suffix}")


def checked_span(history: History, span: _Span) -> tuple[int, int]:
    """The first and the last step of a span; RobotouilleError if there are no such steps."""
    first = history.first if span[0] is None else span[0]
    last = history.length if span[1] is None else span[1]
    if not history.first <= first <= last <= history.length:
        raise RobotouilleError(
            f"there is no span from step {first} to {last}: the recording has the steps "
            f"{history.first} to {history.length}"
        )
    return first, last


def _states(history: History, first: int, last: int) -> Iterator[tuple[int, State]]:
    return ((step, history.state(step)) for step in range(first, last + 1))
