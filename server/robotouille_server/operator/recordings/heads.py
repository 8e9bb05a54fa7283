"""Heads of recordings: the episode's code, task, labels and players, from the first frames."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, BinaryIO, cast

from robotouille.errors import RecordingError
from robotouille.replay.compression import is_closed
from robotouille.replay.container import (
    MAGIC,
    MAX_FILE,
    MAX_FRAME,
    check_magic,
    frame_ends,
    frame_value,
)
from robotouille_server.operator.rows import search_text

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

PIECE = 64 * 1024
"""Bytes that are read at once from a recording."""
MAX_HEAD_FRAMES = 64
"""Frames that are decoded for a head. More come before the game only if people chat for long."""


@dataclass(frozen=True, slots=True)
class RecordingHead:
    """Facts from the beginning of a recording.

    Attributes:
        players: The names in the seats when the game began, or at the end of the file.
        begun: True if the game began, so later frames do not change the head.
        text: The text for a search, in lower case.
    """

    created: str
    task: str
    code: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    players: tuple[str, ...] = ()
    begun: bool = False
    text: str = ""


def read_head(file: BinaryIO) -> RecordingHead | None:
    """Read the first frames of a recording. Return None if its header is missing or damaged."""
    header: dict[str, Any] = {}
    names: dict[str, str] = {}
    begun = False
    try:
        for number, (_, packed) in enumerate(whole_frames(file)):
            frame = frame_value(packed, 0)
            header = header or frame
            for note in frame.get("notes", ()):
                begun = begun or note["note"] == "started"
                if note["note"] == "roster":
                    names[note["player"]] = note["name"] if note["taken"] else ""
            begun = begun or frame["kind"] == "step" or number >= MAX_HEAD_FRAMES
            if begun:
                break
        return _head(header, tuple(filter(None, names.values())), begun=begun)
    except (AttributeError, KeyError, RecordingError, TypeError, ValueError):
        return None


def _head(header: dict[str, Any], players: tuple[str, ...], *, begun: bool) -> RecordingHead:
    code, task = str(header.get("code", "")), str(header["task"]["name"])
    labels = {str(name): str(value) for name, value in header.get("labels", {}).items()}
    return RecordingHead(
        created=str(header["created"]),
        task=task,
        code=code,
        labels=labels,
        players=tuple(map(str, players)),
        begun=begun,
        text=search_text(code, task, map(str, players), labels),
    )


def whole_frames(file: BinaryIO, position: int = len(MAGIC)) -> Iterator[tuple[int, bytes]]:
    """Yield each whole frame of a recording from a position, with the position of its end.

    The frames end at the first tear or damage. The file is read in pieces: this bounds memory, and
    each read lets the event loop take the interpreter's lock.

    Raises:
        RecordingError: The file is not a recording, or its compressed stream is damaged.
    """
    try:
        stream = _uncompressed(file)
        check_magic(stream.read(len(MAGIC)))
        stream.seek(position)
        rest = b""
        while len(rest) <= MAX_FRAME + PIECE and position <= MAX_FILE:
            if not (piece := stream.read(PIECE)):
                return
            # `frame_ends` expects the beginning of a recording.
            rest, start = b"".join((MAGIC, rest, piece)), len(MAGIC)
            for end in frame_ends(rest, start):
                position += end - start
                yield position, rest[start:end]
                start = end
            rest = rest[start:]
    except (EOFError, zstd.ZstdError) as error:
        raise RecordingError(f"damaged: {error}") from None


def _uncompressed(file: BinaryIO) -> BinaryIO:
    file.seek(0)
    closed = is_closed(file.read(4))
    file.seek(0)
    return cast("BinaryIO", zstd.ZstdFile(file)) if closed else file
