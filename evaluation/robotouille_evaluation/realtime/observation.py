"""Digests of changes, the cost of thinking, and rules for late answers."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.agents.proposal import Exchange
from robotouille_evaluation.models.model import HEADER, Completion

CHARACTERS_A_TOKEN = 4


def estimated_tokens(text: str) -> int:
    """Estimate the tokens of a text: one for four characters, rounded up."""
    return -(-len(text) // CHARACTERS_A_TOKEN)


def known_lines(text: str) -> tuple[str, ...]:
    """Return the lines of an observation that describe the state, without valid actions."""
    found, listing = [], False
    for line in text.splitlines():
        if line == HEADER:
            listing = True
        elif not line:
            listing = False
        elif not listing:
            found.append(line)
    return tuple(found)


def digest(then: str, now: str, steps: int, events: Sequence[str], tokens: int) -> str:
    """Return what was done and what has changed between two observations.

    Args:
        steps: Number of steps between them.
        events: Actions in these steps, in order. The digest lists the latest first.
        tokens: Longest digest, in `estimated_tokens`. Lines that do not fit are counted.

    Returns:
        An empty text if not even the first line fits.
    """
    head = f"Since you last looked {steps} step{'s have' if steps != 1 else ' has'} passed."
    # Latest first: the beginning survives if the digest is cut.
    lines = [*(f"* {event}" for event in reversed(events)), *_changes(then, now)]
    for shown in range(len(lines), -1, -1):
        left = len(lines) - shown
        more = [f"({left} more lines are left out.)"] if left else []
        text = "\n".join([head, *lines[:shown], *more])
        if estimated_tokens(text) <= tokens:
            return text
    return ""


def _changes(then: str, now: str) -> Iterator[str]:
    """Yield new lines, then removed lines, each in the order of its observation."""
    before, after = known_lines(then), known_lines(now)
    for sign, lines, others in (("+", after, before), ("-", before, after)):
        left = Counter(others)
        for line in lines:
            if left[line] > 0:
                left[line] -= 1
            else:
                yield f"{sign} {line}"


MAX_MILLISECONDS = 86_400_000
"""A day: the longest declared thinking that the protocol accepts."""


class ChargeKind(StrEnum):
    """Unit by which thinking is charged."""

    WALL = "wall"
    """The real duration of the calls. Such runs are not repeatable."""
    TOKENS = "tokens"
    """Milliseconds per generated token."""
    DECLARED = "declared"
    """Milliseconds per call."""


@dataclass(frozen=True, slots=True)
class Charge:
    """Cost of thinking in milliseconds of game time; `ms` is the cost of a token or call."""

    kind: ChargeKind
    ms: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Charge:
        """Return the charge of an option: `wall`, `tokens:20` or `declared:1500`.

        Raises:
            WrongArgumentError: The option is invalid.
        """
        name, _, price = text.partition(":")
        if text == ChargeKind.WALL:
            return cls(ChargeKind.WALL)
        try:
            kind, ms = ChargeKind(name), float(price)
        except ValueError:
            ms = math.nan
        if not 0 <= ms <= MAX_MILLISECONDS or name == ChargeKind.WALL:
            raise WrongArgumentError(
                f"expected wall, tokens:MILLISECONDS or declared:MILLISECONDS, found {text!r}"
            )
        return cls(kind, ms)

    @property
    def repeats(self) -> bool:
        """True if equal answers cost the same again."""
        return self.kind is not ChargeKind.WALL

    def milliseconds(self, exchanges: Iterable[Exchange]) -> int:
        """Return the cost of all calls for a proposal, rounded up, and at most a day."""
        answers = [e.completion for e in exchanges if e.completion is not None]
        return min(MAX_MILLISECONDS, math.ceil(round(sum(map(self._of, answers)), 6)))

    def _of(self, answer: Completion) -> float:
        match self.kind:
            case ChargeKind.WALL:
                return answer.seconds * 1000
            case ChargeKind.TOKENS:
                return self.ms * _generated(answer)
            case ChargeKind.DECLARED:
                return self.ms

    def __str__(self) -> str:
        return self.kind.value if self.kind is ChargeKind.WALL else f"{self.kind}:{self.ms:g}"


def _generated(answer: Completion) -> int:
    """Return the endpoint's count of tokens, or an estimate without one."""
    return answer.usage.completion_tokens or estimated_tokens(answer.text)


WORD = re.compile(r"[\w-]+")


class LatePolicy(StrEnum):
    """Rule for answers after which steps have passed, from the boldest to the strictest.

    The world rejects actions that are no longer valid.
    """

    APPLY = "apply"
    """Act on all answers."""
    REVALIDATE = "revalidate"
    """Act on valid actions whose objects have the same description in the observation as then."""
    DROP = "drop"
    """Act only if the observation has not changed."""


@dataclass(frozen=True, slots=True)
class ObservedStep:
    """Observation after `step` steps, with the sentences of the player's valid actions."""

    step: int
    text: str
    valid: tuple[str, ...]


def still_holds(late: LatePolicy, action: str, then: ObservedStep, now: ObservedStep) -> bool:
    """Return whether to act now on an action that was chosen on an earlier observation."""
    if late is LatePolicy.APPLY or then.step == now.step:
        return True
    before, after = known_lines(then.text), known_lines(now.text)
    if late is LatePolicy.DROP:
        return before == after
    # Objects are the first words of lines; other words of the action are not compared.
    things = set(WORD.findall(action)) & {line.partition(" ")[0] for line in (*before, *after)}
    return action in now.valid and _about(things, before) == _about(things, after)


def _about(things: set[str], lines: tuple[str, ...]) -> list[str]:
    return [line for line in lines if things & set(WORD.findall(line))]
