"""How the published code makes messages of an example file.

A file is one episode: `Interaction N`, a line of dashes, `Observation:` and what follows, then the
answer. The user's message begins after `Observation:` and keeps its trailing blank lines; where
the answer begins with `Reasoning:`, the last line feed before it belongs to neither. Observations
are in the file as they are sent: in full, or shortened to `...`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from robotouille.errors import Fault, FileError
from robotouille_evaluation.packs.pack import ExampleEpisode, Examples, ExampleStep
from robotouille_evaluation.packs.published.files import read_text

__all__ = ["parse_episode", "read_examples"]

HEADING = re.compile(r"^Interaction \d+\n-+\n", re.MULTILINE)
OBSERVATION, REASONING = "Observation:", "\nReasoning:"
PLANS = ("\nPlan:", "\nAction:")


def read_examples(paths: Iterable[Path], name: str, root: Path) -> Examples:
    """Example files below `root`, in their order.

    Raises:
        FileError: One cannot be read or is no example.
    """
    episodes = (parse_episode(read_text(path, root), path.stem, str(path)) for path in paths)
    return Examples(name, tuple(episodes))


def parse_episode(text: str, name: str, source: str = "example") -> ExampleEpisode:
    """The exchanges of an example's text; FileError if one has no observation or no answer."""
    parts = HEADING.split(text)[1:]
    if not parts:
        raise FileError(source, [Fault("", "is no example: it has no interaction")])
    steps = []
    for number, part in enumerate(parts, start=1):
        step = _step(part)
        if step is None:
            fault = Fault(f"interaction {number}", "has no observation with an answer")
            raise FileError(source, [fault])
        steps.append(step)
    return ExampleEpisode(name, tuple(steps))


def _step(part: str) -> ExampleStep | None:
    """The user's message and the answer; None if there is no answer behind an observation."""
    before, found, rest = part.partition(OBSERVATION)
    if not found:
        return None
    after = len(before) + len(OBSERVATION)
    begin = len(part) - len(rest.lstrip())
    # The published pattern takes the blanks in front of an answer only if there is no later one.
    end = part.find(REASONING, begin)
    if end < 0:
        end = part.find(REASONING, after)
    if end >= 0:
        return ExampleStep(part[begin:end], part[end + 1 :].rstrip())
    ends = [end for word in PLANS if (end := part.find(word, begin - 1)) >= 0]
    if not ends:
        return None
    return ExampleStep(part[begin : min(ends) + 1], part[min(ends) + 1 :].rstrip())
