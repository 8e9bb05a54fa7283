"""Why an action cannot be done, as values; their words are for people and language models."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["Unmet", "UnmetKind"]


class UnmetKind(StrEnum):
    """What it is that does not hold. The values are on the wire."""

    CONDITION = "condition"
    """A precondition: `predicate` with `objects` should be `expected`, and is not."""
    MISSING = "missing"
    """An object does not exist (any more, or yet)."""
    BUSY = "busy"
    """The player cannot act before a delay of its own is over."""
    ACTED = "acted"
    """The player has acted in this step already."""
    TURN = "turn"
    """It is another player's turn."""
    SEAT = "seat"
    """The action moves another's player."""
    SUPERSEDED = "superseded"
    """The same seat has sent another action since."""
    OTHER = "other"
    """Something that only the words say."""

    @classmethod
    def _missing_(cls, value: object) -> UnmetKind:
        """A kind that a newer server knows is another to us."""
        return cls.OTHER


@dataclass(frozen=True, slots=True)
class Unmet:
    """One reason why an action cannot be done; `str()` gives its words."""

    kind: UnmetKind
    words: str
    predicate: str = ""
    objects: tuple[str, ...] = ()
    expected: bool = True

    def __str__(self) -> str:
        return self.words
