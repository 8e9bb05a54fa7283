"""What a thought costs, in milliseconds of the game's own time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.agents.proposal import Exchange
from robotouille_evaluation.models.model import Completion
from robotouille_evaluation.realtime.changes import estimated_tokens

__all__ = ["MAX_MILLISECONDS", "Charge", "ChargeKind"]

MAX_MILLISECONDS = 86_400_000
"""A day: the most that the protocol takes as declared thinking."""


class ChargeKind(StrEnum):
    """By what thinking is charged."""

    WALL = "wall"
    """The time that the calls really took. A run does not repeat."""
    TOKENS = "tokens"
    """So many milliseconds for each token that was generated."""
    DECLARED = "declared"
    """So many milliseconds for each call."""


@dataclass(frozen=True, slots=True)
class Charge:
    """How thinking is charged; `ms` is the price of a token, or of a call."""

    kind: ChargeKind
    ms: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Charge:
        """As an option gives it: `wall`, `tokens:20`, `declared:1500`.

        Raises:
            WrongArgumentError: It is none of these.
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
        """Whether the same answers cost the same again."""
        return self.kind is not ChargeKind.WALL

    def milliseconds(self, exchanges: Iterable[Exchange]) -> int:
        """What a proposal has cost, all calls for it together, rounded up; at most a day."""
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
    """Tokens as the endpoint counts them; by estimate where it does not."""
    return answer.usage.completion_tokens or estimated_tokens(answer.text)
