"""Runners of one episode in this process: a plain world, or an episode with its recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Protocol

from robotouille import GroundAction, State, World
from robotouille.episode import Clock, Episode, Phase, Rules, Stepped
from robotouille.episode.quota import MAX_NOTE
from robotouille.episode.record import RandomReversal, no_reversal
from robotouille.episode.seats import ActionRequest
from robotouille.errors import ProtocolError, UnknownNameError
from robotouille.planning.policies import Did
from robotouille.protocol.messages import Kind
from robotouille.replay.model_calls import TOPIC, CallNotes
from robotouille.replay.recorder import Recorder, header
from robotouille.world.text import MAX_SENTENCE
from robotouille_evaluation.agents.proposal import MAX_REASONING, Exchange, exchange_note

ACTION_INVALID, ACTION_UNKNOWN = "action/invalid", "action/unknown"


@dataclass(frozen=True, slots=True)
class ChosenAction:
    """Choice of a player for one step: the action's sentence, or nothing if it is empty."""

    action: str = ""
    reasoning: str = ""
    basis: int | None = None
    """Step whose state the choice is based on, if that is recorded."""
    anticipates: bool = False
    """Another player's action in the same step should make this one possible."""


@dataclass(frozen=True, slots=True)
class RunnerStep:
    """Result of one step.

    `did` lists player, action and whether it was applied. `undisturbed` is the state before a
    random reversal; without one it equals `state`. `rejected` has the reasons for the
    actions that were not applied.
    """

    state: State
    undisturbed: State
    did: Did = ()
    rejected: Mapping[str, Sequence[str]] = field(default_factory=dict)


class EpisodeRunner(Protocol):
    """One trial of an episode, which is taken step by step."""

    @property
    def state(self) -> State:
        """Current state."""
        ...

    def step(self, choices: Mapping[str, ChosenAction]) -> RunnerStep:
        """Take a step with the players' choices."""
        ...

    def answered(self, player: str, exchange: Exchange) -> None:
        """Handle a model's answer for a player."""
        ...

    def reject(self, player: str, choice: ChosenAction, state: State | None = None) -> object:
        """Handle a choice that is not valid in a state, by default the current one."""
        ...

    def say(self, player: str, text: str) -> None:
        """Handle a chat message of a player."""
        ...


RunnerWrapper = Callable[["RecordedRunner"], EpisodeRunner]
"""Wraps the runner of each trial, for example to show what happens."""


class PlainRunner:
    """Runner of a world that records nothing.

    Args:
        reversal: Chooses facts to reverse after each step that has not reached the goal.
    """

    def __init__(self, world: World, reversal: RandomReversal = no_reversal) -> None:
        self.state = world.initial
        self._reversal = reversal

    def step(self, choices: Mapping[str, ChosenAction]) -> RunnerStep:
        """Take a step."""
        before = self.state
        actions = {
            p: before.world.parse(before, p, c.action) for p, c in choices.items() if c.action
        }
        step = before.step(list(actions.values()))
        # As in an episode, a reached goal cannot be reversed.
        reversed_ = () if step.goal_reached else self._reversal(step.state)
        self.state = step.state.without(reversed_) if reversed_ else step.state
        attempts = {attempt.action: attempt for attempt in step.attempts}
        did = tuple((p, a, attempts[a].applied) for p, a in actions.items())
        rejected = {p: attempts[a].reasons for p, a in actions.items() if not attempts[a].applied}
        return RunnerStep(self.state, step.state, did, rejected)

    def answered(self, player: str, exchange: Exchange) -> None:
        """Ignore an answer."""

    def reject(self, player: str, choice: ChosenAction, state: State | None = None) -> None:
        """Ignore a rejected choice."""

    def say(self, player: str, text: str) -> None:
        """Ignore a chat message."""


def episode_rules(players: int, max_steps: int, step_rate: float | None = None) -> Rules:
    """Return the rules of an episode of a run; `step_rate` is for real time."""
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


class RecordedRunner:
    """Runner of an episode as on a server, with the recording that a server would write.

    The episode's time advances by a fixed period per step. No clock is read, so equal choices
    give equal bytes.

    `invalid` counts answers and choices with an action that is not valid; `malformed` counts those
    without an action.

    Args:
        names: Names of the participants by player.
        kind: Kind of all participants.
        episode: Identifier of the episode in the recording.
        reversal: Chooses facts to reverse after each step.
    """

    def __init__(
        self,
        world: World,
        names: Mapping[str, str],
        rules: Rules,
        *,
        kind: Kind = "bot",
        episode: str = "local",
        reversal: RandomReversal = no_reversal,
    ) -> None:
        self._period = rules.period if rules.clock is Clock.REALTIME else 1.0
        self._world = world
        self._episode = Episode(world, rules, random_reversal=reversal)
        self._recorder = Recorder(world)
        self._bytes = self._recorder.begin(header(world.task, rules, episode=episode))
        # Simulated seconds: a real clock would make every recording different.
        self._now = 0.0
        self._seq = 0
        self.invalid = self.malformed = 0
        self._notes = {player: CallNotes() for player in world.players}
        self._names = names
        # All seats are taken at once, so the episode starts at time 0.
        for player in world.players:
            self._episode.join(player, names[player], kind, self._now)

    @property
    def state(self) -> State:
        """Current state."""
        return self._episode.state

    @property
    def steps(self) -> int:
        """Number of steps taken."""
        return self._episode.step

    def step(self, choices: Mapping[str, ChosenAction]) -> RunnerStep:
        """Take a step. Players without a choice do nothing."""
        episode = self._episode
        self._now += self._period
        for player in self._world.players:
            choice = choices.get(player, ChosenAction())
            state = episode.state
            if episode.phase is not Phase.RUNNING or state.busy_steps(player):
                continue
            try:
                action = self._parse(state, player, choice)
            except UnknownNameError as error:
                self._reject_late(player, choice, error)
            else:
                self._submit(player, action, choice)
        episode.tick(self._now)
        events = episode.events()
        self._bytes += self._recorder.record(events)
        stepped = [event for event in events if isinstance(event, Stepped)]
        moves = [
            (move.player, attempt)
            for event in stepped
            for move, attempt in zip(event.moves, event.attempts, strict=True)
        ]
        did = tuple((player, attempt.action, attempt.applied) for player, attempt in moves)
        rejected = {player: attempt.reasons for player, attempt in moves if not attempt.applied}
        return RunnerStep(episode.state, _undisturbed(stepped, episode.state), did, rejected)

    def answered(self, player: str, exchange: Exchange, basis: int | None = None) -> None:
        """Record an exchange and, if its answer has no valid action, the rejection.

        After the end of the episode, there is nothing to record.
        """
        if self._episode.ended:
            return
        note = exchange_note(self._notes[player], exchange, timed=False)
        for piece, more in _pieces(note):
            with suppress(ProtocolError):  # The seat's quota of notes is used up.
                self._episode.note(player, TOPIC, piece, self._now, more=more)
        if exchange.verdict.rejected:
            text = exchange.action or (exchange.completion.text if exchange.completion else "")
            actor = exchange.player or player
            choice = ChosenAction(text, exchange.reasoning, basis)
            known = not exchange.verdict.malformed and self._is_known(actor, text[:MAX_SENTENCE])
            self._reject(actor, choice, known, exchange.feedback)

    def reject(
        self, player: str, choice: ChosenAction, state: State | None = None
    ) -> tuple[str, ...]:
        """Record that a choice is not valid in a state (by default now), and return the reason."""
        text = choice.action[:MAX_SENTENCE]
        why = _why_not(state or self._episode.state, player, text)
        self._reject(player, choice, self._is_known(player, text), why)
        return (why,)

    def say(self, player: str, text: str) -> None:
        """Record a chat message of a player."""
        with suppress(ProtocolError):  # The seat's quota of chat is used up.
            self._episode.say(self._names[player], player, text, self._now)

    def note(self, player: str, topic: str, text: str) -> None:
        """Record a note of a seat, which no participant receives."""
        with suppress(ProtocolError):  # The seat's quota of notes is used up.
            self._episode.note(player, topic, text[:MAX_NOTE], self._now)

    def recording(self, why: str = "the agent is done") -> bytes:
        """End the episode and return the whole recording."""
        if self._episode.outcome is None:
            self._episode.abort(self._now, why)
        self._bytes += self._recorder.record(self._episode.events())
        return self._bytes

    def _parse(self, state: State, player: str, choice: ChosenAction) -> GroundAction | None:
        if not choice.action:
            return None
        return self._world.parse(state, player, choice.action, valid=not choice.anticipates)

    def _submit(self, player: str, action: GroundAction | None, choice: ChosenAction) -> None:
        self._seq += 1
        request = ActionRequest(
            self._seq,
            action,
            basis=choice.basis,
            reasoning=choice.reasoning[:MAX_REASONING],
            anticipates=choice.anticipates,
        )
        try:
            self._episode.submit(player, request, self._now)
        except ProtocolError:  # The seat's quota of reasoning is used up.
            self._episode.submit(player, request._replace(reasoning=""), self._now)

    def _reject_late(self, player: str, choice: ChosenAction, why: UnknownNameError) -> None:
        """Record a choice that is no longer valid, and do nothing in its place."""
        self._reject(player, replace(choice, basis=None), True, str(why))
        self._submit(player, None, ChosenAction())

    def _reject(self, player: str, choice: ChosenAction, known: bool, why: str) -> None:
        self._seq += 1
        self.invalid += known
        self.malformed += not known
        fault = ProtocolError(ACTION_INVALID if known else ACTION_UNKNOWN, why, "action")
        request = ActionRequest(
            self._seq,
            choice.action[:MAX_SENTENCE],
            basis=choice.basis,
            reasoning=choice.reasoning[:MAX_REASONING],
        )
        try:
            self._episode.reject(player, request, fault, self._now)
        except ProtocolError:  # The seat's quota is used up: record the rejection without text.
            short = request._replace(action="", reasoning="")
            self._episode.reject(player, short, fault, self._now)

    def _is_known(self, player: str, text: str) -> bool:
        """Return whether a text names an action of the task, valid now or not."""
        try:
            self._world.parse(self._episode.state, player, text, valid=False)
        except UnknownNameError:
            return False
        return True


def _pieces(note: str) -> Iterator[tuple[str, bool]]:
    """Split a note into pieces that fit, each with whether more follow."""
    for at in range(0, len(note), MAX_NOTE):
        yield note[at : at + MAX_NOTE], at + MAX_NOTE < len(note)


def _why_not(state: State, player: str, text: str) -> str:
    try:
        state.world.parse(state, player, text)
    except UnknownNameError as error:
        return str(error)
    return "it is not valid now"


def _undisturbed(stepped: Sequence[Stepped], state: State) -> State:
    """Return the state after the players' actions, without random reversals."""
    if not any(event.undone for event in stepped):
        return state
    # A deterministic step repeats exactly, so it need not be kept.
    last = stepped[-1]
    return last.before.step([move.action for move in last.moves]).state
