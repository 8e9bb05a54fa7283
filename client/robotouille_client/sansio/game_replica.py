"""A participant's copy of an episode, kept up to date by the server's messages.

`GameReplica` does no I/O and reads no clock. Its owner passes messages and the time to `receive`,
and calls `handle_timer` when `get_timer` says so. After each call, the owner collects messages
(`messages_to_send`), results of actions (`results`) and events (`poll`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Unpack

from robotouille.episode.quota import MAX_NOTE
from robotouille.episode.rules import MIN_STEP_RATE, Clock
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Intent, signal_from
from robotouille.world.unmet import only_words
from robotouille.world.world import State, World
from robotouille_client.sansio.event_queue import EventQueue
from robotouille_client.sansio.game_events import (
    ActRejected,
    ActResult,
    Announced,
    ChatReceived,
    ChatRejected,
    ChatRepeated,
    GameEnded,
    GameEvent,
    ObservationReceived,
    RosterChanged,
    StateChanged,
    TakenStep,
    TeamTold,
    unmet_from,
)
from robotouille_client.sansio.sent_actions import (
    ActDetails,
    RequestedAction,
    SentActions,
    wire_action,
)
from robotouille_client.sansio.state_copy import StateCopy

# Errors that answer a chat message or note. `say` and `note` have no `ref` to match.
CHAT_ERRORS = frozenset({
    ErrorCode.CHAT_OFF, ErrorCode.CHAT_PHRASE, ErrorCode.CHAT_TARGET, ErrorCode.SEAT_MUTED,
    ErrorCode.RATE_WORDS,
})  # fmt: skip


# The rules allow at most this many steps. A larger number from a faulty server would make clients
# that keep a row for each step allocate without limit.
MAX_STEP = 1_000_000
# Every server sends these rules. A hostile one may leave them out, or send others.
USUAL_RULES: Mapping[str, Any] = {
    "clock": Clock.LOCKSTEP, "step_rate": 5.0, "max_steps": MAX_STEP, "thinking": "wall",
}  # fmt: skip
# No window shows more names, and a list of thousands would cost memory in every client.
MAX_SPECTATOR_NAMES = 8
# Number of deltas after which an unanswered `resync` is sent again.
RESYNC_EVERY = 20


class GameReplica:
    """One episode: its state, its events and its participant's requests.

    Attributes:
        name: The participant's name in this episode, numbered if the name was taken.
        own_seats: The seats that the client plays, in seat order; empty for a spectator.
        seat: The first of `own_seats`, or None.
        starts_at: During the countdown, the time at which the game starts, on the clock of `now`.
        spectators: The number of spectators; `spectator_names` has the first few names.
        waits_for: The seats whose decisions the step has awaited for at least two seconds.
        rematch_code: The code of the rematch, once a participant has asked for one.
        ended: True if no more events follow: the episode ended, or the client is out of it.
        farewell: The reason for `ended`.
    """

    def __init__(self, joined: messages.Joined) -> None:
        self.episode = joined.episode
        self.code = joined.code
        self.role = joined.role
        self.name = joined.name
        self.seat = joined.seat
        # Servers before `seats` existed send `seat` only.
        self.own_seats = tuple(joined.seats) or ((joined.seat,) if joined.seat else ())
        self.step = 0
        self.phase = "waiting"
        self.turn: str | None = None
        self.seats: tuple[messages.SeatInfo, ...] = ()
        self.clock: Mapping[str, Any] = {}
        self.outcome: Mapping[str, Any] | None = None
        self.step_time = 0.0
        self.left: float | None = None
        self.pause: messages.Pause | None = None
        self.starts_at: float | None = None
        self.spectators = 0
        self.spectator_names: tuple[str, ...] = ()
        self.waits_for: tuple[str, ...] = ()
        self.rematch_code = ""
        self.said = joined.said
        self._repeatable = range(1, joined.said + 1)
        self.ended = False
        self.farewell = ""
        self._copy = StateCopy(self.seat, self.own_seats)
        self._observed: dict[str | None, ObservationReceived] = {}
        self._sent = SentActions(joined.seq)
        self._catch_up: int | None = None
        self._ready: bool | None = None
        self._outgoing: list[messages.Message] = []
        self._events = EventQueue()
        self._message_size = 0
        self._resyncing = False
        self._skipped_deltas = 0

    # State

    @property
    def state(self) -> State:
        """The current state.

        Raises:
            RuntimeError: No state is known, because no snapshot has arrived or the view is `text`.
        """
        return self._copy.state

    @property
    def has_state(self) -> bool:
        """True if there is a `state`: a snapshot has arrived, and the view is not `text`."""
        return self._copy.known

    @property
    def hidden(self) -> frozenset[str] | None:
        """The objects out of sight; None if the client receives the whole state.

        `state` has no facts about these objects, so it is not for simulation.
        """
        return self._copy.hidden

    @property
    def world(self) -> World:
        """The task's world, for planning without the server."""
        return self.state.world

    @property
    def actions(self) -> tuple[GroundAction, ...]:
        """The valid actions of `seat`; with limited sight, those that seem valid."""
        return self._copy.actions

    @property
    def goal_reached(self) -> bool:
        """True if the state reaches the goal; with limited sight, that is not known."""
        return self.hidden is None and self.state.goal_reached

    @property
    def text_view(self) -> str:
        """The state in words for `seat`, or for a spectator."""
        return self._copy.text_view

    @property
    def running(self) -> bool:
        """True if the phase is `running`."""
        return self.phase == "running"

    @property
    def paused(self) -> bool:
        """True if the phase is `paused`; `pause` has the reason."""
        return self.phase == "paused"

    @property
    def synced(self) -> bool:
        """True if a snapshot, or an observation of each seat, has arrived."""
        views = self.own_seats or (None,)
        return self.has_state or all(seat in self._observed for seat in views)

    @property
    def observation(self) -> ObservationReceived | None:
        """The last observation in words for `seat`."""
        return self._observed.get(self.seat)

    @property
    def observations(self) -> Mapping[str, ObservationReceived]:
        """The last observation in words for each seat of the client."""
        return {seat: seen for seat, seen in self._observed.items() if seat is not None}

    @property
    def seen(self) -> messages.Seen | None:
        """The part of the episode that a resumed session need not receive again."""
        if not self.synced:
            return None
        return messages.Seen(
            episode=self.episode, step=self.step, said=self.said, stale=self._resyncing
        )

    @property
    def finished(self) -> bool:
        """True if the episode has an outcome."""
        return self.outcome is not None

    @property
    def my_move(self) -> bool:
        """True if any of the client's seats may act in the current step."""
        return any(self.may_act(seat) for seat in self.own_seats)

    def may_act(self, seat: str) -> bool:
        """Return whether `seat` is one of the client's and may act in the current step."""
        if not self.running or seat not in self.own_seats or self.turn not in (None, seat):
            return False
        return not self.has_state or self.state.busy_steps(seat) == 0

    # Requests

    def propose(
        self,
        action: RequestedAction,
        now: float,
        seat: str | None = None,
        **details: Unpack[ActDetails],
    ) -> int:
        """Queue an action and return its sequence number, under which `results` reports it.

        If the connection is lost, the action stays undecided. It is sent again after the
        reconnect, and executed once.

        Args:
            action: The action, or None to do nothing.
            seat: The client's seat that acts; its first one by default.

        Raises:
            ProtocolError: `seat/none`: spectators cannot act; `seat/unknown`: not the client's.
            ValueError: The message does not allow one of the details.
        """
        player = self._own_seat(seat)
        details.setdefault("basis", self.step)
        act = messages.Act(
            seq=self._sent.next_seq(),
            action=wire_action(action),
            seat=self._seat_field(player),
            **details,
        )
        if self.ended:
            reason = "the episode has ended"
            self._sent.reject(act.seq, self.step, reason, ErrorCode.EPISODE_ENDED)
            return act.seq
        self._sent.add(player, act, now)
        self._outgoing.append(act)
        return act.seq

    def _own_seat(self, seat: str | None) -> str:
        player = self.seat if seat is None else seat
        if player is None or not self.own_seats:
            raise ProtocolError(ErrorCode.SEAT_NONE, "spectators cannot act")
        if player not in self.own_seats:
            own = " and ".join(self.own_seats)
            raise ProtocolError(ErrorCode.SEAT_UNKNOWN, f"{player} is not yours: you play {own}")
        return player

    def _seat_field(self, player: str) -> str | None:
        # Servers before `seat` existed reject the field, so a single seat goes without it.
        return player if len(self.own_seats) > 1 else None

    def ready(self, ready: bool = True) -> None:
        """Tell the server whether all of the client's seats are ready for the game.

        The client repeats the message after a lost connection. It has no effect after the start.

        Raises:
            ProtocolError: `seat/none`: games do not wait for spectators.
        """
        self._own_seat(None)
        self._ready = ready
        self._outgoing.append(messages.Ready(ready=ready))

    @property
    def is_ready(self) -> bool:
        """True if all of the client's seats are ready. Always true once the game has begun."""
        return all(seat.ready for seat in self.seats if seat.player in self.own_seats)

    def say(self, text: str) -> None:
        """Send a chat message to all participants."""
        self._outgoing.append(messages.Say(text=text))

    def signal(self, intent: str, target: str = "", seat: str | None = None) -> None:
        """Send a signal to all participants.

        Args:
            intent: `need`, `yours`, `look`, `wait` or `thanks`.
            target: The station, item or player that it points at; empty for none.
            seat: The client's seat that signals; its first one by default.

        Raises:
            ProtocolError: `seat/none` or `seat/unknown`: not the client's seat.
            ValueError: There is no such intent.
        """
        owner = self._seat_field(self._own_seat(seat))
        signal = messages.Signal(intent=Intent(intent), target=target or None, seat=owner)
        self._outgoing.append(signal)

    def note(self, topic: str, text: str, seat: str | None = None) -> None:
        """Add a text of any length to the recording, which people do not see.

        Args:
            seat: The client's seat that the note belongs to; its first one by default.

        Raises:
            ProtocolError: `seat/unknown`: not the client's seat.
            ValueError: The message does not allow this topic.
        """
        owner = self._seat_field(self._own_seat(seat)) if self.own_seats else seat
        # Messages have a maximum size. The server joins the pieces again.
        pieces = [text[at : at + MAX_NOTE] for at in range(0, len(text), MAX_NOTE)]
        for number, piece in enumerate(pieces, start=1):
            more = number < len(pieces)
            self._outgoing.append(messages.Note(topic=topic, text=piece, more=more, seat=owner))

    @property
    def unanswered(self) -> tuple[messages.Act, ...]:
        """The last action of each of the client's seats, if it has no answer."""
        return self._sent.unanswered

    # Output

    def messages_to_send(self) -> list[messages.Message]:
        """Return the queued messages in order, and empty the queue."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def results(self) -> list[tuple[int, ActResult]]:
        """Return the sequence numbers and results of actions decided since the last call."""
        return self._sent.results()

    def poll(self) -> list[GameEvent]:
        """Return the events since the last call, without waiting."""
        return self._events.take_all()

    # Time

    def get_timer(self) -> float | None:
        """Return when to call `handle_timer`, or None if there is nothing to wait for."""
        # Steps that a lost connection has missed may answer the action.
        return self._sent.get_timer() if self._catch_up is None else None

    def handle_timer(self, now: float) -> None:
        """Queue the actions again that have been unanswered for too long."""
        self._outgoing.extend(self._sent.repeat(now))

    # Messages

    def receive(self, message: messages.ServerMessage, now: float, size: int = 0) -> None:
        """Apply a message from the server; `size` is its size in bytes.

        Raises:
            ProtocolError: The message is inconsistent with the task or the state.
        """
        self._message_size = size
        match message:
            case messages.Snapshot():
                self._snapshot(message, now)
            case messages.Delta():
                self._delta(message, now)
            case messages.Observation():
                self._observe(message, now)
            case messages.Rejected():
                self._rejected(message, now)
            case messages.Told():
                self._check_players(message.seat)
                self._emit(TeamTold(message.seat, message.text))
            case messages.Said():
                if message.seat:
                    self._check_players(message.seat)
                # After a resume, the server repeats chat lines. Servers without numbered lines send
                # 0.
                if message.number > self.said or message.number == 0:
                    self.said = max(self.said, message.number)
                    signal = signal_from(message.intent, message.target)
                    chat = ChatReceived(message.name, message.seat, message.text, signal)
                    self._emit(chat)
                elif message.number in self._repeatable:
                    # A new program that returns to a game receives the recent chat.
                    self._repeatable = range(message.number + 1, self._repeatable.stop)
                    self._emit(ChatRepeated(message.name, message.seat, message.text))
            case messages.Error(ref=None, code=code) if code in CHAT_ERRORS:
                self._emit(ChatRejected(code, message.message))
            case messages.Notice():
                self._emit(Announced(message.text))
            case messages.Roster():
                self._roster(message, now)
            case messages.Ended():
                self._finish(message.outcome)
            case messages.Left():
                self._end(message.reason)
            case messages.Bye():
                self._end(message.reason, message.code)
            case _:
                pass

    def rejoined(self, joined: messages.Joined, now: float, *, new_session: bool = False) -> None:
        """Continue after a lost connection.

        Unanswered actions are sent again once the missed steps have arrived, because those may
        contain the answers.

        Args:
            new_session: True if the seat was lost and taken again. The server then has no record
                of earlier actions, so repeating one could execute it twice.
        """
        self.name = joined.name  # It may have a number now.
        self._sent.seq = max(self._sent.seq, joined.seq)
        self._resyncing = False
        if new_session:
            reason = "the seat was lost and taken again"
            self._sent.resolve_all(self.step, reason, ErrorCode.SEAT_LOST)
        if self._ready is not None and self.phase == "waiting":
            self._outgoing.append(messages.Ready(ready=self._ready))
        self._catch_up = joined.step
        self._caught_up(now)

    def _caught_up(self, now: float) -> None:
        if self._catch_up is not None and self._catch_up <= self.step:
            self._catch_up = None
            self._outgoing.extend(self._sent.repeat(now, every=True))

    def _snapshot(self, message: messages.Snapshot, now: float) -> None:
        # If a step is taken while a resync is under way, this snapshot may be older than the copy.
        if self.has_state and message.step < self.step:
            return
        if not 0 <= message.step <= MAX_STEP:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, f"invalid step {message.step}")
        self._copy.read(message)
        self._resyncing = False
        self.step, self.phase, self.turn = message.step, message.phase, message.turn
        self.seats, self.clock = self._checked_seats(message.seats), _checked(message.clock)
        self.left, self.step_time = message.left, now
        self.pause = message.pause
        self._show_audience(message, now)
        # Another process may have played this seat. Its sequence numbers must not be reused.
        self._sent.seq = max(self._sent.seq, message.seq)
        self._settle(self.seat, message.last_seq, message.last_step, message.last_reasons)
        for answer in message.answers:
            self._settle(answer.seat, answer.seq, answer.step, answer.reasons)
        self._emit(StateChanged(message.step, self.state, turn=message.turn))
        self._caught_up(now)
        if message.outcome is not None:
            self._finish(message.outcome)

    def _roster(self, message: messages.Roster, now: float) -> None:
        self.phase, self.seats = message.phase, self._checked_seats(message.seats)
        self.turn, self.pause = message.turn, message.pause
        self.waits_for = tuple(message.waits_for)
        self.rematch_code = message.rematch
        self._show_audience(message, now)
        self._emit(RosterChanged(message.phase, self.seats, message.pause, self.waits_for))

    def _show_audience(self, message: messages.Snapshot | messages.Roster, now: float) -> None:
        self.spectators = message.spectators
        self.spectator_names = tuple(message.spectator_names[:MAX_SPECTATOR_NAMES])
        self.starts_at = None if message.starts_in is None else now + message.starts_in

    def _checked_seats(self, seats: Sequence[messages.SeatInfo]) -> tuple[messages.SeatInfo, ...]:
        if self.has_state and len(seats) > len(self.world.players):
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "there are more seats than players")
        self._check_players(*(seat.player for seat in seats))
        return tuple(seats)

    def _check_players(self, *names: str) -> None:
        """Raise ProtocolError if a seat is not one of the task's.

        Bots remember seats, and a hostile server could invent any number of them.
        """
        unknown = set(names).difference(self.world.players) if self.has_state else set()
        if unknown:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, f"there is no seat {min(unknown)!r}")

    def _delta(self, message: messages.Delta, now: float) -> None:
        if not self.has_state:
            return
        if self._resyncing:
            # A snapshot was requested. Repeat the request from time to time, because the server may
            # have dropped it at a rate limit.
            self._skipped_deltas += 1
            if self._skipped_deltas % RESYNC_EVERY == 0:
                self._outgoing.append(messages.Resync())
            return
        if message.step <= self.step:
            return
        if message.step != self.step + 1:
            self._resync()
            return
        previous, turn = self.state, self.turn
        state = self._copy.apply(message)
        if state is None:
            self._resync()
            return
        self.step, self.turn = message.step, message.turn
        self.left, self.step_time = None, now
        taken = TakenStep.of(message, self.world)
        self.seats = taken.tallied(self.seats)
        for seat in self.own_seats:
            if (decided := taken.decided.get(seat)) is not None:
                seq, unmet = decided
                self._sent.settle(seat, seq, ActResult.of(message.step, unmet))
        self._sent.settle_idle(message.step, turn)
        did, waits = taken.did, taken.waits
        self._emit(StateChanged(message.step, state, previous, did, message.turn, waits))
        self._caught_up(now)

    def _settle(self, seat: str | None, seq: int, step: int, reasons: Sequence[str]) -> None:
        # The step of a rejection may be that of its arrival or of its attempt: the age is unknown.
        self._sent.settle(seat, seq, ActResult.of(step, only_words(*reasons)), aged=not reasons)

    def _observe(self, message: messages.Observation, now: float) -> None:
        seat = message.seat or self.seat
        if seat not in (self.own_seats or (None,)):
            return  # A hostile server could name a new seat in each observation.
        if self.has_state:
            # With the view `both`, an observation of a later step means that deltas are missing.
            if message.step > self.step and not self._resyncing:
                self._resync()
        elif message.step < self.step:
            return
        else:
            self.step, self.turn, self.phase = message.step, message.turn, message.phase
            self.step_time = now
        self._observed[seat] = observed = ObservationReceived(
            message.step, message.text, tuple(message.actions), message.turn, seat
        )
        self._emit(observed)
        if not self.has_state:
            self._settle(seat, message.seq, message.step, message.reasons)
            # Each seat has its own observation; a step is complete when all have arrived.
            if all(seen.step >= message.step for seen in self._observed.values()):
                self._caught_up(now)

    def _rejected(self, message: messages.Rejected, now: float) -> None:
        limited = message.code == ErrorCode.RATE_LIMITED
        if limited and self._sent.slow_down(message.seq, now):
            return
        unmet = unmet_from(message.reasons, message.why, message.code)
        self._sent.resolve(message.seq, ActResult(False, message.step, unmet, message.code))
        seat = message.seat or self.seat or ""
        self._emit(
            ActRejected(message.seq, message.step, message.action, unmet, message.code, seat)
        )

    def _finish(self, outcome: Mapping[str, Any]) -> None:
        self.outcome = {"reason": "", "steps": self.step, **outcome}
        self.phase = "ended"
        self._end(str(outcome.get("reason", "")))

    def _end(self, reason: str, code: str = "") -> None:
        if self.ended:
            return
        self.ended, self.farewell = True, reason
        self._sent.resolve_all(self.step, reason, ErrorCode.EPISODE_ENDED)
        self._emit(GameEnded(self.outcome or {}, reason, code))

    def _resync(self) -> None:
        self._resyncing = True
        self._skipped_deltas = 0
        self._outgoing.append(messages.Resync())

    def _emit(self, event: GameEvent) -> None:
        self._events.append(event, self._message_size)


def _checked(rules: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return rules with usual values for missing ones.

    Raises:
        ProtocolError: The step rate is too low to compute with.
    """
    rules = {**USUAL_RULES, **rules}
    if rules["step_rate"] < MIN_STEP_RATE:
        fault = f"invalid step rate {rules['step_rate']}"
        raise ProtocolError(ErrorCode.STATE_MISMATCH, fault)
    return rules
