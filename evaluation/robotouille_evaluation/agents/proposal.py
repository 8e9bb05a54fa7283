"""Observations, proposals and strategies of agents, and their exchanges with models."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Generator, Iterable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, Protocol, TypeVar

from robotouille import State
from robotouille.planning.policies import Did
from robotouille.replay.model_calls import CallNotes
from robotouille_evaluation.models import Completion, ModelRequest

MAX_REASONING = 8000
"""Characters of reasoning that a recording keeps per action (docs/protocol.md)."""


class ExchangeVerdict(StrEnum):
    """Kind of an answer."""

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
        """True if the answer is rejected and the model is asked again."""
        return self is ExchangeVerdict.INVALID or self.malformed

    @property
    def malformed(self) -> bool:
        """True if the answer names no action."""
        return self in (ExchangeVerdict.NO_REASONING, ExchangeVerdict.NO_ACTION)


class ContextOverflow(Exception):  # noqa: N818 - thrown into strategies as a signal
    """Signal that a request was longer than the model's context."""


@dataclass(frozen=True, slots=True)
class AgentObservation:
    """Text that a player sees, with the sentences of its valid actions."""

    text: str
    valid: tuple[str, ...]
    player: str = ""
    state: State | None = None
    """State, for agents that plan. Language models receive the text."""
    heard: tuple[str, ...] = ()
    """Chat messages since the last observation, one line each (`team.UnreadChat`)."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """Request to a model, its completion, and how the completion was read."""

    request: ModelRequest
    completion: Completion | None
    verdict: ExchangeVerdict
    reasoning: str = ""
    action: str = ""
    feedback: str = ""
    player: str = ""
    """Player of the action, if one answer is for several players."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """Actions to take in order; none if there was no usable answer."""

    actions: tuple[str, ...] = ()
    reasoning: str = ""
    done: bool = False
    """The agent has finished."""
    whole: bool = False
    """The actions are taken only if each of them is valid in its turn."""
    anticipates: bool = False
    """Another player's action in the same step should make the first one possible."""
    say: str = ""
    """Chat message to all."""
    exchanges: tuple[Exchange, ...] = field(default=())


ProposalSteps = Generator[ModelRequest, Completion, Proposal]
"""Yields requests and is sent completions; `ContextOverflow` may be thrown into it."""


class Strategy(Protocol):
    """Way to ask a model for actions, without input or output of its own."""

    def propose(self, observation: AgentObservation) -> ProposalSteps:
        """Propose actions for an observation."""
        ...

    def observe(self, did: Did) -> None:
        """Observe what all players did in a step."""
        ...

    def retry(self) -> bool:
        """Return whether to start the episode again after its steps are used up.

        Each call uses up one retry.
        """
        ...

    @property
    def retries_left(self) -> int:
        """Number of further retries."""
        ...


R = TypeVar("R")

Complete = Callable[[ModelRequest], Awaitable[Completion]]
"""Asks a model; raises ContextOverflow or ModelError."""


async def answer_all(asking: Generator[ModelRequest, Completion, R], complete: Complete) -> R:
    """Answer a generator's requests until it returns, and return its result."""
    try:
        request = next(asking)
        while True:
            try:
                completion = await complete(request)
            except ContextOverflow as error:
                request = asking.throw(error)
            else:
                request = asking.send(completion)
    except StopIteration as stop:
        result: R = stop.value
        return result


async def all_of(asking: Iterable[Awaitable[None]]) -> None:
    """Await all at the same time, and raise the first error in their order.

    After an error the others still finish, because their answers are paid for and must be counted.
    """
    # A TaskGroup would cancel the other calls after the first error.
    ended = await asyncio.gather(*asking, return_exceptions=True)
    for error in ended:
        if error is not None:
            raise error


def exchange_row(exchange: Exchange) -> dict[str, Any]:
    """Return an exchange as a line of a transcript."""
    completion = exchange.completion
    return {
        "purpose": exchange.request.purpose,
        "messages": [asdict(message) for message in exchange.request.messages],
        "answer": completion.text if completion is not None else None,
        "seconds": completion.seconds if completion is not None else None,
        "finish_reason": completion.finish_reason if completion is not None else None,
        "verdict": exchange.verdict.value,
        "action": exchange.action,
        "feedback": exchange.feedback,
    }


def exchange_note(notes: CallNotes, exchange: Exchange, *, timed: bool = True) -> str:
    """Return an exchange as the text of a note, in which earlier messages are not repeated.

    Args:
        timed: True to include the duration, which differs between runs.
    """
    row = exchange_row(exchange)
    if not timed:
        del row["seconds"]
    # `CallNotes` refers to messages of earlier notes by number, because each request repeats
    # hundreds of them.
    sent = [(each["role"], each["content"]) for each in row.pop("messages")]
    return notes.note(sent, **row)
