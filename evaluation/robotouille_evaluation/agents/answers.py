"""Parsers of language models' answers.

`PublishedParser` reads answers exactly as the published evaluation does, flaws included.
`TolerantParser` accepts emphasis, headings in other case, list numbers and a final full stop.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from robotouille_evaluation.models.model import Message


class PromptHistory(StrEnum):
    """Earlier turns that ReAct sends with each request."""

    FULL = "full"
    NONE = "none"
    LAST_ACTION = "last-action"
    LAST_REASONING_ACTION = "last-reasoning-action"
    LAST_OBSERVATION_REASONING_ACTION = "last-obs-reasoning-action"


def remembered(
    history: PromptHistory,
    before: list[tuple[str, str]],
    prompt: str,
    answer: str,
    observation: str,
    reasoning: str,
    action: str,
) -> list[tuple[str, str]]:
    """Return the pairs of request and answer that precede the next request."""
    words = f"Previous Reasoning: {reasoning}\nPrevious Action: {action}"
    match history:
        case PromptHistory.FULL:
            return [*before, (prompt, answer)]
        case PromptHistory.NONE:
            return []
        case PromptHistory.LAST_ACTION:
            return [("Previous Observation: Omitted", f"Previous Action: {action}")]
        case PromptHistory.LAST_REASONING_ACTION:
            return [("Previous Observation: Omitted", words)]
        case PromptHistory.LAST_OBSERVATION_REASONING_ACTION:
            return [(f"Previous Observation: {observation}\n", words)]


def as_messages(pairs: list[tuple[str, str]]) -> list[Message]:
    """Return pairs of request and answer as messages."""
    return [
        Message(role, content)
        for pair in pairs
        for role, content in zip(("user", "assistant"), pair, strict=True)
    ]


NO_ACTION = (
    "The action was malformed. Please provide a valid action in the form 'Action: <action>'."
)
INVALID = "The action '{}' is not valid. Please provide a valid action."


@dataclass(frozen=True, slots=True)
class ParsedAnswer:
    """Reasoning and action of an answer; None for missing parts."""

    reasoning: str | None
    action: str | None


class AnswerParser(Protocol):
    """Parser of answers."""

    no_action: str
    """Feedback for an answer without an action."""

    def step(self, text: str) -> ParsedAnswer:
        """Read the answer to a request for one action."""
        ...

    def plan(self, text: str) -> tuple[str, ...]:
        """Return all actions below the heading `Plan:`."""
        ...

    def steps(self, text: str) -> tuple[str, ...]:
        """Return the actions after each heading `Action:`."""
        ...

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """Return the valid action that is meant, if any."""
        ...

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """Return the feedback for an invalid action."""
        ...


class PublishedParser:
    """Parser of the published evaluation: exact headings and exact sentences."""

    no_action = NO_ACTION

    _REASONING = re.compile(r"^Reasoning:", re.MULTILINE)
    _ACTION = re.compile(r"^Action:\s*(.+)", re.MULTILINE)
    _PLAN = re.compile(r"^Plan:\s*(.*)", re.MULTILINE | re.DOTALL)

    def step(self, text: str) -> ParsedAnswer:
        """Read reasoning up to the last `Action:`, untrimmed, and the first action."""
        action = self._ACTION.search(text)
        return ParsedAnswer(self._reasoning(text), action[1].strip() if action else None)

    def _reasoning(self, text: str) -> str | None:
        # As the published `Reasoning:\s*(.+)Action:` with DOTALL, but without its backtracking,
        # which takes quadratic time on long answers.
        heading = self._REASONING.search(text)
        if heading is None:
            return None
        between = text[heading.end() : max(heading.end(), text.rfind("Action:", heading.end()))]
        return between.lstrip() or between[-1:] or None

    def plan(self, text: str) -> tuple[str, ...]:
        """Return each line after the first `Plan:`, including empty ones."""
        # As in the published code, an empty line is a plan step of its own, and makes the plan
        # invalid.
        found = self._PLAN.search(text)
        return tuple(line.strip() for line in found[1].split("\n")) if found else ()

    def steps(self, text: str) -> tuple[str, ...]:
        """Return the text after each `Action:`."""
        return tuple(found.strip() for found in self._ACTION.findall(text))

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """Return the action if it is one of the valid sentences."""
        return action if action in valid else None

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """Return the published feedback."""
        return INVALID.format(action)


class TolerantParser:
    """Parser that ignores differences a person would ignore."""

    no_action = NO_ACTION

    # Repetitions are bounded, so that no answer makes these patterns backtrack for long.
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
        """Read the reasoning and the last action: models think aloud before they decide."""
        actions = self._ACTION.findall(text)
        return ParsedAnswer(self._reasoning(text), self._trim(actions[-1]) if actions else None)

    def _reasoning(self, text: str) -> str:
        heading = self._REASONING.search(text)
        if heading is None:
            return ""
        end = self._END.search(text, heading.end())
        return text[heading.end() : end.start() if end else len(text)].strip()

    def plan(self, text: str) -> tuple[str, ...]:
        """Return the lines after the last `Plan:` that are not empty."""
        headings = list(self._PLAN.finditer(text))
        lines = text[headings[-1].end() :].split("\n") if headings else []
        return tuple(line for line in map(self._trim, lines) if line)

    def steps(self, text: str) -> tuple[str, ...]:
        """Return the trimmed text after each `Action:`."""
        return tuple(line for line in map(self._trim, self._ACTION.findall(text)) if line)

    def match(self, action: str, valid: tuple[str, ...]) -> str | None:
        """Return the valid sentence that is equal apart from case, spaces and a full stop."""
        if action in valid:
            return action
        wanted = self._plain(action)
        return next((sentence for sentence in valid if self._plain(sentence) == wanted), None)

    def invalid(self, action: str, valid: tuple[str, ...]) -> str:
        """Return the published feedback."""
        return INVALID.format(action)

    def _trim(self, line: str) -> str:
        return self._NUMBER.sub("", line).strip(self._EDGES)

    @staticmethod
    def _plain(sentence: str) -> str:
        return " ".join(sentence.casefold().split()).rstrip(".")
