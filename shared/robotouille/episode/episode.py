"""An episode: seats, a clock and a world, without I/O.

Messages and the time go in, events come out. Nothing here reads a clock, so an episode takes the
same course alone or beside a hundred others, in real or in simulated time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from enum import Enum
from math import ceil

from robotouille.episode.events import (
    Announced,
    Ended,
    Event,
    Moderated,
    Move,
    Outcome,
    Paused,
    QuotaReached,
    Reason,
    Rejected,
    Restarted,
    Resumed,
    RosterChanged,
    Said,
    SeatTally,
    Started,
    Stepped,
)
from robotouille.episode.pauses import PauseReason
from robotouille.episode.presence import Presence
from robotouille.episode.quota import (
    MAX_AUDIENCE_BYTES,
    NOTE_BYTES,
    Quota,
    check_words,
    size_of_rejection,
)
from robotouille.episode.rules import Absence, Clock, Rules
from robotouille.episode.seats import ActionAnswer, Controller, Departure, Pending, Seat
from robotouille.errors import ProtocolError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["Episode", "Phase"]

MAX_CATCH_UP = 10
MAX_STEPS_AT_ONCE = 50
"""Steps taken for one message; what is left is taken when time is told next."""


class Phase(Enum):
    """The life of an episode."""

    WAITING = "waiting"
    RUNNING = "running"
    OVER = "over"


DEPARTURES = {
    Departure.LEFT: "left",
    Departure.LOST: "did not come back",
    Departure.REMOVED: "was removed by the operator",
}
TRANSITIONS = {
    Phase.WAITING: {Phase.RUNNING, Phase.OVER},
    Phase.RUNNING: {Phase.OVER},
    Phase.OVER: set[Phase](),
}


class Episode:
    """One game of a task under some rules. `said` counts chat messages; `used` says whether
    anybody ever took a seat; `holds` are the reasons for which time stands still at present;
    `asked` is when the present step began, and with it everybody's move budget; `banned` are the
    sessions and participants that may not come in, `muted` the participants that may not talk."""

    __slots__ = (
        "_arrivals",
        "_backlog",
        "_by_turns",
        "_deadline",
        "_events",
        "_next_step",
        "_presence",
        "_started",
        "_told_holds",
        "_turn",
        "asked",
        "audience_words",
        "banned",
        "holds",
        "muted",
        "outcome",
        "phase",
        "rules",
        "said",
        "scheduled",
        "seats",
        "state",
        "step",
        "used",
        "world",
    )

    def __init__(self, world: World, rules: Rules, now: float = 0.0) -> None:
        self.world = world
        self.rules = rules
        self.state: State = world.initial
        self.step = 0
        self.phase = Phase.WAITING
        self.outcome: Outcome | None = None
        self.seats = {p: Seat(p, tally=SeatTally(p)) for p in world.players}
        self.said = 0
        self.audience_words = Quota(MAX_AUDIENCE_BYTES)
        self.used = False
        self.banned: set[str] = set()
        self.muted: set[str] = set()
        self._presence = Presence(self.seats, rules)
        self.holds = self._presence.holds
        self._turn = 0
        self._arrivals = 0
        self._started = 0.0
        self.asked = now
        self._deadline: float | None = None
        self._next_step = 0.0
        self._backlog: float | None = None
        self.scheduled = rules.scheduled
        self._by_turns = rules.clock is Clock.TURN
        self._events: list[Event] = []
        self._told_holds: tuple[str, ...] = ()
        self._presence.watch(now, running=False)

    # Who plays

    def join(
        self,
        player: str | None,
        name: str,
        kind: str,
        now: float,
        *,
        session: str = "",
        participant: str = "",
    ) -> str:
        """Take a seat (any free one if `player` is None); starts the game when all are taken."""
        if self.phase is Phase.OVER:
            raise ProtocolError("episode/over", "the episode is over", "episode")
        seat = self._free_seat() if player is None else self.seat(player)
        if seat.taken:
            raise ProtocolError("seat/taken", f"{seat.player} is played by {seat.name}", "seat")
        seat.take(name, kind, session, participant, now)
        self.used = True
        self._roster(seat, now)
        self._attend(now)
        if self.phase is Phase.WAITING and all(s.taken for s in self.seats.values()):
            self._start(now)
        return seat.player

    def seat(self, player: str) -> Seat:
        """The seat of a player; ProtocolError `seat/unknown` if there is none."""
        if player not in self.seats:
            listed = ", ".join(self.seats)
            raise ProtocolError("seat/unknown", f"no seat {player!r}; there are {listed}", "seat")
        return self.seats[player]

    def leave(self, player: str, now: float, why: Departure = Departure.LEFT) -> None:
        """Give a seat up for good; the absence policy says what becomes of the game."""
        seat = self.seat(player)
        if not seat.taken or self.phase is Phase.OVER:
            return
        name = seat.name
        seat.free()
        seat.away = now
        self._roster(seat, now, why.value)
        if self.phase is Phase.RUNNING and self.rules.absence is Absence.END:
            self._end(Reason.ABANDONED, now, f"{name} {DEPARTURES[why]}")
        else:
            self._attend(now)

    def set_present(
        self, player: str, present: bool, now: float, *, generation: int | None = None
    ) -> None:
        """A seat's connection was lost or is back (with a resume token of this generation)."""
        seat = self.seat(player)
        changed = seat.present != present or generation not in (None, seat.generation)
        if not seat.taken or not changed or self.phase is Phase.OVER:
            return
        if seat.present != present:
            seat.asked = seat.away = now
        if seat.pending is not None and seat.pending.seq == 0:
            seat.pending = None
        seat.present = present
        if generation is not None:
            seat.generation = generation
        self._roster(seat, now)
        self._attend(now)

    def _free_seat(self) -> Seat:
        for seat in self.seats.values():
            if not seat.taken:
                return seat
        message = f"all {len(self.seats)} seats are taken"
        if away := [seat.name for seat in self.seats.values() if not seat.present]:
            message += f"; {' and '.join(away)} may still come back to theirs"
        raise ProtocolError("episode/full", message, "episode")

    def _roster(self, seat: Seat, now: float, why: str = "") -> None:
        seat.controller = self._controller(seat)
        self._emit(
            RosterChanged(
                seat.player,
                seat.name,
                seat.kind,
                seat.present,
                self._elapsed(now),
                taken=seat.taken,
                controller=seat.controller.value,
                session=seat.session,
                participant=seat.participant,
                generation=seat.generation,
                why=why,
            )
        )

    def _controller(self, seat: Seat) -> Controller:
        if seat.present:
            return Controller(seat.kind)
        if self.phase is Phase.RUNNING and self.rules.absence is Absence.BOT:
            return Controller.STAND_IN
        return Controller.ABSENT if seat.taken else Controller.FREE

    # Who is missing

    @property
    def paused(self) -> bool:
        """Whether the game has begun, is not over, and stands still."""
        return self.phase is Phase.RUNNING and bool(self.holds)

    @property
    def running(self) -> bool:
        """Whether the game has begun, is not over, and time runs."""
        return self.phase is Phase.RUNNING and not self.holds

    @property
    def waits_for(self) -> tuple[str, ...]:
        """The players whose decision the present step waits for; none where the clock rules."""
        if self.scheduled or not self.running:
            return ()
        asked = (self.seats[self.on_turn],) if self.on_turn else self.seats.values()
        return tuple(seat.player for seat in asked if not self._decided(seat))

    @property
    def _running(self) -> bool:
        return self.phase is Phase.RUNNING

    def _attend(self, now: float) -> None:
        self._presence.watch(now, running=self._running)
        self._reckon(now)

    def hold(self, why: PauseReason, now: float, until: float | None = None) -> None:
        """Let time stand still, until it is released or the time `until` has come."""
        if self.phase is not Phase.OVER and why not in self.holds:
            self.holds.until[why] = until
            self._reckon(now)

    def release(self, why: PauseReason, now: float) -> None:
        """Let time run again, as far as this reason goes."""
        if why in self.holds:
            self._presence.lift(why, now, running=self._running)
            self._reckon(now)

    def _reckon(self, now: float) -> None:
        """The reasons to stand still may have changed."""
        if self.phase is not Phase.RUNNING:
            return
        holds = tuple(why.value for why in self.holds.until)
        if holds != self._told_holds:
            self._told_holds = holds
            if not holds:
                self._next_step = max(self._next_step, now + self.rules.period)
                self._ask(now)
            self._emit(Paused(holds, self._elapsed(now)) if holds else Resumed(self._elapsed(now)))
        self._advance(now)

    # What they do

    def submit(
        self,
        player: str,
        seq: int,
        action: GroundAction | None,
        now: float,
        *,
        think_ms: int = 0,
        reasoning: str = "",
    ) -> None:
        """A seat's action for the next step; None decides to do nothing.

        An action whose preconditions do not hold is rejected at once and may be replaced. The
        same `seq` again acts no second time (`Seat.answer` tells its fate); a lower one is stale.
        While time stands still an action waits. ProtocolError `rate/words` where no more reasoning
        is recorded of the seat; it may act without.
        """
        seat = self.seat(player)
        self._check_running()
        if seq < seat.seq:
            message = f"action {seq} is older than {seat.seq}; ask for a snapshot"
            raise ProtocolError("action/stale", message, "seq")
        if seq == seat.seq and seq > 0:
            return
        if reasoning:
            self._check_words(seat.words, len(reasoning.encode()), player, now, "act without")
        seat.seq = seq
        reasons = self._refusals(seat, action)
        if reasons:
            self._reject(seat, Pending(action, seq, 0.0, 0, 0, reasoning), reasons, now)
            return
        if seat.pending is not None and seat.pending.seq > 0:
            self._reject(seat, seat.pending, (f"superseded by action {seq}",), now)
        self._await_step(seat, action, seq, now, self._thinking_steps(think_ms), reasoning)

    def substitute(self, player: str, action: GroundAction | None, now: float) -> None:
        """A stand-in's action for the next step; nothing happens if it is not in control (any
        more), and one whose preconditions do not hold is taken for nothing."""
        seat = self.seat(player)
        if self.phase is Phase.RUNNING and seat.controller is Controller.STAND_IN:
            taken = None if self._refusals(seat, action) else action
            self._await_step(seat, taken, 0, now)

    def _await_step(
        self,
        seat: Seat,
        action: GroundAction | None,
        seq: int,
        now: float,
        steps: int = 0,
        reasoning: str = "",
    ) -> None:
        self._arrivals += 1
        latency = max(0.0, now - seat.asked)
        due = self.step + steps
        seat.pending = Pending(action, seq, latency, self._arrivals, due, reasoning)
        self._advance(now)

    def say(self, name: str, player: str, text: str, now: float) -> None:
        """A chat message to everybody in the episode; it is recorded."""
        if self.phase is Phase.OVER:
            raise ProtocolError("episode/over", "the episode is over", "episode")
        words = self.seat(player).words if player else self.audience_words
        size = NOTE_BYTES + len(name.encode()) + len(text.encode())
        self._check_words(words, size, player, now, "you can say no more here")
        if player:
            self.seat(player).tally.said += 1
        self.said += 1
        self._emit(Said(name, player, text, self._elapsed(now), self.said))

    def _check_words(self, words: Quota, size: int, player: str, now: float, what: str) -> None:
        reached = words.reached
        try:
            check_words(words, size, what)
        finally:
            if words.reached and not reached:
                self._emit(QuotaReached(player, self._elapsed(now)))

    def announce(self, text: str, now: float) -> None:
        """Something the operator says to everybody in the episode; it is recorded."""
        if self.phase is not Phase.OVER:
            self._emit(Announced(text, self._elapsed(now)))

    def moderate(self, what: str, session: str, participant: str, name: str, now: float) -> None:
        """An operator's decision on somebody: `banned`, `muted` or `unmuted`; it is recorded, as
        long as the episode is not over."""
        self.retrace_moderation(what, session, participant)
        if self.phase is not Phase.OVER:
            self._emit(Moderated(what, session, participant, name, self._elapsed(now)))

    def _check_running(self) -> None:
        if self.phase is Phase.WAITING:
            free = sum(not seat.taken for seat in self.seats.values())
            message = f"the episode waits for {free} more player{'s' * (free > 1)}"
            raise ProtocolError("episode/waiting", message, "episode")
        if self.phase is Phase.OVER:
            raise ProtocolError("episode/over", "the episode is over", "episode")

    def _refusals(self, seat: Seat, action: GroundAction | None) -> tuple[str, ...]:
        if self.rules.clock is Clock.TURN and self.on_turn != seat.player:
            return (f"it is {self.on_turn}'s turn",)
        if action is None:
            return ()
        if action.player is not None and action.player != seat.player:
            return (f"{action.player} is not yours to move: you play {seat.player}",)
        if self.world.applicable(self.state, action):
            return ()
        return self.world.unmet(self.state, action)

    def _reject(self, seat: Seat, refused: Pending, reasons: tuple[str, ...], now: float) -> None:
        action, seq = refused.action, refused.seq
        sentence = action.sentence if action is not None else "nothing"
        seat.answer = ActionAnswer(seq, self.step, reasons)
        seat.tally.rejected += 1
        time, reached = self._elapsed(now), seat.words.reached
        recorded = seat.words.take(size_of_rejection(sentence, reasons))
        if seat.words.reached and not reached:
            self._emit(QuotaReached(seat.player, time))
        self._emit(Rejected(seat.player, seq, sentence, reasons, time, refused.reasoning, recorded))

    def _thinking_steps(self, think_ms: int) -> int:
        if self.rules.clock is Clock.REALTIME and self.rules.thinking == "declared":
            return ceil(think_ms / 1000 * self.rules.step_rate)
        return 0

    # Time

    @property
    def on_turn(self) -> str | None:
        """Whose turn it is, with the turn clock."""
        if not self._by_turns or self.phase is not Phase.RUNNING:
            return None
        return self.world.players[self._turn]

    def due(self) -> float | None:
        """When `tick` has something to do; None while only messages can move the episode."""
        if self.phase is Phase.OVER:
            return None
        if self._presence.complete and not self.holds.until:
            return self._clock_due()
        clock = None if self.holds else self._clock_due()
        absence = self._presence.due(running=self._running)
        return min((time for time in (clock, absence) if time is not None), default=None)

    def _clock_due(self) -> float | None:
        if self.phase is not Phase.RUNNING:
            return None
        if self._backlog is not None:
            return self._backlog
        return self._next_step if self.scheduled else self._deadline

    def tick(self, now: float) -> None:
        """Let time pass: take the steps that are due, give up what has been waited for enough."""
        if self.holds.until or not self._presence.complete:
            self._tick_absence(now)
        if self.phase is not Phase.RUNNING or self.holds.until:
            return
        if self.scheduled:
            self._take_scheduled(now)
        elif self._backlog is not None:
            self._advance(now)
        elif self._deadline is not None and now >= self._deadline:
            self._take_step(now)
            self._advance(now)

    def _tick_absence(self, now: float) -> None:
        """Give up what has been waited for long enough."""
        for why in self.holds.expired(now):
            if why in (PauseReason.DESERTED, PauseReason.ABSENCE):
                self._end(Reason.ABANDONED, now, self._presence.missing())
                return
            self.release(why, now)
        for seat in self._presence.overdue(now, running=self._running):
            self.leave(seat.player, now, Departure.LOST)

    def abort(self, now: float, detail: str) -> None:
        """End the episode from outside, e.g. because the server shuts down."""
        if self.phase is not Phase.OVER:
            self._end(Reason.ABORTED, now, detail)

    def events(self) -> list[Event]:
        """What has happened since this was last asked, in order."""
        if not self._events:
            return []
        events, self._events = self._events, []
        return events

    def _start(self, now: float) -> None:
        self._to(Phase.RUNNING)
        self._started = now
        self._next_step = now + self.rules.period
        self._emit(Started(0.0))
        for seat in self.seats.values():
            if not seat.present:
                self._roster(seat, now)
        self._attend(now)
        if self.state.goal_reached:
            self._end(Reason.GOAL, now)
            return
        self._ask(now)
        self._advance(now)

    def _take_scheduled(self, now: float) -> None:
        taken = 0
        while self.phase is Phase.RUNNING and now >= self._next_step:
            self._take_step(self._next_step)
            self._next_step += self.rules.period
            taken += 1
            if taken >= MAX_CATCH_UP:
                self._next_step = max(self._next_step, now + self.rules.period)

    def _advance(self, now: float) -> None:
        """Take steps for as long as nobody needs to be waited for."""
        self._backlog = None
        if self.scheduled:
            return
        for _ in range(MAX_STEPS_AT_ONCE):
            if self.phase is not Phase.RUNNING or self.holds:
                return
            if not self._all_decided():
                return
            self._take_step(now)
        self._backlog = now

    def _all_decided(self) -> bool:
        if self.rules.clock is Clock.TURN:
            return self._decided(self.seats[self.world.players[self._turn]])
        return all(self._decided(seat) for seat in self.seats.values())

    def _decided(self, seat: Seat) -> bool:
        return seat.pending is not None or not seat.active or self.state.busy_steps(seat.player) > 0

    def _ask(self, now: float) -> None:
        """Everybody who has to decide has its budget from now on."""
        self.asked = now
        for seat in self.seats.values():
            seat.asked = now
        budget = None if self.scheduled else self.rules.move_budget
        self._deadline = now + budget if budget else None

    def _take_step(self, now: float) -> None:
        moves, idle = self._moves()
        if self._transition(moves, idle, self._elapsed(now)):
            self._end(Reason.GOAL, now)
        elif self.step >= self.rules.max_steps:
            self._end(Reason.STEP_LIMIT, now)
        else:
            self._ask(now)

    def _transition(
        self, moves: tuple[Move, ...], idle: tuple[tuple[str, int], ...], time: float
    ) -> bool:
        """Take a joint action; whether it reaches the goal."""
        before = self.state
        result = before.step([move.action for move in moves])
        self.step += 1
        self.state = result.state
        acted = {}
        for move, attempt in zip(moves, result.attempts, strict=True):
            acted[move.player] = attempt.applied
            if move.seq > 0:
                reasons = () if attempt.applied else attempt.unmet
                self.seats[move.player].answer = ActionAnswer(move.seq, self.step, reasons)
        self._count(acted)
        self._turn = (self._turn + 1) % len(self.world.players)
        turn = self.on_turn
        self._emit(Stepped(self.step, time, moves, result.attempts, before, self.state, turn, idle))
        return result.goal_reached

    def _moves(self) -> tuple[tuple[Move, ...], tuple[tuple[str, int], ...]]:
        """The joint action: in order of arrival where the wall clock rules, else in seat order;
        and the decisions to do nothing, as seats with their sequence numbers."""
        idle = []
        ready = []
        for seat in self.seats.values():
            pending = seat.pending
            if pending is not None and pending.due_step <= self.step:
                seat.pending = None
                if pending.seq > 0:
                    seat.answer = ActionAnswer(pending.seq, self.step + 1)
                    if pending.action is None:
                        idle.append((seat.player, pending.seq))
                if pending.action is not None:
                    move = Move(
                        seat.player,
                        pending.action,
                        pending.seq,
                        pending.latency,
                        pending.reasoning,
                    )
                    ready.append((pending.order, move))
        if self.scheduled and len(ready) > 1:
            ready.sort(key=lambda pair: pair[0])
        return tuple([move for _, move in ready]), tuple(idle)

    def _count(self, acted: dict[str, bool]) -> None:
        turn = self.on_turn
        for seat in self.seats.values():
            ok = acted.get(seat.player)
            if ok:
                seat.tally.applied += 1
            elif ok is False:
                seat.tally.rejected += 1
            elif turn in (None, seat.player):
                seat.tally.idle += 1

    def _end(self, reason: Reason, now: float, detail: str = "") -> None:
        self._to(Phase.OVER)
        self._deadline = None
        self.holds.until.clear()
        tallies = tuple(replace(seat.tally) for seat in self.seats.values())
        self.outcome = Outcome(reason, self.step, self._elapsed(now), tallies, detail)
        self._emit(Ended(self.outcome))

    def _to(self, phase: Phase) -> None:
        if phase not in TRANSITIONS[self.phase]:
            raise AssertionError(f"{self.phase} cannot become {phase}")
        self.phase = phase

    def _elapsed(self, now: float) -> float:
        return max(0.0, now - self._started) if self.phase is not Phase.WAITING else 0.0

    def _emit(self, event: Event) -> None:
        self._events.append(event)

    # Going on where another process stopped

    def retrace_start(self) -> None:
        """Begin again, as recorded; nothing is reported."""
        self._to(Phase.RUNNING)

    def retrace(self, moves: Iterable[Move], idle: Iterable[tuple[str, int]] = ()) -> None:
        """Take a recorded step again; nothing is reported."""
        moves = tuple(moves)
        for player, seq in [*((move.player, move.seq) for move in moves), *idle]:
            seat = self.seats[player]
            seat.seq = max(seat.seq, seq)
        for player, seq in idle:
            self.seats[player].answer = ActionAnswer(seq, self.step + 1)
        self._transition(moves, tuple(idle), 0.0)
        self._events.clear()

    def retrace_moderation(self, what: str, session: str, participant: str) -> None:
        """Apply a recorded decision of an operator; nothing is reported."""
        match what:
            case "banned":
                self.banned |= {session, participant} - {""}
            case "muted":
                self.muted.add(participant or session)
            case "unmuted":
                self.muted.discard(participant or session)
            case _:
                raise ValueError(f"no moderation is called {what!r}")

    def go_on(
        self,
        now: float,
        *,
        elapsed: float,
        patience: float,
        expected: Collection[str] = (),
        held: bool = False,
    ) -> None:
        """After a restart: everybody who was present, and whoever else is `expected`, is waited
        for, for `patience` seconds. `held` is a pause of the operator that goes on."""
        begun = self.phase is Phase.RUNNING
        self._started = now - elapsed
        self._next_step = now + self.rules.period
        self._emit(Restarted(elapsed))
        present = [seat for seat in self.seats.values() if seat.present]
        for seat in self.seats.values():
            seat.present = False
            seat.away = now
        for seat in present:
            self._roster(seat, now)
        self.holds.until.clear()
        if begun:
            waited = {seat.player for seat in present} | set(expected)
            self._presence.expect(waited, now + patience)
        if held:
            self.holds.until[PauseReason.OPERATOR] = None
        self._presence.watch(now, running=begun)
        if begun and self._finished(now):
            return
        self._reckon(now)

    def await_anew(self, now: float, patience: float) -> None:
        """Whoever is waited for after a restart has its whole time from now on."""
        if PauseReason.RESTART in self.holds:
            self.holds.until[PauseReason.RESTART] = now + patience
        if not self.holds.outer:
            self._presence.grant_grace(now, running=self._running)

    def conclude(self, outcome: Outcome) -> None:
        """It was over before the process stopped; nothing is reported."""
        self._to(Phase.OVER)
        self.outcome = outcome
        self.holds.until.clear()

    def _finished(self, now: float) -> bool:
        """Whether the process stopped between the last step and the end."""
        if self.state.goal_reached:
            self._end(Reason.GOAL, now)
        elif self.step >= self.rules.max_steps:
            self._end(Reason.STEP_LIMIT, now)
        return self.phase is Phase.OVER
