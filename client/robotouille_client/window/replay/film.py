"""A recording, or a span of it, as a video."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille.world.world import State
from robotouille_client.window import parse_size
from robotouille_client.window.replay.history.recorded import RecordedHistory
from robotouille_client.window.replay.source import NOTICE_SECONDS, bubbles_at, notices_at
from robotouille_client.window.sources.texts import outcome_words
from robotouille_client.window.video import frames_of, write_video

__all__ = ["film"]

FPS = 24
GIF_FPS = 12


def film(
    history: RecordedHistory,
    output: Path,
    speed: float,
    size: str,
    span: tuple[int | None, int | None] = (None, None),
    rendering: str = "",
) -> int:
    """Write a recording as a video; returns the number of frames.

    Args:
        speed: Steps a second.
        size: WIDTHxHEIGHT in pixels.
        rendering: The name of the one to draw it with; else the domain's own.
        span: The first and the last step; None for those of the recording.

    Raises:
        RobotouilleError: There are no such steps, or it cannot be written.
    """
    from robotouille_client.console.progress import tracked

    first, last = checked_span(history, span)
    fps = GIF_FPS if output.suffix == ".gif" else FPS
    frames_per_step = max(1, round(fps / speed))
    notices = notices_at(history.interludes, round(speed * NOTICE_SECONDS))
    ended = last == history.length and history.outcome is not None
    frames = frames_of(
        _states(history, first, last),
        size=parse_size(size),
        frames_per_step=frames_per_step,
        seats=[history.seats(step) for step in range(first, last + 1)],
        bubbles={step: bubbles_at(history, step) for step in range(first, last + 1)},
        notices=notices,
        max_steps=history.recording.header["rules"]["max_steps"],
        outcome=outcome_words(history.outcome) if ended and history.outcome else "",
        hold=2 * fps,
        rendering=rendering,
    )
    total = (last - first + 1) * frames_per_step + 2 * fps
    try:
        return write_video(output, tracked(frames, output.name, total), fps)
    except ValueError as error:
        raise RobotouilleError(str(error)) from None
    except OSError as error:
        raise RobotouilleError(f"{output}: cannot be written: {error.strerror}") from None


def checked_span(history: RecordedHistory, span: tuple[int | None, int | None]) -> tuple[int, int]:
    """The first and the last step of a span; RobotouilleError if there are no such steps."""
    first = 0 if span[0] is None else span[0]
    last = history.length if span[1] is None else span[1]
    if not 0 <= first <= last <= history.length:
        raise RobotouilleError(
            f"there is no span from step {first} to {last}: the recording has the steps 0 to "
            f"{history.length}"
        )
    return first, last


def _states(history: RecordedHistory, first: int, last: int) -> Iterator[tuple[int, State]]:
    return ((step, history.state(step)) for step in range(first, last + 1))
