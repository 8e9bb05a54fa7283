"""Where an episode is played in this process, and what is recorded of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from robotouille import GroundAction, State, World
from robotouille.episode import Clock, Episode, Phase, Rules, Stepped
from robotouille.episode.episode_state import Undone, nothing_undone
from robotouille.episode.quota import MAX_NOTE
from robotouille.errors import ProtocolError, UnknownNameError
from robotouille.planning.policies import Did
from robotouille.protocol.message_parts import Kind
from robotouille.replay.model_calls import TOPIC, CallNotes
from robotouille.replay.recorder import Recorder, header
from robotouille.world.sentences import MAX_SENTENCE
from robotouille_evaluation.agents.exchange_rows import exchange_note
from robotouille_evaluation.agents.proposal import MAX_REASONING, Exchange

ACTION_INVALID, ACTION_UNKNOWN = "action/invalid", "action/unknown"

__all__ = ["Decision", "Moved", "PlainStage", "RecordedStage", "Stage", "Watch"]


@dataclass(frozen=True, slots=True)
class Decision:
    """What a player does in a step, as a sentence; nothing if it is empty."""

    action: str = ""
    reasoning: str = ""
    basis: int | None = None
    """The step on which it is based, where that is recorded."""
    anticipates: bool = False
    """Another's action in the same step is to make it possible."""


@dataclass(frozen=True, slots=True)
class Moved:
    """The state after a step, and who did what in it: player, action, whether it was applied.

    `seen` is the state before chance undid something, or the same if it did not. `refused` says
    of the actions that were not applied why.
    """

    state: State
    seen: State
    did: Did = ()
    refused: Mapping[str, Sequence[str]] = field(default_factory=dict)


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

    def refuse(self, player: str, decision: Decision, state: State | None = None) -> object:
        """A decision names no action that is valid in a state; in that of now if None."""
        ...

    def say(self, player: str, text: str) -> None:
        """A player says something to everybody."""
        ...


class PlainStage:
    """A world, and nothing else.

    Args:
        undone: What chance takes back after each step that has not reached the goal.
    """

    def __init__(self, world: World, undone: Undone = nothing_undone) -> None:
        self.state = world.initial
        self._undone = undone

    def step(self, decisions: Mapping[str, Decision]) -> Moved:
        """Take a step."""
        before = self.state
        actions = {
            p: before.world.parse(before, p, d.action) for p, d in decisions.items() if d.action
        }
        step = before.step(list(actions.values()))
        undone = () if step.goal_reached else self._undone(step.state)
        self.state = step.state.without(undone) if undone else step.state
        became = {attempt.action: attempt for attempt in step.attempts}
        did = tuple((p, a, became[a].applied) for p, a in actions.items())
        refused = {p: became[a].reasons for p, a in actions.items() if not became[a].applied}
        return Moved(self.state, step.state, did, refused)

    def answered(self, player: str, exchange: Exchange) -> None:
        """Is forgotten."""

    def refuse(self, player: str, decision: Decision, state: State | None = None) -> None:
        """Is forgotten."""

    def say(self, player: str, text: str) -> None:
        """Is forgotten."""


class RecordedStage:
    """An episode as the server plays it, with the recording that the server would write.

    Time is counted in steps: nothing is measured here, so that equal decisions give equal bytes.
    A step takes a second, or as long as `step_rate` says.

    `invalid` counts answers and decisions that named an action which was not valid (any more),
    `malformed` those that named none.

    Args:
        names: Who plays which player.
        kind: What all of them are.
        answered: Is told each exchange with a model, as soon as it is over.
        undone: What chance takes back after each step.
        step_rate: Steps a second in real time; None where the world waits for its players.
    """

    def __init__(
        self,
        world: World,
        names: Mapping[str, str],
        max_steps: int,
        *,
        kind: Kind = "bot",
        step_rate: float | None = None,
        episode: str = "local",
        answered: Callable[[str, Exchange], None] | None = None,
        undone: Undone = nothing_undone,
    ) -> None:
        rules = _rules(len(world.players), max_steps, step_rate)
        self._period = 1.0 if step_rate is None else rules.period
        self._world = world
        self._episode = Episode(world, rules, undone=undone)
        self._recorder = Recorder(world)
        self._bytes = self._recorder.begin(header(world.task, rules, episode=episode))
        self._now = 0.0
        self._seq = 0
        self.invalid = self.malformed = 0
        self._answered = answered
        self._notes = {player: CallNotes() for player in world.players}
        self._names = names
        for player in world.players:
            self._episode.join(player, names[player], kind, self._now)

    @property
    def state(self) -> State:
        """As it is now."""
        return self._episode.state

    def step(self, decisions: Mapping[str, Decision]) -> Moved:
        """Take a step, in which a player of whom nothing is said does nothing."""
        episode = self._episode
        self._now += self._period
        for player in self._world.players:
            decision = decisions.get(player, Decision())
            state = episode.state
            if episode.phase is not Phase.RUNNING or state.busy_steps(player):
                continue
            reasoning, basis = decision.reasoning[:MAX_REASONING], decision.basis
            try:
                said, late = decision.action, decision.anticipates
                action = self._world.parse(state, player, said, valid=not late) if said else None
            except UnknownNameError as error:
                self._too_late(player, said, error, reasoning)
                continue
            self._submit(player, action, reasoning, basis, anticipates=late)
        episode.tick(self._now)
        events = episode.events()
        self._bytes += self._recorder.record(events)
        stepped = [event for event in events if isinstance(event, Stepped)]
        did = [
            (move.player, attempt.action, attempt.applied)
            for event in stepped
            for move, attempt in zip(event.moves, event.attempts, strict=True)
        ]
        refused = {
            move.player: attempt.reasons
            for event in stepped
            for move, attempt in zip(event.moves, event.attempts, strict=True)
            if not attempt.applied
        }
        return Moved(episode.state, _unchanged(stepped, episode.state), tuple(did), refused)

    def _too_late(self, player: str, said: str, why: UnknownNameError, reasoning: str) -> None:
        """What was decided is not valid any more: it is recorded, and nothing is done."""
        fault = ProtocolError(ACTION_INVALID, str(why), "action")
        self._reject(player, said[:MAX_SENTENCE], fault, reasoning)
        self._submit(player, None, "")

    def _submit(
        self,
        player: str,
        action: GroundAction | None,
        reasoning: str,
        basis: int | None = None,
        *,
        anticipates: bool = False,
    ) -> None:
        self._seq += 1
        submit = partial(
            self._episode.submit,
            player,
            self._seq,
            action,
            self._now,
            basis=basis,
            anticipates=anticipates,
        )
        try:
            submit(reasoning=reasoning)
        except ProtocolError:  # No more reasoning of this seat is recorded.
            submit()

    @property
    def steps(self) -> int:
        """Steps that were taken."""
        return self._episode.step

    def answered(self, player: str, exchange: Exchange, basis: int | None = None) -> None:
        """Record what was sent and said, and what was no action; tell whoever wants to know.

        What comes when the episode is over is told, and not recorded.
        """
        if self._answered is not None:
            self._answered(player, exchange)
        if self._episode.ended:
            return
        self._note(player, exchange_note(self._notes[player], exchange, timed=False))
        if exchange.verdict.rejected:
            said = exchange.action or (exchange.completion.text if exchange.completion else "")
            said = said[:MAX_SENTENCE]
            actor = exchange.player or player
            known = not exchange.verdict.malformed and self._is_known(actor, said)
            code = ACTION_INVALID if known else ACTION_UNKNOWN
            why = ProtocolError(code, exchange.feedback, "action")
            self._reject(actor, said, why, exchange.reasoning[:MAX_REASONING], basis)

    def refuse(
        self, player: str, decision: Decision, state: State | None = None
    ) -> tuple[str, ...]:
        """Record that a decision names no action that is valid in a state (now, if None); why."""
        reasoning, said = decision.reasoning[:MAX_REASONING], decision.action[:MAX_SENTENCE]
        known = self._is_known(player, said)
        why = _why_not(state or self._episode.state, player, said)
        fault = ProtocolError(ACTION_INVALID if known else ACTION_UNKNOWN, why, "action")
        self._reject(player, said, fault, reasoning, decision.basis)
        return (why,)

    def say(self, player: str, text: str) -> None:
        """Have something recorded that a player says to everybody."""
        with suppress(ProtocolError):  # No more words of this seat are recorded.
            self._episode.say(self._names[player], player, text, self._now)

    def note(self, player: str, topic: str, text: str) -> None:
        """Have something recorded that a seat says to nobody."""
        with suppress(ProtocolError):  # No more notes of this seat are recorded.
            self._episode.note(player, topic, text[:MAX_NOTE], self._now)

    def _is_known(self, player: str, said: str) -> bool:
        """Whether a text names an action of the task, valid now or not."""
        try:
            self._world.parse(self._episode.state, player, said, valid=False)
        except UnknownNameError:
            return False
        return True

    def _note(self, player: str, text: str) -> None:
        for at in range(0, len(text), MAX_NOTE):
            with suppress(ProtocolError):  # No more notes of this seat are recorded.
                piece, more = text[at : at + MAX_NOTE], at + MAX_NOTE < len(text)
                self._episode.note(player, TOPIC, piece, self._now, more=more)

    def _reject(
        self,
        player: str,
        said: str,
        why: ProtocolError,
        reasoning: str,
        basis: int | None = None,
    ) -> None:
        self._seq += 1
        self.invalid += why.code == ACTION_INVALID
        self.malformed += why.code == ACTION_UNKNOWN
        told = why, self._now
        try:
            self._episode.reject(player, self._seq, said, *told, basis=basis, reasoning=reasoning)
        except ProtocolError:  # No more words of this seat are recorded; that it failed is.
            self._episode.reject(player, self._seq, "", *told, basis=basis)

    def recording(self, why: str = "the agent is done") -> bytes:
        """The whole recording; the episode is over."""
        if self._episode.outcome is None:
            self._episode.abort(self._now, why)
        self._bytes += self._recorder.record(self._episode.events())
        return self._bytes


Watch = Callable[[RecordedStage], Stage]
"""Puts something before the stage of each trial that sees what happens on it."""


def _rules(players: int, max_steps: int, step_rate: float | None) -> Rules:
    if step_rate is not None:
        return Rules(
            clock=Clock.REALTIME,
            thinking="declared",
            step_rate=step_rate,
            max_steps=max_steps,
            move_budget=0,
        )
    clock = Clock.TURN if players == 1 else Clock.LOCKSTEP
    return Rules(clock=clock, max_steps=max_steps, move_budget=0)


def _why_not(state: State, player: str, said: str) -> str:
    """Why a sentence is no valid action of a player."""
    try:
        state.world.parse(state, player, said)
    except UnknownNameError as error:
        return str(error)
    return "it is not valid now"


def _unchanged(stepped: Sequence[Stepped], state: State) -> State:
    """The state as the players' actions have left it, without what chance undid."""
    if not any(event.undone for event in stepped):
        return state
    last = stepped[-1]
    return last.before.step([move.action for move in last.moves]).state
