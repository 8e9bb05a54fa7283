"""A recording's content as rows of the catalogue."""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path

import sqlalchemy as sa

from robotouille.errors import RecordingError
from robotouille.replay.container import MAX_FILE, frames_with_ends, is_closed, plain
from robotouille.replay.frame_schema import check_frame
from robotouille_data.recordings.row_builder import Row, RowBuilder
from robotouille_data.recordings.steps_left import UNKNOWN, StepsLeft, steps_left
from robotouille_data.schema import EPISODES, EVENTS, LABELS, MEASURES, SEATS, STEPS

__all__ = ["MAX_ROWS", "TableRows", "content_digest", "episode_id", "read_content", "recorded_rows"]

MAX_ROWS = 100_000
"""Rows that are held at once: those of a longer recording come in pieces."""

TableRows = tuple[sa.Table, Sequence[Row]]


def read_content(path: Path) -> bytes:
    """The bytes of a file.

    Raises:
        RecordingError: It is larger than a recording may be, or no file: a pipe may never end.
        OSError: It cannot be read now.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise RecordingError("is no file")
    with path.open("rb") as file:
        content = file.read(MAX_FILE + 1)
    if len(content) > MAX_FILE:
        raise RecordingError(f"larger than {MAX_FILE:,} bytes")
    return content


def content_digest(content: bytes) -> str:
    """The SHA-256 of a file's content."""
    return hashlib.sha256(content).hexdigest()


def episode_id(digest: str) -> int:
    """The number by which the tables call the episode of a recording with this digest."""
    return int(digest[:16], 16) >> 1


def recorded_rows(
    content: bytes, number: int, *, steps_to_go: bool = False
) -> Iterator[list[TableRows]]:
    """All rows of a recording, in pieces; the last one has those that sum it up.

    Args:
        number: The episode's `id`.
        steps_to_go: Also how far from the goal it ended, which takes a search.

    Raises:
        RecordingError: It is damaged, or none. What came before is worth nothing then.
    """
    stream, fault = plain(content)
    if fault:
        raise RecordingError(fault)
    try:
        rows = None
        for rows in _builders(stream, number, closed=is_closed(content)):
            if len(rows.steps) + len(rows.events) >= MAX_ROWS:
                yield [(STEPS, rows.steps), (EVENTS, rows.events)]
                rows.steps, rows.events = [], []
        if rows is None:
            raise RecordingError("has no header")
        sought = steps_to_go and rows.success is False
        summary = _summary(rows, steps_left(content) if sought else UNKNOWN)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise RecordingError(f"what it holds does not fit together: {error!r}") from None
    yield summary


def _builders(stream: bytes, number: int, *, closed: bool) -> Iterator[RowBuilder]:
    """What the frames have come to, after each of them."""
    rows, ended, end = None, False, 0
    for place, (frame, end) in enumerate(frames_with_ends(stream)):
        check_frame(frame, place)
        if ended:
            raise RecordingError(f"damaged at byte {end}: a frame behind the footer")
        if rows is not None:
            rows.add(frame)
        elif frame["kind"] == "header":
            rows = RowBuilder(frame, number)
        else:
            return
        ended = frame["kind"] == "footer"
        yield rows
    if closed and not (ended and end == len(stream)):
        raise RecordingError("damaged: the file is closed without an end")


def _summary(rows: RowBuilder, left: StepsLeft) -> list[TableRows]:
    return [
        (STEPS, rows.steps),
        (EVENTS, rows.events),
        (SEATS, rows.seats()),
        (LABELS, rows.labels()),
        (MEASURES, [rows.measures(left)]),
        (EPISODES, [rows.episode()]),
    ]
