"""Where an episode is played in this process, and what is recorded of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from robotouille import GroundAction, State, World
from robotouille.episode import Clock, Episode, Phase, Rules, Stepped
from robotouille.errors import ProtocolError
from robotouille.planning.policies import Did
from robotouille.replay.recorder import Recorder, header
from robotouille.world.sentences import MAX_SENTENCE
from robotouille_evaluation.agents.proposal import MAX_REASONING, Exchange

ACTION_INVALID, ACTION_UNKNOWN = "action/invalid", "action/unknown"

__all__ = ["Decision", "Moved", "PlainStage", "RecordedStage", "Stage", "Watch"]


@dataclass(frozen=True, slots=True)
class Decision:
    """What a player does in a step, as a sentence; nothing if it is empty."""

    action: str = ""
    reasoning: str = ""


@dataclass(frozen=True, slots=True)
class Moved:
    """The state after a step, and who did what in it: player, action, whether it was applied."""

    state: State
    did: Did = ()


class Stage(Protocol):
    """One trial of an episode."""

    @property
    def state(self) -> State:
        """As it is now."""
        ...

    def step(self, decisions: Mapping[str, Decision]) -> Moved:
        """Take a step in which players do what they have decided."""
        ...

    def answered(self, player: str, exchange: Exchange) -> None:
        """A model was asked and has answered."""
        ...


class PlainStage:
    """A world, and nothing else."""

    def __init__(self, world: World) -> None:
        self.state = world.initial

    def step(self, decisions: Mapping[str, Decision]) -> Moved:
        """Take a step."""
        before = self.state
        actions = {
            p: before.world.parse(before, p, d.action) for p, d in decisions.items() if d.action
        }
        step = before.step(list(actions.values()))
        self.state = step.state
        applied = [attempt.action for attempt in step.attempts if attempt.applied]
        return Moved(step.state, tuple((p, a, a in applied) for p, a in actions.items()))

    def answered(self, player: str, exchange: Exchange) -> None:
        """Is forgotten."""


class RecordedStage:
    """An episode as the server plays it, with the recording that the server would write.

    Time is counted in steps: nothing is measured here, so that equal decisions give equal bytes.

    Args:
        names: Who plays which player.
        answered: Is told each exchange with a model, as soon as it is over.
    """

    def __init__(
        self,
        world: World,
        names: Mapping[str, str],
        max_steps: int,
        *,
        episode: str = "local",
        answered: Callable[[str, Exchange], None] | None = None,
    ) -> None:
        clock = Clock.TURN if len(world.players) == 1 else Clock.LOCKSTEP
        rules = Rules(clock=clock, max_steps=max_steps, move_budget=0)
        self._world = world
        self._episode = Episode(world, rules)
        self._recorder = Recorder(world)
        self._bytes = self._recorder.begin(header(world.task, rules, episode=episode))
        self._now = 0.0
        self._seq = 0
        self._answered = answered
        for player in world.players:
            self._episode.join(player, names[player], "bot", self._now)

    @property
    def state(self) -> State:
        """As it is now."""
        return self._episode.state

    def step(self, decisions: Mapping[str, Decision]) -> Moved:
        """Take a step, in which a player of whom nothing is said does nothing."""
        episode = self._episode
        self._now += 1.0
        for player in self._world.players:
            decision = decisions.get(player, Decision())
            state = episode.state
            if episode.phase is not Phase.RUNNING or state.busy_steps(player):
                continue
            action = self._world.parse(state, player, decision.action) if decision.action else None
            self._submit(player, action, decision.reasoning[:MAX_REASONING])
        episode.tick(self._now)
        events = episode.events()
        self._bytes += self._recorder.record(events)
        did = [
            (move.player, attempt.action, attempt.applied)
            for event in events
            if isinstance(event, Stepped)
            for move, attempt in zip(event.moves, event.attempts, strict=True)
        ]
        return Moved(episode.state, tuple(did))

    def _submit(self, player: str, action: GroundAction | None, reasoning: str) -> None:
        self._seq += 1
        try:
            self._episode.submit(player, self._seq, action, self._now, reasoning=reasoning)
        except ProtocolError:  # No more reasoning of this seat is recorded.
            self._episode.submit(player, self._seq, action, self._now)

    @property
    def steps(self) -> int:
        """Steps that were taken."""
        return self._episode.step

    def answered(self, player: str, exchange: Exchange) -> None:
        """Record what was no action, with its reasoning; tell whoever wants to know."""
        if self._answered is not None:
            self._answered(player, exchange)
        if exchange.verdict.rejected:
            said = exchange.action or (exchange.completion.text if exchange.completion else "")
            code = ACTION_UNKNOWN if exchange.verdict.malformed else ACTION_INVALID
            why = ProtocolError(code, exchange.feedback, "action")
            reasoning = exchange.reasoning[:MAX_REASONING]
            self._reject(player, said[:MAX_SENTENCE], why, reasoning)

    def _reject(self, player: str, said: str, why: ProtocolError, reasoning: str) -> None:
        self._seq += 1
        try:
            self._episode.reject(player, self._seq, said, why, self._now, reasoning=reasoning)
        except ProtocolError:  # No more words of this seat are recorded; that it failed is.
            self._episode.reject(player, self._seq, "", why, self._now)

    def recording(self, why: str = "the agent is done") -> bytes:
        """The whole recording; the episode is over."""
        if self._episode.outcome is None:
            self._episode.abort(self._now, why)
        self._bytes += self._recorder.record(self._episode.events())
        return self._bytes


Watch = Callable[[RecordedStage], Stage]
"""Puts something before the stage of each trial that sees what happens on it."""
