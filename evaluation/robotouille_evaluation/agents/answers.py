"""Answers of language models taken apart.

`Published` reads them as the published evaluation does, flaw by flaw; `Tolerant` forgives what
cannot be misunderstood: emphasis, headings in other case, a list's number, a final full stop.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Answer", "AnswerParser", "Published", "Tolerant"]


@dataclass(frozen=True, slots=True)
class Answer:
    """Reasoning and action; None for what is not there."""

    reasoning: str | None
    action: str | None


class AnswerParser(Protocol):
    """How answers are read."""

    def step(self, text: str) -> Answer:
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


class Published:
    """Headings at the beginning of a line, sentences letter by letter."""

    _REASONING = re.compile(r"^Reasoning:\s*(.+)Action:", re.MULTILINE | re.DOTALL)
    _ACTION = re.compile(r"^Action:\s*(.+)", re.MULTILINE)
    _PLAN = re.compile(r"^Plan:\s*(.*)", re.MULTILINE | re.DOTALL)

    def step(self, text: str) -> Answer:
        """Reasoning lasts from its first heading to the last `Action:`, its end is not trimmed."""
        reasoning, action = self._REASONING.search(text), self._ACTION.search(text)
        return Answer(reasoning[1] if reasoning else None, action[1].strip() if action else None)

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


class Tolerant:
    """What a person would read as the same thing is the same thing."""

    _HEAD = r"^[\s*_#>\d.)-]*{}\s*\d*[*_]*\s*:[*_]*"
    _REASONING = re.compile(
        _HEAD.format("(?:Reasoning|Thought|Reflection)")
        + r"\s*(.*?)(?=^[\s*_#>\d.)-]*Action\b|\Z)",
        re.MULTILINE | re.DOTALL | re.IGNORECASE,
    )
    _ACTION = re.compile(_HEAD.format("Action") + r"\s*(.+)", re.MULTILINE | re.IGNORECASE)
    _PLAN = re.compile(_HEAD.format("Plan") + r"\s*(.*)", re.MULTILINE | re.DOTALL | re.IGNORECASE)
    _NUMBER = re.compile(r"^\s*(?:[-*•]|\d+[.):])\s+")
    _EDGES = " \t\r\n.`*_\"'“”‘’[](){}"

    def step(self, text: str) -> Answer:
        """The last action of the answer counts: models think aloud before they decide."""
        reasoning, actions = self._REASONING.search(text), self._ACTION.findall(text)
        return Answer(
            reasoning[1].strip() if reasoning else "", self._trim(actions[-1]) if actions else None
        )

    def plan(self, text: str) -> tuple[str, ...]:
        """Lines behind the last `Plan:` that are not empty."""
        found = [match[1] for match in self._PLAN.finditer(text)]
        lines = found[-1].split("\n") if found else []
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

    def _trim(self, line: str) -> str:
        return self._NUMBER.sub("", line).strip(self._EDGES)

    @staticmethod
    def _plain(sentence: str) -> str:
        return " ".join(sentence.casefold().split()).rstrip(".")
