"""An episode: seats, a clock and a world, without I/O.

Messages and the time go in, events come out. Nothing here reads a clock, so an episode takes the
same course alone or beside a hundred others, in real or in simulated time.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from math import ceil

from robotouille.episode.events import (
    Ended,
    Event,
    Move,
    Outcome,
    Reason,
    Rejected,
    RosterChanged,
    Said,
    SeatTally,
    Started,
    Stepped,
)
from robotouille.episode.rules import Clock, Rules
from robotouille.errors import ProtocolError
from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["Answer", "Episode", "Phase", "Seat"]

MAX_CATCH_UP = 10
MAX_STEPS_AT_ONCE = 50
"""Steps taken for one message; what is left is taken when time is told next."""
LOBBY_SECONDS = 600.0
"""For how long an episode that has not begun waits for somebody to come."""


class Phase(Enum):
    """The life of an episode."""

    WAITING = "waiting"
    RUNNING = "running"
    OVER = "over"


TRANSITIONS = {
    Phase.WAITING: {Phase.RUNNING, Phase.OVER},
    Phase.RUNNING: {Phase.OVER},
    Phase.OVER: set[Phase](),
}


@dataclass(slots=True)
class Pending:
    """An action that waits for its step; None is the decision to do nothing."""

    action: GroundAction | None
    seq: int
    latency: float
    order: int
    due_step: int
    reasoning: str = ""


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a seat's action: taken in `step`, or rejected for some reasons."""

    seq: int
    step: int
    reasons: tuple[str, ...] = ()


@dataclass(slots=True)
class Seat:
    """A player of the world and who plays it. `asked` is when it was last asked to move, `answer`
    what became of the last of its actions that was decided."""

    player: str
    name: str = ""
    kind: str = ""
    taken: bool = False
    present: bool = False
    seq: int = 0
    asked: float = 0.0
    pending: Pending | None = None
    answer: Answer = field(default_factory=lambda: Answer(0, 0))
    tally: SeatTally = field(default_factory=lambda: SeatTally(""))


class Episode:
    """One game of a task under some rules."""

    def __init__(self, world: World, rules: Rules, now: float = 0.0) -> None:
        self.world = world
        self.rules = rules
        self.state: State = world.initial
        self.step = 0
        self.phase = Phase.WAITING
        self.outcome: Outcome | None = None
        self.seats = {p: Seat(p, tally=SeatTally(p)) for p in world.players}
        self._turn = 0
        self._arrivals = 0
        self._started = 0.0
        self._deadline: float | None = None
        self._deserted: float | None = now
        self._next_step = 0.0
        self._backlog: float | None = None
        self._events: list[Event] = []

    # Who plays

    def join(self, player: str | None, name: str, kind: str, now: float) -> str:
        """Take a seat (any free one if `player` is None); starts the game when all are taken."""
        if self.phase is Phase.OVER:
            raise ProtocolError("episode/over", "the episode is over", "episode")
        seat = self._free_seat() if player is None else self.seat(player)
        if seat.taken:
            raise ProtocolError("seat/taken", f"{seat.player} is played by {seat.name}", "seat")
        seat.name, seat.kind, seat.taken, seat.present = name, kind, True, True
        seat.asked = now
        seat.seq, seat.pending, seat.answer = 0, None, Answer(0, 0)
        self._roster(seat, now)
        self._continue_without(now)
        if self.phase is Phase.WAITING and all(s.taken for s in self.seats.values()):
            self._start(now)
        return seat.player

    def seat(self, player: str) -> Seat:
        """The seat of a player; ProtocolError `seat/unknown` if there is none."""
        if player not in self.seats:
            listed = ", ".join(self.seats)
            raise ProtocolError("seat/unknown", f"no seat {player!r}; there are {listed}", "seat")
        return self.seats[player]

    def leave(self, player: str, now: float) -> None:
        """Give a seat up; it does nothing until somebody else takes it."""
        seat = self.seat(player)
        if seat.taken:
            seat.present = False
            self._roster(seat, now)
            seat.taken, seat.name, seat.kind, seat.pending = False, "", "", None
            self._continue_without(now)

    def set_present(self, player: str, present: bool, now: float) -> None:
        """A seat's connection was lost or is back; an absent seat does nothing."""
        seat = self.seat(player)
        if seat.taken and seat.present != present:
            seat.present = present
            seat.asked = now
            self._roster(seat, now)
            self._continue_without(now)

    def _free_seat(self) -> Seat:
        for seat in self.seats.values():
            if not seat.taken:
                return seat
        raise ProtocolError("episode/full", f"all {len(self.seats)} seats are taken", "episode")

    def _roster(self, seat: Seat, now: float) -> None:
        time = self._elapsed(now)
        self._emit(RosterChanged(seat.player, seat.name, seat.kind, seat.present, time))

    def _continue_without(self, now: float) -> None:
        """Note when nobody is left, and do not wait for those who went."""
        if any(seat.present for seat in self.seats.values()):
            if self._deserted is not None:
                self._resume(now)
        elif self._deserted is None:
            self._deserted = now
        self._advance(now)

    def _resume(self, now: float) -> None:
        """Somebody is back: the time nobody was there does not count."""
        if self.phase is Phase.RUNNING:
            self._next_step = max(self._next_step, now + self.rules.period)
            self._ask(now)
        self._deserted = None

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
        same `seq` again acts no second time; a lower one is stale.
        """
        seat = self.seat(player)
        self._check_running()
        if seq < seat.seq:
            message = f"action {seq} is older than {seat.seq}; ask for a snapshot"
            raise ProtocolError("action/stale", message, "seq")
        if seq == seat.seq and seq > 0:
            if seat.answer.seq == seq and seat.answer.reasons:
                self._refuse_again(seat, action, now)
            return
        seat.seq = seq
        reasons = self._refusals(seat, action)
        if reasons:
            self._reject(seat, Pending(action, seq, 0.0, 0, 0, reasoning), reasons, now)
            return
        if seat.pending is not None:
            self._reject(seat, seat.pending, (f"superseded by action {seq}",), now)
        self._arrivals += 1
        latency = max(0.0, now - seat.asked)
        due = self.step + self._thinking_steps(think_ms)
        seat.pending = Pending(action, seq, latency, self._arrivals, due, reasoning)
        self._advance(now)

    def say(self, name: str, player: str, text: str, now: float) -> None:
        """A chat message to everybody in the episode; it is recorded."""
        if self.phase is Phase.OVER:
            raise ProtocolError("episode/over", "the episode is over", "episode")
        if player:
            seat = self.seat(player)
            seat.tally.said += 1
        self._emit(Said(name, player, text, self._elapsed(now)))

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
        seat.answer = Answer(seq, self.step, reasons)
        seat.tally.rejected += 1
        time = self._elapsed(now)
        self._emit(Rejected(seat.player, seq, sentence, reasons, time, refused.reasoning))

    def _refuse_again(self, seat: Seat, action: GroundAction | None, now: float) -> None:
        sentence = action.sentence if action is not None else "nothing"
        seq, reasons = seat.answer.seq, seat.answer.reasons
        self._emit(Rejected(seat.player, seq, sentence, reasons, self._elapsed(now)))

    def _thinking_steps(self, think_ms: int) -> int:
        if self.rules.clock is Clock.REALTIME and self.rules.thinking == "declared":
            return ceil(think_ms / 1000 * self.rules.step_rate)
        return 0

    # Time

    @property
    def on_turn(self) -> str | None:
        """Whose turn it is, with the turn clock."""
        if self.rules.clock is not Clock.TURN or self.phase is not Phase.RUNNING:
            return None
        return self.world.players[self._turn]

    def due(self) -> float | None:
        """When `tick` has something to do; None while only messages can move the episode."""
        if self.phase is Phase.OVER:
            return None
        if self._deserted is not None:
            return self._deserted + self._patience
        if self._backlog is not None:
            return self._backlog
        if self.phase is Phase.RUNNING:
            return self._next_step if self.rules.scheduled else self._deadline
        return None

    @property
    def _patience(self) -> float:
        waiting = self.phase is Phase.WAITING
        return max(self.rules.grace, LOBBY_SECONDS) if waiting else self.rules.grace

    def tick(self, now: float) -> None:
        """Let time pass: take the steps that are due, give up an episode that all have left."""
        if self.phase is Phase.OVER:
            return
        if self._deserted is not None:
            if now >= self._deserted + self._patience:
                self._end(Reason.ABANDONED, now, "everybody left")
            return
        if self.phase is not Phase.RUNNING:
            return
        if self.rules.scheduled:
            self._take_scheduled(now)
        elif self._backlog is not None:
            self._advance(now)
        elif self._deadline is not None and now >= self._deadline:
            self._take_step(now)
            self._advance(now)

    def abort(self, now: float, detail: str) -> None:
        """End the episode from outside, e.g. because the server shuts down."""
        if self.phase is not Phase.OVER:
            self._end(Reason.ABORTED, now, detail)

    def events(self) -> list[Event]:
        """What has happened since this was last asked, in order."""
        events, self._events = self._events, []
        return events

    def _start(self, now: float) -> None:
        self._to(Phase.RUNNING)
        self._started = now
        self._next_step = now + self.rules.period
        self._emit(Started(0.0))
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
        if self.rules.scheduled:
            return
        for _ in range(MAX_STEPS_AT_ONCE):
            if self.phase is not Phase.RUNNING or self._deserted is not None:
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
        return (
            seat.pending is not None or not seat.present or self.state.busy_steps(seat.player) > 0
        )

    def _ask(self, now: float) -> None:
        """Everybody who has to decide has its budget from now on."""
        for seat in self.seats.values():
            seat.asked = now
        budget = self.rules.move_budget if self.rules.clock is not Clock.REALTIME else None
        self._deadline = now + budget if budget is not None else None

    def _take_step(self, now: float) -> None:
        moves = self._moves()
        before = self.state
        result = before.step([move.action for move in moves])
        self.step += 1
        self.state = result.state
        for move, attempt in zip(moves, result.attempts, strict=True):
            if not attempt.applied:
                self.seats[move.player].answer = Answer(move.seq, self.step, attempt.unmet)
        self._count(moves, [attempt.applied for attempt in result.attempts])
        time = self._elapsed(now)
        self._turn = (self._turn + 1) % len(self.world.players)
        turn = self.on_turn
        self._emit(Stepped(self.step, time, moves, result.attempts, before, self.state, turn))
        if result.goal_reached:
            self._end(Reason.GOAL, now)
        elif self.step >= self.rules.max_steps:
            self._end(Reason.STEP_LIMIT, now)
        else:
            self._ask(now)

    def _moves(self) -> tuple[Move, ...]:
        """The joint action: in order of arrival where the wall clock rules, else in seat order."""
        ready = []
        for seat in self.seats.values():
            pending = seat.pending
            if pending is not None and pending.due_step <= self.step:
                seat.pending = None
                seat.answer = Answer(pending.seq, self.step + 1)
                if pending.action is not None:
                    move = Move(
                        seat.player,
                        pending.action,
                        pending.seq,
                        pending.latency,
                        pending.reasoning,
                    )
                    ready.append((pending.order, move))
        if self.rules.scheduled:
            ready.sort(key=lambda pair: pair[0])
        return tuple(move for _, move in ready)

    def _count(self, moves: tuple[Move, ...], applied: list[bool]) -> None:
        acted = {move.player: ok for move, ok in zip(moves, applied, strict=True)}
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
