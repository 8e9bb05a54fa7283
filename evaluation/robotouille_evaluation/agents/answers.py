"""Answers of language models taken apart.

`Published` reads them as the published evaluation does, flaw by flaw; `Tolerant` forgives what
cannot be misunderstood: emphasis, headings in other case, a list's number, a final full stop.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Protocol

__all__ = ["AnswerParser", "ParsedAnswer", "Published", "Tolerant"]


NO_ACTION = (
    "The action was malformed. Please provide a valid action in the form 'Action: <action>'."
)
INVALID = "The action '{}' is not valid. Please provide a valid action."


@dataclass(frozen=True, slots=True)
class ParsedAnswer:
    """Reasoning and action; None for what is not there."""

    reasoning: str | None
    action: str | None


class AnswerParser(Protocol):
    """How answers are read."""

    no_action: str
    """What a model is told that has named none."""

    def step(self, text: str) -> ParsedAnswer:
        """The answer to a request for one action."""
        ...

    def plan(self, text: str) -> tuple[str, ...]:
        """All actions of an answer under the heading `Plan:`."""
        ...

    def steps(self, text: str) -> tuple[str, ...]:
        """All actions of an answer, each behind a heading `Action:`."""
        ...

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """The valid action that is meant."""
        ...

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """What a model is told whose action is not valid."""
        ...


class Published:
    """Headings at the beginning of a line, sentences letter by letter."""

    no_action = NO_ACTION

    _REASONING = re.compile(r"^Reasoning:", re.MULTILINE)
    _ACTION = re.compile(r"^Action:\s*(.+)", re.MULTILINE)
    _PLAN = re.compile(r"^Plan:\s*(.*)", re.MULTILINE | re.DOTALL)

    def step(self, text: str) -> ParsedAnswer:
        """Reasoning lasts from its first heading to the last `Action:`, its end is not trimmed."""
        action = self._ACTION.search(text)
        return ParsedAnswer(self._reasoning(text), action[1].strip() if action else None)

    def _reasoning(self, text: str) -> str | None:
        """What `Reasoning:\\s*(.+)Action:` would find, in one pass over the longest answer."""
        heading = self._REASONING.search(text)
        if heading is None:
            return None
        between = text[heading.end() : max(heading.end(), text.rfind("Action:", heading.end()))]
        return between.lstrip() or between[-1:] or None

    def plan(self, text: str) -> tuple[str, ...]:
        """Each line behind the first `Plan:`, empty ones too."""
        found = self._PLAN.search(text)
        return tuple(line.strip() for line in found[1].split("\n")) if found else ()

    def steps(self, text: str) -> tuple[str, ...]:
        """What is behind each `Action:`."""
        return tuple(found.strip() for found in self._ACTION.findall(text))

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """Letter by letter."""
        return action if action in valid else None

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """In the published words."""
        return INVALID.format(action)


class Tolerant:
    """What a person would read as the same thing is the same thing."""

    no_action = NO_ACTION

    # Nothing in a heading is longer than a few characters, so that no answer takes long to read.
    _BEFORE = r"^[ \t*_#>\d.)-]{0,12}"
    _REASONING = re.compile(
        _BEFORE + r"(?:Reasoning|Thought)[*_]{0,3}[ \t]?:[*_]{0,3}\s*", re.MULTILINE | re.IGNORECASE
    )
    _END = re.compile(_BEFORE + r"Action\b", re.MULTILINE | re.IGNORECASE)
    _ACTION = re.compile(
        _BEFORE + r"Action[ \t]?\d{0,3}[*_]{0,3}[ \t]?:[*_]{0,3}\s*(.+)",
        re.MULTILINE | re.IGNORECASE,
    )
    _PLAN = re.compile(_BEFORE + r"Plan[*_]{0,3}[ \t]?:[*_]{0,3}", re.MULTILINE | re.IGNORECASE)
    _NUMBER = re.compile(r"^\s*(?:[-*•]|\d+[.):])\s+")
    _EDGES = " \t\r\n.`*_\"'“”‘’[](){}"

    def step(self, text: str) -> ParsedAnswer:
        """The last action of the answer counts: models think aloud before they decide."""
        actions = self._ACTION.findall(text)
        return ParsedAnswer(self._reasoning(text), self._trim(actions[-1]) if actions else None)

    def _reasoning(self, text: str) -> str:
        heading = self._REASONING.search(text)
        if heading is None:
            return ""
        end = self._END.search(text, heading.end())
        return text[heading.end() : end.start() if end else len(text)].strip()

    def plan(self, text: str) -> tuple[str, ...]:
        """Lines behind the last `Plan:` that are not empty."""
        headings = list(self._PLAN.finditer(text))
        lines = text[headings[-1].end() :].split("\n") if headings else []
        return tuple(line for line in map(self._trim, lines) if line)

    def steps(self, text: str) -> tuple[str, ...]:
        """What is behind each `Action:`, trimmed."""
        return tuple(line for line in map(self._trim, self._ACTION.findall(text)) if line)

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """Case, blanks and a final full stop do not matter."""
        if action in valid:
            return action
        wanted = self._plain(action)
        return next((sentence for sentence in valid if self._plain(sentence) == wanted), None)

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """In the published words."""
        return INVALID.format(action)

    def _trim(self, line: str) -> str:
        return self._NUMBER.sub("", line).strip(self._EDGES)

    @staticmethod
    def _plain(sentence: str) -> str:
        return " ".join(sentence.casefold().split()).rstrip(".")
