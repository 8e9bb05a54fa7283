"""What an agent sees, what it proposes, and what was said on the way."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from robotouille import State
from robotouille.planning.policies import Did
from robotouille_evaluation.models.model import Completion, ModelRequest

__all__ = [
    "MAX_REASONING",
    "ContextOverflow",
    "Exchange",
    "ExchangeVerdict",
    "Observation",
    "Proposal",
    "ProposalSteps",
    "Strategy",
]


MAX_REASONING = 8000
"""Characters of reasoning that are recorded with an action (docs/protocol.md)."""


class ExchangeVerdict(StrEnum):
    """What an answer was."""

    ACTION = "action"
    PLAN = "plan"
    FINISH = "finish"
    NO_REASONING = "no-reasoning"
    NO_ACTION = "no-action"
    INVALID = "invalid"
    REFLECTION = "reflection"
    OVERFLOW = "overflow"

    @property
    def rejected(self) -> bool:
        """It is refused, and the model is asked again."""
        return self is ExchangeVerdict.INVALID or self.malformed

    @property
    def malformed(self) -> bool:
        """No action can be read from it."""
        return self in (ExchangeVerdict.NO_REASONING, ExchangeVerdict.NO_ACTION)


class ContextOverflow(Exception):  # noqa: N818 - thrown into strategies; it is no fault of theirs
    """A request was longer than what the model takes."""


@dataclass(frozen=True, slots=True)
class Observation:
    """What the player sees, as text, with the sentences of its valid actions."""

    text: str
    valid: tuple[str, ...]
    player: str = ""
    state: State | None = None
    """For agents that plan; language models are sent the text."""
    heard: tuple[str, ...] = ()
    """What others have said since the last look, a line each (`chat.Chat`)."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request, its answer, and what was made of it."""

    request: ModelRequest
    completion: Completion | None
    verdict: ExchangeVerdict
    reasoning: str = ""
    action: str = ""
    feedback: str = ""
    player: str = ""
    """Whose action it names, where one answer is for several."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """Sentences of actions to take one after the other; none where there was no usable answer.

    With `whole` they are taken only if each is valid when its turn comes.
    """

    actions: tuple[str, ...] = ()
    reasoning: str = ""
    done: bool = False
    """The agent wants no further turn."""
    whole: bool = False
    anticipates: bool = False
    """Another's action in the same step is to make the first one possible."""
    say: str = ""
    """Is said to everybody in the chat."""
    exchanges: tuple[Exchange, ...] = field(default=())


ProposalSteps = Generator[ModelRequest, Completion, Proposal]
"""Yields what a model is to be asked, and is sent the answer; `ContextOverflow` may be thrown."""


class Strategy(Protocol):
    """How a model is asked, without any input or output of its own."""

    def propose(self, observation: Observation) -> ProposalSteps:
        """What to do now."""
        ...

    def observe(self, did: Did) -> None:
        """What everybody did in a step."""
        ...

    def retry(self) -> bool:
        """Whether the episode is begun anew when its steps are used up; asked once each time."""
        ...

    @property
    def retries_left(self) -> int:
        """How often it would be."""
        ...
