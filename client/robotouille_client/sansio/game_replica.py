"""An episode as one participant sees it: a copy of the state, kept up to date by messages.

`GameReplica` does no I/O and reads no clock: it takes the server's messages and the time, and says
what to send (`messages_to_send`), what became of actions (`results`), what happened (`poll`), and
when to look again (`get_timer`, `handle_timer`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from robotouille.domain.task import Task
from robotouille.episode.quota import MAX_NOTE
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.states import StateReader
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, UnmetKind, from_words, only_words
from robotouille.world.world import State, World, shared_world
from robotouille_client.sansio.game_events import (
    ActResult,
    Announced,
    Changed,
    GameEvent,
    Heard,
    Observed,
    Over,
    Refused,
    RosterChanged,
)

__all__ = ["PRESENT", "ActionRequest", "GameReplica"]

PRESENT = -1
"""As the basis of an action: the step that is known when it is sent."""

MAX_EVENTS = 10_000
REPEAT_SECONDS = 5.0
"""After which an action without an answer is sent again; it acts once all the same."""
SLOW_DOWN_SECONDS = 0.25
"""After which an action that came too soon after many others is sent again."""

ActionRequest = GroundAction | messages.NamedAction | str | int | None
"""What one can ask to do: a ground action, a named one, its sentence, its place in the list of
valid actions, or None for nothing."""


class GameReplica:
    """One episode: its state, its events, and what one does in it.

    `name` is what one is called in it: with a number where somebody else has the name that one
    asked for. `waits_for` are the seats that a step has waited for, for two seconds at least.
    """

    def __init__(self, joined: messages.Joined) -> None:
        self.episode = joined.episode
        self.code = joined.code
        self.role = joined.role
        self.name = joined.name
        self.seat = joined.seat
        self.step = 0
        self.phase = "waiting"
        self.turn: str | None = None
        self.seats: tuple[messages.SeatInfo, ...] = ()
        self.clock: Mapping[str, Any] = {}
        self.outcome: Mapping[str, Any] | None = None
        self.observation: Observed | None = None
        self.step_time = 0.0
        self.left: float | None = None
        self.pause: messages.Pause | None = None
        self.waits_for: tuple[str, ...] = ()
        self.said = joined.said
        self.can_anticipate = joined.anticipates
        self._reader: StateReader | None = None
        self._seq = joined.seq
        self._undecided: set[int] = set()
        self._unanswered: messages.Act | None = None
        self._send_again_at: float | None = None
        self._catch_up: int | None = None
        self._outgoing: list[messages.Message] = []
        self._results: list[tuple[int, ActResult]] = []
        self._events: deque[GameEvent] = deque(maxlen=MAX_EVENTS)
        self._resyncing = False
        self._resync_asked = 0
        self.ended = False
        self.farewell = ""

    # State

    @property
    def state(self) -> State:
        """The current state.

        Raises:
            RuntimeError: There is none before the first snapshot, or in a text view.
        """
        if self._reader is None:
            raise RuntimeError("no state yet: the view is 'text', or the snapshot is on its way")
        return self._reader.state

    @property
    def has_state(self) -> bool:
        """Whether there is a `state`: not before the first snapshot, nor in a text view."""
        return self._reader is not None

    @property
    def world(self) -> World:
        """The task's world, on which one can plan without the server."""
        return self.state.world

    @property
    def actions(self) -> tuple[GroundAction, ...]:
        """The valid actions of this seat."""
        return self.state.actions(self.seat) if self.seat else ()

    @property
    def running(self) -> bool:
        """Whether time runs: the game has begun, and does not stand still."""
        return self.phase == "running"

    @property
    def paused(self) -> bool:
        """Whether the game stands still; `pause` says why."""
        return self.phase == "paused"

    @property
    def synced(self) -> bool:
        """Whether a snapshot or an observation has come."""
        return self._reader is not None or self.observation is not None

    @property
    def seen(self) -> messages.Seen | None:
        """What a server need not tell again; None before the first snapshot or observation."""
        if not self.synced:
            return None
        return messages.Seen(
            episode=self.episode, step=self.step, said=self.said, stale=self._resyncing
        )

    @property
    def over(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome is not None

    @property
    def my_move(self) -> bool:
        """Whether this seat may act in the present step."""
        if not self.running or self.seat is None or self.turn not in (None, self.seat):
            return False
        return not self.has_state or self.state.busy_steps(self.seat) == 0

    # Acting

    def propose(
        self,
        action: ActionRequest,
        now: float,
        *,
        think_ms: int = 0,
        basis: int | None = PRESENT,
        reasoning: str | None = None,
        anticipates: bool = False,
    ) -> int:
        """An action is to be sent (None: do nothing); `results` tell of its number what became
        of it.

        While the connection is away it stays undecided: it is sent again, and not done twice.

        Args:
            basis: The step on which the choice was made; None to leave it open.

        Raises:
            ProtocolError: `seat/none`: spectators do not act.
            ValueError: The message cannot have such an argument.
        """
        if self.seat is None:
            raise ProtocolError(ErrorCode.SEAT_NONE, "spectators do not act")
        self._seq += 1
        act = messages.Act(
            seq=self._seq,
            action=_wire_action(action),
            basis=self.step if basis == PRESENT else basis,
            think_ms=think_ms,
            reasoning=reasoning,
            anticipates=anticipates and self.can_anticipate,
        )
        if self.ended:
            self._results.append(
                (
                    act.seq,
                    ActResult(False, self.step, only_words("it is over"), ErrorCode.EPISODE_OVER),
                )
            )
            return act.seq
        self._undecided.add(act.seq)
        self._unanswered = act
        self._send_again_at = now + REPEAT_SECONDS
        self._outgoing.append(act)
        return act.seq

    def say(self, text: str) -> None:
        """Say something to everybody in the episode."""
        self._outgoing.append(messages.Say(text=text))

    def note(self, topic: str, text: str) -> None:
        """Have a text recorded, of any length, that nobody is told."""
        pieces = [text[at : at + MAX_NOTE] for at in range(0, len(text), MAX_NOTE)]
        for number, piece in enumerate(pieces, start=1):
            more = number < len(pieces)
            self._outgoing.append(messages.Note(topic=topic, text=piece, more=more))

    @property
    def unanswered(self) -> messages.Act | None:
        """The last action, while it has no answer."""
        return self._unanswered

    # What comes of it

    def messages_to_send(self) -> list[messages.Message]:
        """What is to be sent, in order; each message is given once."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def results(self) -> list[tuple[int, ActResult]]:
        """What became of actions since this was last asked, by their numbers."""
        results, self._results = self._results, []
        return results

    def poll(self) -> list[GameEvent]:
        """What has happened since this was last asked, without waiting."""
        events = list(self._events)
        self._events.clear()
        return events

    # Time

    def get_timer(self) -> float | None:
        """When to call `handle_timer`; None while there is nothing to wait for."""
        return self._send_again_at if self._unanswered is not None else None

    def handle_timer(self, now: float) -> None:
        """Send again what has no answer."""
        due = self.get_timer()
        if due is not None and due <= now:
            self._send_unanswered(now)

    def _send_unanswered(self, now: float) -> None:
        if self._unanswered is not None:
            self._send_again_at = now + REPEAT_SECONDS
            self._outgoing.append(self._unanswered)

    # Messages

    def receive(self, message: messages.ServerMessage, now: float) -> None:
        """Take a message of the server into account."""
        match message:
            case messages.Snapshot():
                self._snapshot(message, now)
            case messages.Delta():
                self._delta(message, now)
            case messages.Observation():
                self._observe(message, now)
            case messages.Rejected():
                self._rejected(message, now)
            case messages.Said():
                if message.number > self.said or message.number == 0:
                    self.said = max(self.said, message.number)
                    self._emit(Heard(message.name, message.seat, message.text))
            case messages.Notice():
                self._emit(Announced(message.text))
            case messages.Roster():
                self.phase, self.seats = message.phase, tuple(message.seats)
                self.turn, self.pause = message.turn, message.pause
                self.waits_for = tuple(message.waits_for)
                self._emit(RosterChanged(message.phase, self.seats, message.pause, self.waits_for))
            case messages.Ended():
                self._finish(message.outcome)
            case messages.Left():
                self._give_up(message.reason)
            case messages.Bye():
                self._give_up(message.reason, message.code)
            case _:
                pass

    def rejoined(self, joined: messages.Joined, now: float, *, anew: bool = False) -> None:
        """The connection is back: send again what is not answered by what was missed.

        `anew` says that the seat was lost and taken again: nobody knows what became of earlier
        actions, so they are not repeated.
        """
        self.name = joined.name
        self._seq = max(self._seq, joined.seq)
        self._resyncing = False
        self._resync_asked = 0
        if anew:
            self._resolve_all("the seat was lost and taken anew", ErrorCode.SEAT_LOST)
        self._catch_up = joined.step
        self._caught_up(now)

    def _caught_up(self, now: float) -> None:
        """After what was missed, ask what became of the last action."""
        if self._catch_up is not None and self._catch_up <= self.step:
            self._catch_up = None
            self._send_unanswered(now)

    def _snapshot(self, message: messages.Snapshot, now: float) -> None:
        if self._reader is not None and message.step < self.step:
            return
        if message.task is not None:
            world = shared_world(Task.from_json(message.task, "the server's task"))
        elif self._reader is not None:
            world = self._reader.world
        else:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "a snapshot without its task")
        values = message.model_dump(include={"facts", "timers", "busy"})
        tables = message.model_dump(include={"predicates", "objects", "atoms"})
        self._reader = StateReader(world, tables, values)
        if self._reader.state.digest != message.hash:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "the snapshot's state has another hash")
        self._resyncing = False
        self.step, self.phase, self.turn = message.step, message.phase, message.turn
        self.seats, self.clock = tuple(message.seats), message.clock
        self.left, self.step_time = message.left, now
        self.pause = message.pause
        self._seq = max(self._seq, message.seq)
        unmet = from_words(*message.last_reasons)
        code = ErrorCode.ACTION_INVALID if unmet else ""
        self._settle(message.last_seq, ActResult(not unmet, message.last_step, unmet, code))
        self._emit(Changed(message.step, self.state, turn=message.turn))
        self._caught_up(now)
        if message.outcome is not None:
            self._finish(message.outcome)

    def _delta(self, message: messages.Delta, now: float) -> None:
        if self._reader is None:
            return
        if self._resyncing:
            # The snapshot is on its way; ask again if the request was lost.
            self._resync_asked += 1
            if self._resync_asked % 20 == 0:
                self._outgoing.append(messages.Resync())
            return
        if message.step <= self.step:
            return
        if message.step != self.step + 1:
            self._resync()
            return
        previous = self.state
        try:
            state = self._reader.apply(message.model_dump(exclude_defaults=True))
        except ProtocolError:
            self._resync()
            return
        if message.hash is not None and state.digest != message.hash:
            self._resync()
            return
        self.step, self.turn = message.step, message.turn
        self.left, self.step_time = None, now
        did = self._did(message)
        self._tally(did)
        self._answer(message)
        self._emit(Changed(message.step, state, previous, did, message.turn))
        self._caught_up(now)

    def _tally(self, did: tuple[tuple[str, GroundAction, bool], ...]) -> None:
        """Count what each seat has done since the roster last came."""
        done = {player: applied for player, _, applied in did}
        self.seats = tuple(
            seat.model_copy(
                update={"applied": seat.applied + 1}
                if done[seat.player]
                else {"rejected": seat.rejected + 1}
            )
            if seat.player in done
            else seat
            for seat in self.seats
        )

    def _did(self, message: messages.Delta) -> tuple[tuple[str, GroundAction, bool], ...]:
        rows = []
        for i, (seat, name, *arguments) in enumerate(message.did):
            player = self.world.players[int(seat)]
            action = self.world.action(str(name), *map(str, arguments))
            rows.append((player, action, str(i) not in message.unmet))
        return tuple(rows)

    def _answer(self, message: messages.Delta) -> None:
        for i, (row, seq) in enumerate(zip(message.did, message.seq, strict=True)):
            if self.world.players[int(row[0])] == self.seat:
                unmet = _unmet(message.unmet.get(str(i), ()), message.why.get(str(i), ()))
                code = ErrorCode.ACTION_INVALID if unmet else ""
                self._settle(seq, ActResult(not unmet, message.step, unmet, code))
        # A decision to do nothing is answered by the step in which nothing was done.
        act = self._unanswered
        if act is not None and act.action is None:
            self._settle(act.seq, ActResult(True, message.step))

    def _observe(self, message: messages.Observation, now: float) -> None:
        if self.has_state:
            if message.step > self.step and not self._resyncing:
                self._resync()
        elif message.step < self.step:
            return
        else:
            self.step, self.turn, self.phase = message.step, message.turn, message.phase
            self.step_time = now
        observed = Observed(message.step, message.text, tuple(message.actions), message.turn)
        self.observation = observed
        self._emit(observed)
        if not self.has_state:
            unmet = from_words(*message.reasons)
            code = ErrorCode.ACTION_INVALID if unmet else ""
            self._settle(message.seq, ActResult(not unmet, message.step, unmet, code))
            self._caught_up(now)

    def _rejected(self, message: messages.Rejected, now: float) -> None:
        act = self._unanswered
        if message.code == ErrorCode.RATE_LIMITED and act is not None and act.seq == message.seq:
            self._send_again_at = now + SLOW_DOWN_SECONDS
            return
        unmet = _unmet(message.reasons, message.why)
        self._resolve(message.seq, ActResult(False, message.step, unmet, message.code))
        self._emit(Refused(message.seq, message.step, message.action, unmet, message.code))

    def _finish(self, outcome: Mapping[str, Any]) -> None:
        self.outcome, self.phase = outcome, "over"
        self._give_up(str(outcome.get("reason", "")))

    def _give_up(self, reason: str, code: str = "") -> None:
        if self.ended:
            return
        self.ended, self.farewell = True, reason
        self._resolve_all(reason, ErrorCode.EPISODE_OVER)
        self._emit(Over(self.outcome or {}, reason, code))

    def _settle(self, seq: int, result: ActResult) -> None:
        """The fate of action `seq` is known; those before it were replaced."""
        for earlier in sorted(s for s in self._undecided if s < seq):
            superseded = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {seq}")
            self._resolve(
                earlier, ActResult(False, result.step, (superseded,), ErrorCode.ACTION_INVALID)
            )
        self._resolve(seq, result)

    def _resolve_all(self, reason: str, code: str) -> None:
        for seq in sorted(self._undecided):
            self._resolve(seq, ActResult(False, self.step, only_words(reason), code))

    def _resolve(self, seq: int, result: ActResult) -> None:
        if self._unanswered is not None and self._unanswered.seq == seq:
            self._unanswered = None
        if seq in self._undecided:
            self._undecided.remove(seq)
            self._results.append((seq, result))

    def _resync(self) -> None:
        self._resyncing = True
        self._resync_asked = 0
        self._outgoing.append(messages.Resync())

    def _emit(self, event: GameEvent) -> None:
        self._events.append(event)


def _wire_action(action: ActionRequest) -> messages.NamedAction | str | int | None:
    if isinstance(action, GroundAction):
        return messages.NamedAction(name=action.name, args=list(action.arguments))
    return action


def _unmet(words: Sequence[str], why: Sequence[messages.Why]) -> tuple[Unmet, ...]:
    """Reasons with their words; an older server gives the words alone."""
    if len(words) != len(why):
        return from_words(*words)
    return tuple(each.value(said) for each, said in zip(why, words, strict=True))
