"""What is to be published: bounded, and never waited for by those who put something in."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from typing import NamedTuple

from pydantic import BaseModel

from robotouille.world.grounding.actions import GroundAction
from robotouille_server.runtime.metrics import Metrics

__all__ = ["MAX_MESSAGES", "MAX_STEPS", "Outbox", "Outgoing", "TakenMove", "TakenStep"]

MAX_MESSAGES = 10_000
"""That wait for the broker, each with at most some KiB."""
MAX_STEPS = 20_000
"""That wait for it: of 200 episodes at 5 steps a second those of 20 s, in about 20 MB."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message, to be published at least once. `correlation` goes back to whoever asked."""

    topic: str
    content: BaseModel
    correlation: bytes | None = None


class TakenMove(NamedTuple):
    """A move of a step, without what its player thought: that is for the recording alone."""

    player: str
    action: GroundAction
    applied: bool
    ms: int


class TakenStep(NamedTuple):
    """A step that somebody asked for. It keeps no state alive."""

    episode: str
    step: int
    t: int
    utc_ms: int
    moves: tuple[TakenMove, ...]


class Outbox:
    """Messages and steps in the order in which they came. Where there are too many the oldest
    are dropped and counted: steps never take the place of messages."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._messages: deque[Outgoing] = deque()
        self._steps: deque[TakenStep] = deque()
        self._dropped: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._messages) + len(self._steps)

    @property
    def messages(self) -> int:
        """How many messages wait."""
        return len(self._messages)

    def add(self, message: Outgoing) -> None:
        """One more message."""
        if len(self._messages) >= MAX_MESSAGES:
            self._messages.popleft()
            self._metrics.mqtt_dropped_messages += 1
        self._messages.append(message)

    def add_step(self, step: TakenStep) -> None:
        """One more step."""
        if len(self._steps) >= MAX_STEPS:
            self.drop([self._steps.popleft()])
        self._steps.append(step)

    def take(self, count: int) -> list[Outgoing]:
        """The next messages, at most so many."""
        return [self._messages.popleft() for _ in range(min(count, len(self._messages)))]

    def put_back(self, messages: list[Outgoing]) -> None:
        """Messages that were not published after all, to be so before all others."""
        room = max(0, MAX_MESSAGES - len(self._messages))
        kept = messages[len(messages) - min(room, len(messages)) :]
        self._metrics.mqtt_dropped_messages += len(messages) - len(kept)
        self._messages.extendleft(reversed(kept))

    def take_steps(self) -> dict[str, list[TakenStep]]:
        """All steps, by episode."""
        taken: dict[str, list[TakenStep]] = {}
        for step in self._steps:
            taken.setdefault(step.episode, []).append(step)
        self._steps.clear()
        return taken

    def drop(self, steps: list[TakenStep]) -> None:
        """Steps that will not be published."""
        self._metrics.mqtt_dropped_steps += len(steps)
        self._dropped.update(step.episode for step in steps)

    def take_dropped(self, episode: str) -> int:
        """How many of an episode's steps were dropped since this was last asked."""
        return self._dropped.pop(episode, 0)

    def forget_all_but(self, watched: set[str]) -> None:
        """Nobody wants to know any more of all other episodes."""
        for episode in self._dropped.keys() - watched:
            del self._dropped[episode]
