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
from robotouille.world.unmet import from_words
from robotouille.world.world import State, World, shared_world
from robotouille_client.sansio.game_events import (
    ActResult,
    Announced,
    Changed,
    GameEvent,
    Heard,
    NotSaid,
    Observed,
    Over,
    Refused,
    RosterChanged,
)
from robotouille_client.sansio.sent_actions import ActionRequest, SentActions, wire_action
from robotouille_client.sansio.taken_step import TakenStep, told_unmet

__all__ = ["PRESENT", "GameReplica"]

NOT_SAID = frozenset({
    ErrorCode.CHAT_OFF, ErrorCode.CHAT_PHRASE, ErrorCode.SEAT_MUTED, ErrorCode.RATE_WORDS,
})  # fmt: skip
"""Errors that answer what was said or noted: such messages have no reference of their own."""

PRESENT = -1
"""As the basis of an action: the step that is known when it is sent."""

MAX_EVENTS = 10_000
MAX_STEP = 1_000_000
"""The rules allow no more: who remembers each step cannot remember any number."""
MAX_NAMED = 8
"""Of those who watch: more are not told."""


class GameReplica:
    """One episode: its state, its events, and what one does in it.

    `name` is what one is called in it: with a number where somebody else has the name that one
    asked for. `own_seats` are those that one plays, in seat order, and `seat` is the first of them;
    a spectator has none. `starts_at` is when the game begins, on the clock of `receive`, while that
    is counted down to; `spectators` counts those who watch, and `spectator_names` are those of the
    first few. `waits_for` are the seats that a step
    has waited for, for two seconds at least. `rematch_code` is that of the game in which they play
    again, once somebody has asked for one.
    """

    def __init__(self, joined: messages.Joined) -> None:
        self.episode = joined.episode
        self.code = joined.code
        self.role = joined.role
        self.name = joined.name
        self.seat = joined.seat
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
        self.can_anticipate, self.can_wait = joined.anticipates, joined.waits
        self._reader: StateReader | None = None
        self._observed: dict[str | None, Observed] = {}
        self._sent = SentActions(joined.seq)
        self._catch_up: int | None = None
        self._ready: bool | None = None
        self._outgoing: list[messages.Message] = []
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
        """The valid actions of one's seat; of the first where one has several."""
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
        """Whether a snapshot has come, or an observation of each seat."""
        views = self.own_seats or (None,)
        return self._reader is not None or all(seat in self._observed for seat in views)

    @property
    def observation(self) -> Observed | None:
        """What one's seat has been told in words; the first where one has several."""
        return self._observed.get(self.seat)

    @property
    def observations(self) -> Mapping[str, Observed]:
        """What each of one's seats has been told in words."""
        return {seat: seen for seat, seen in self._observed.items() if seat is not None}

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
        """Whether any of one's seats may act in the present step."""
        return any(self.may_act(seat) for seat in self.own_seats)

    def may_act(self, seat: str) -> bool:
        """Whether a seat is one's own, and may act in the present step."""
        if not self.running or seat not in self.own_seats or self.turn not in (None, seat):
            return False
        return not self.has_state or self.state.busy_steps(seat) == 0

    # Acting

    def propose(
        self,
        action: ActionRequest,
        now: float,
        *,
        seat: str | None = None,
        think_ms: int = 0,
        basis: int | None = PRESENT,
        reasoning: str | None = None,
        anticipates: bool = False,
        waits: bool = False,
    ) -> int:
        """An action is to be sent (None: do nothing); `results` tell of its number what became
        of it.

        While the connection is away it stays undecided: it is sent again, and not done twice.

        Args:
            seat: The one of one's seats that acts; the first if None.
            basis: The step on which the choice was made; None to leave it open.

        Raises:
            ProtocolError: `seat/none`: spectators do not act; `seat/unknown`: it is not one's own.
            ValueError: The message cannot have such an argument.
        """
        player = self._own_seat(seat)
        act = messages.Act(
            seq=self._sent.next_seq(),
            action=wire_action(action),
            basis=self.step if basis == PRESENT else basis,
            think_ms=think_ms,
            reasoning=reasoning,
            anticipates=anticipates and self.can_anticipate,
            waits=waits and self.can_wait,
            seat=self._seat_told(player),
        )
        if self.ended:
            self._sent.refuse(act.seq, self.step, "it is over", ErrorCode.EPISODE_OVER)
            return act.seq
        self._sent.add(player, act, now)
        self._outgoing.append(act)
        return act.seq

    def _own_seat(self, seat: str | None) -> str:
        """One of one's seats; the first if None."""
        player = self.seat if seat is None else seat
        if player is None or not self.own_seats:
            raise ProtocolError(ErrorCode.SEAT_NONE, "spectators do not act")
        if player not in self.own_seats:
            own = " and ".join(self.own_seats)
            raise ProtocolError(ErrorCode.SEAT_UNKNOWN, f"{player} is not yours: you play {own}")
        return player

    def _seat_told(self, player: str) -> str | None:
        """The seat as a message names it: servers of before know no such field."""
        return player if len(self.own_seats) > 1 else None

    def ready(self, ready: bool = True) -> None:
        """The game may begin as far as one's seats go; or, with False, not any more.

        It has a meaning before the beginning, and is told again after a lost connection.

        Raises:
            ProtocolError: `seat/none`: spectators are not waited for.
        """
        self._own_seat(None)
        self._ready = ready
        self._outgoing.append(messages.Ready(ready=ready))

    @property
    def is_ready(self) -> bool:
        """Whether the game does not wait for one's own seats; always, once it has begun."""
        return all(seat.ready for seat in self.seats if seat.player in self.own_seats)

    def say(self, text: str) -> None:
        """Say something to everybody in the episode."""
        self._outgoing.append(messages.Say(text=text))

    def note(self, topic: str, text: str, seat: str | None = None) -> None:
        """Have a text recorded, of any length, that nobody is told.

        Args:
            seat: The one of one's seats whose it is; the first if None.

        Raises:
            ProtocolError: `seat/unknown`: it is not one's own.
            ValueError: The message cannot have such a topic.
        """
        told = self._seat_told(self._own_seat(seat)) if self.own_seats else seat
        pieces = [text[at : at + MAX_NOTE] for at in range(0, len(text), MAX_NOTE)]
        for number, piece in enumerate(pieces, start=1):
            more = number < len(pieces)
            self._outgoing.append(messages.Note(topic=topic, text=piece, more=more, seat=told))

    @property
    def unanswered(self) -> tuple[messages.Act, ...]:
        """Of each of one's seats the last action, while it has no answer."""
        return self._sent.unanswered

    # What comes of it

    def messages_to_send(self) -> list[messages.Message]:
        """What is to be sent, in order; each message is given once."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def results(self) -> list[tuple[int, ActResult]]:
        """What became of actions since this was last asked, by their numbers."""
        return self._sent.results()

    def poll(self) -> list[GameEvent]:
        """What has happened since this was last asked, without waiting."""
        events = list(self._events)
        self._events.clear()
        return events

    # Time

    def get_timer(self) -> float | None:
        """When to call `handle_timer`; None while there is nothing to wait for."""
        return self._sent.get_timer()

    def handle_timer(self, now: float) -> None:
        """Send again what has had no answer for too long."""
        self._outgoing.extend(self._sent.repeat(now))

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
            case messages.Error(ref=None, code=code) if code in NOT_SAID:
                self._emit(NotSaid(code, message.message))
            case messages.Notice():
                self._emit(Announced(message.text))
            case messages.Roster():
                self.phase, self.seats = message.phase, self._all_seats(message.seats)
                self.turn, self.pause = message.turn, message.pause
                self.waits_for = tuple(message.waits_for)
                self.spectators = message.spectators
                self.spectator_names = tuple(message.spectator_names[:MAX_NAMED])
                self.rematch_code = message.rematch
                self._count_down(message.starts_in, now)
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
        self._sent.seq = max(self._sent.seq, joined.seq)
        self._resyncing = False
        self._resync_asked = 0
        if anew:
            reason = "the seat was lost and taken anew"
            self._sent.resolve_all(self.step, reason, ErrorCode.SEAT_LOST)
        if self._ready is not None and self.phase == "waiting":
            self._outgoing.append(messages.Ready(ready=self._ready))
        self._catch_up = joined.step
        self._caught_up(now)

    def _caught_up(self, now: float) -> None:
        """After what was missed, ask what became of the last actions."""
        if self._catch_up is not None and self._catch_up <= self.step:
            self._catch_up = None
            self._outgoing.extend(self._sent.repeat(now, all_of_them=True))

    def _snapshot(self, message: messages.Snapshot, now: float) -> None:
        if self._reader is not None and message.step < self.step:
            return
        if not 0 <= message.step <= MAX_STEP:
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "no game has so many steps")
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
        self.seats, self.clock = self._all_seats(message.seats), message.clock
        self.left, self.step_time = message.left, now
        self.pause, self.spectators = message.pause, message.spectators
        self.spectator_names = tuple(message.spectator_names[:MAX_NAMED])
        self._count_down(message.starts_in, now)
        self._sent.seq = max(self._sent.seq, message.seq)
        self._told(self.seat, message.last_seq, message.last_step, message.last_reasons)
        for answer in message.answers:
            self._told(answer.seat, answer.seq, answer.step, answer.reasons)
        self._emit(Changed(message.step, self.state, turn=message.turn))
        self._caught_up(now)
        if message.outcome is not None:
            self._finish(message.outcome)

    def _all_seats(self, told: Sequence[messages.SeatInfo]) -> tuple[messages.SeatInfo, ...]:
        """The seats, of which there are no more than players, where those are known."""
        if self._reader is not None and len(told) > len(self.world.players):
            raise ProtocolError(ErrorCode.STATE_MISMATCH, "there are more seats than players")
        return tuple(told)

    def _count_down(self, starts_in: float | None, now: float) -> None:
        self.starts_at = None if starts_in is None else now + starts_in

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
        previous, turn = self.state, self.turn
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
        taken = TakenStep.of(message, self.world)
        self.seats = taken.tallied(self.seats)
        for seat in self.own_seats:
            if (decided := taken.decided.get(seat)) is not None:
                seq, unmet = decided
                self._sent.settle(seat, seq, ActResult.of(message.step, unmet))
        self._sent.settle_idle(message.step, turn)
        did, waits = taken.did, taken.waits
        self._emit(Changed(message.step, state, previous, did, message.turn, waits))
        self._caught_up(now)

    def _told(self, seat: str | None, seq: int, step: int, reasons: Sequence[str]) -> None:
        """What became of a seat's last action, in words."""
        self._sent.settle(seat, seq, ActResult.of(step, from_words(*reasons)))

    def _observe(self, message: messages.Observation, now: float) -> None:
        if self.has_state:
            if message.step > self.step and not self._resyncing:
                self._resync()
        elif message.step < self.step:
            return
        else:
            self.step, self.turn, self.phase = message.step, message.turn, message.phase
            self.step_time = now
        seat = message.seat or self.seat
        told = message.step, message.text, tuple(message.actions), message.turn, seat
        self._observed[seat] = observed = Observed(*told)
        self._emit(observed)
        if not self.has_state:
            self._told(seat, message.seq, message.step, message.reasons)
            if all(seen.step >= message.step for seen in self._observed.values()):
                self._caught_up(now)

    def _rejected(self, message: messages.Rejected, now: float) -> None:
        limited = message.code == ErrorCode.RATE_LIMITED
        if limited and self._sent.slow_down(message.seq, now):
            return
        unmet = told_unmet(message.reasons, message.why)
        self._sent.resolve(message.seq, ActResult(False, message.step, unmet, message.code))
        told = message.seq, message.step, message.action, unmet, message.code
        self._emit(Refused(*told, message.seat or self.seat or ""))

    def _finish(self, outcome: Mapping[str, Any]) -> None:
        self.outcome, self.phase = outcome, "over"
        self._give_up(str(outcome.get("reason", "")))

    def _give_up(self, reason: str, code: str = "") -> None:
        if self.ended:
            return
        self.ended, self.farewell = True, reason
        self._sent.resolve_all(self.step, reason, ErrorCode.EPISODE_OVER)
        self._emit(Over(self.outcome or {}, reason, code))

    def _resync(self) -> None:
        self._resyncing = True
        self._resync_asked = 0
        self._outgoing.append(messages.Resync())

    def _emit(self, event: GameEvent) -> None:
        self._events.append(event)
