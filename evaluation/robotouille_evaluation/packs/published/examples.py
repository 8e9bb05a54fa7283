"""How the published code makes messages of an example file.

A file is one episode: `Interaction N`, a line of dashes, `Observation:` and what follows, then the
answer. The user's message begins after `Observation:` and keeps its trailing blank lines; where
the answer begins with `Reasoning:`, the last line feed before it belongs to neither. Observations
are in the file as they are sent: in full, or shortened to `...`.
"""

from __future__ import annotations

import re
from pathlib import Path

from robotouille.domain.files import MAX_FILE_BYTES
from robotouille.errors import Fault, FileError
from robotouille_evaluation.packs.pack import ExampleEpisode, Examples, ExampleStep

__all__ = ["parse_episode", "read_examples"]

HEADING = re.compile(r"^Interaction \d+\n-+\n", re.MULTILINE)
REASONED = re.compile(r"Observation:\s*(?P<user>.*?)\n(?P<assistant>^Reasoning:.*)", re.M | re.S)
PLANNED = re.compile(r"Observation:\s*(?P<user>.*?)(?P<assistant>^(?:Plan|Action):.*)", re.M | re.S)


def read_examples(folder: Path, name: str) -> Examples:
    """The example files in a folder, by name.

    Raises:
        FileError: One cannot be read or is no example.
    """
    episodes = tuple(_read(path) for path in sorted(folder.glob("*.txt")))
    return Examples(name, episodes)


def _read(path: Path) -> ExampleEpisode:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise FileError(str(path), [Fault("", f"is larger than {MAX_FILE_BYTES:,} bytes")])
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
        raise FileError(str(path), [fault]) from None
    except UnicodeDecodeError as error:
        raise FileError(str(path), [Fault("", f"is not UTF-8 text: {error.reason}")]) from None
    return parse_episode(text, path.stem, str(path))


def parse_episode(text: str, name: str, source: str = "example") -> ExampleEpisode:
    """The exchanges of an example's text; FileError if one has no observation or no answer."""
    parts = HEADING.split(text)[1:]
    if not parts:
        raise FileError(source, [Fault("", "is no example: it has no interaction")])
    steps = []
    for number, part in enumerate(parts, start=1):
        match = REASONED.search(part) or PLANNED.search(part)
        if match is None:
            fault = Fault(f"interaction {number}", "has no observation with an answer")
            raise FileError(source, [fault])
        steps.append(ExampleStep(match["user"], match["assistant"].rstrip()))
    return ExampleEpisode(name, tuple(steps))
