"""An episode: seats, a clock and a world, without I/O.

Messages and the time go in, events come out. Nothing here reads a clock, so an episode takes the
same course alone or beside a hundred others, in real or in simulated time.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial

from robotouille.episode.episode_state import EpisodeState, Undone, nothing_undone
from robotouille.episode.events import (
    ACTION_INVALID,
    ACTION_UNKNOWN,
    CountdownChanged,
    Departure,
    Paused,
    QuotaReached,
    ReadinessChanged,
    Reason,
    Rejected,
    Resumed,
    Started,
)
from robotouille.episode.lifecycle import Controller, Phase, PhaseEvent
from robotouille.episode.pauses import PauseReason
from robotouille.episode.presence import Presence
from robotouille.episode.quota import size_of_rejection
from robotouille.episode.rules import Absence, Rules, SeatTreatment
from robotouille.episode.seats import (
    ActionAnswer,
    ActionRequest,
    HeldActions,
    PendingAction,
    Seat,
    by_holder,
    joint_action,
    who_waits,
)
from robotouille.errors import ProtocolError, UnknownNameError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, UnmetKind, only_words, texts_of
from robotouille.world.world import World

__all__ = ["Episode"]

DEPARTURES = {
    Departure.LEFT: "left",
    Departure.LOST: "did not come back",
    Departure.REMOVED: "was removed by the operator",
}


UNASKED = ActionRequest(seq=0)
"""Of what a stand-in does: its seat has not asked for it."""


class Episode(EpisodeState):
    """One game of a task under some rules: who may do what, and when.

    `pauses` are the reasons for which time stands still at present; `step_began` is when the
    present step began, and with it everybody's move budget.

    Args:
        now: Seconds, here and in all methods, on one clock that the caller reads.
        undone: What chance takes back after each step.
        treatments: What a study does to seats, by player.
    """

    __slots__ = ("_arrivals", "_held", "_presence", "_reported", "pauses", "step_began")

    def __init__(
        self,
        world: World,
        rules: Rules,
        now: float = 0.0,
        *,
        undone: Undone = nothing_undone,
        treatments: Mapping[str, SeatTreatment] | None = None,
    ) -> None:
        super().__init__(world, rules, undone, treatments or {})
        self.step_began = now
        self._held = HeldActions()
        self._presence = Presence(self.seats, rules, opened=now)
        self.pauses = self._presence.pauses
        self._reported: tuple[PauseReason, ...] = ()
        self._arrivals = 0
        self._presence.watch(now, begun=False)

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
        ready: bool = True,
    ) -> str:
        """Take a seat (any free one if `player` is None); the game begins when all are there and
        ready.

        Args:
            name: What others see.
            kind: The value of a `Controller`: `human`, `bot` or `model`.
            session: Who holds the seat, by a pseudonym.
            participant: The pseudonym that stays the same in later sessions.
            ready: Whether the game may begin; if not, `set_ready` says when.

        Returns:
            The player whose seat it is.

        Raises:
            ProtocolError: `episode/over`, `episode/full`, `seat/unknown` or `seat/taken`.
        """
        players = (player,) if player is not None else self.free_seats()[:1]
        (taken,) = self.join_several(
            players, name, kind, now, session=session, participant=participant, ready=ready
        )
        return taken

    def join_several(
        self,
        players: Collection[str],
        name: str,
        kind: str,
        now: float,
        *,
        session: str = "",
        participant: str = "",
        ready: bool = True,
    ) -> tuple[str, ...]:
        """One participant takes several seats: all of them, or none. Arguments are those of `join`.

        Returns:
            The players, in seat order.

        Raises:
            ProtocolError: `episode/over`, `seat/unknown` or `seat/taken`.
        """
        seats = self.check_free(players)
        for seat in seats:
            seat.take(name, kind, session, participant, self._ran(now))
        self.used = self._presence.used = True
        for seat in seats:
            self._emit_roster(seat, now)
        self._set_ready(seats, ready)
        self._update_presence(now)
        return tuple(seat.player for seat in seats)

    def set_ready(self, players: str | Collection[str], ready: bool, now: float) -> None:
        """A participant is ready for the beginning, or is not any more, which stops the countdown.

        Once the game has begun this means nothing.

        Raises:
            ProtocolError: `seat/unknown`.
        """
        seats = [seat for seat in self.seats_of(players) if seat.taken]
        if self._set_ready(seats, ready):
            self._start_when_complete(now)

    def _set_ready(self, seats: Iterable[Seat], ready: bool) -> bool:
        """Whether that was news of any of the seats."""
        if self.phase is not Phase.WAITING:
            return False
        changed = [seat for seat in seats if seat.ready != ready]
        for seat in changed:
            seat.ready = ready
            self._emit(ReadinessChanged(seat.player, ready))
        return bool(changed)

    def leave(
        self, players: str | Collection[str], now: float, why: Departure = Departure.LEFT
    ) -> None:
        """A participant gives its seats up for good; the absence policy says what becomes of the
        game.

        Nothing happens where the seats are free or the episode is over.

        Raises:
            ProtocolError: `seat/unknown`.
        """
        seats = [seat for seat in self.seats_of(players) if seat.taken]
        if not seats or self.ended:
            return
        name = seats[0].name
        for seat in seats:
            seat.vacate(self._ran(now))
            self._held.drop(seat.player)
            seat.away = now
        for seat in seats:
            self._emit_roster(seat, now, why)
        if self.in_progress and self.rules.absence is Absence.END:
            self._end(Reason.ABANDONED, now, f"{name} {DEPARTURES[why]}")
        else:
            self._update_presence(now)

    def set_present(
        self,
        players: str | Collection[str],
        present: bool,
        now: float,
        *,
        generation: int | None = None,
    ) -> None:
        """The connection to a participant's seats was lost or is back (with a resume token of this
        generation).

        Raises:
            ProtocolError: `seat/unknown`.
        """
        seats = [
            seat
            for seat in self.seats_of(players)
            if seat.taken and (seat.present != present or generation not in (None, seat.generation))
        ]
        if not seats or self.ended:
            return
        for seat in seats:
            seat.set_present(present, now, self._ran(now))
            if generation is not None:
                seat.generation = generation
        for seat in seats:
            self._emit_roster(seat, now)
        self._update_presence(now)

    # The beginning and the end

    def _start_when_complete(self, now: float) -> None:
        """Begin as soon as all seats' participants are there and ready, with or without counting
        down."""
        if self.phase is not Phase.WAITING:
            return
        if not (self._presence.complete and all(seat.ready for seat in self.seats.values())):
            if self.starts_at is not None:
                self.starts_at = None
                self._emit(CountdownChanged(None))
            return
        people = any(seat.kind == Controller.HUMAN for seat in self.seats.values())
        if not (self.rules.countdown and self.scheduled and people):
            self._start(now)
        elif self.starts_at is None:
            self.starts_at = now + self.rules.countdown
            self._emit(CountdownChanged(self.rules.countdown))

    def _start(self, now: float) -> None:
        self.starts_at = None
        self._enter_phase(PhaseEvent.START)
        self._started = now
        self._clock.start(now)
        self._emit(Started(0.0))
        for seat in self.seats.values():
            seat.refused = False
        self._update_presence(now)
        if self.state.goal_reached:
            self._end(Reason.GOAL, now)
            return
        self._start_move_timer(now)
        self._take_decided_steps(now)

    def abort(self, now: float, detail: str) -> None:
        """End the episode from outside, e.g. because the server shuts down."""
        if not self.ended:
            self._end(Reason.ABORTED, now, detail)

    def _end(self, reason: Reason, now: float, detail: str = "") -> None:
        super()._end(reason, now, detail)
        self.starts_at = None
        self._held.clear()
        self.pauses.until.clear()

    # Pauses

    def pause(self, why: PauseReason, now: float, until: float | None = None) -> None:
        """Let time stand still for a reason, until `resume` or the time `until`."""
        if not self.ended and why not in self.pauses:
            self.pauses.until[why] = until
            self._update_pauses(now)

    def resume(self, why: PauseReason, now: float) -> None:
        """Let time run again, as far as this reason goes."""
        if why in self.pauses:
            self._presence.lift(why, now, begun=self.in_progress)
            self._update_pauses(now)

    def renew_patience(self, now: float, patience: float) -> None:
        """Whoever is waited for after a restart has its whole time, in seconds, from now on."""
        if PauseReason.RESTART in self.pauses:
            self.pauses.until[PauseReason.RESTART] = now + patience
        if not self.pauses.outer:
            self._presence.grant_grace(now, begun=self.in_progress)

    def opened_at(self, opened: float, now: float) -> None:
        """It was opened at another time than it seems, in another process: how long it is open."""
        self._presence.opened = opened
        if not self.in_progress and not self.ended and not self.pauses.outer:
            self._presence.grant_grace(now, begun=False)

    def _update_presence(self, now: float) -> None:
        """Somebody came or went."""
        self._presence.watch(now, begun=self.in_progress)
        self._start_when_complete(now)
        self._update_pauses(now)

    def _update_pauses(self, now: float) -> None:
        """The reasons to stand still may have changed."""
        if not self.in_progress:
            return
        reasons = tuple(self.pauses.until)
        if reasons != self._reported:
            self._reported = reasons
            if reasons:
                self._enter_phase(PhaseEvent.PAUSE)
                self._stopwatch.stop(self._elapsed(now))
                self._emit(Paused(reasons, self._elapsed(now)))
            else:
                self._enter_phase(PhaseEvent.RESUME)
                self._stopwatch.go_on(self._elapsed(now))
                self._clock.resume(now)
                self._start_move_timer(now)
                self._emit(Resumed(self._elapsed(now)))
        self._take_decided_steps(now)

    # What they do

    def submit(
        self,
        player: str,
        seq: int,
        action: GroundAction | str | None,
        now: float,
        *,
        think_ms: int = 0,
        basis: int | None = None,
        reasoning: str = "",
        anticipates: bool = False,
        waits: bool = False,
    ) -> None:
        """A seat's action for the next step; None decides to do nothing.

        An action whose preconditions do not hold is rejected at once and may be replaced, and so
        is a text that says no action. While time stands still an action waits. Where the seat's
        actions are held back, all of this is when it counts.

        Args:
            action: An action, or the text that says one, as `World.parse` reads it.
            seq: The seat's number of this action. The same again acts no second time
                (`Seat.answer` tells its fate); a lower one is stale.
            think_ms: Milliseconds of thought, which count where thinking is declared.
            basis: The step on which the choice was made, for the recording; one that is still to
                come says nothing.
            reasoning: Is recorded, and shown to nobody.
            anticipates: Another's action in the same step is to make this one possible: its
                preconditions are not looked at before its turn in the step, which is after that.
            waits: With no action: it waits for a place or for somebody, and does not idle.

        Raises:
            ProtocolError: `seat/unknown`, `episode/waiting`, `episode/over` or `action/stale`; or
                `rate/words`, where no more reasoning is recorded of the seat: it may act without.
        """
        seat = self.seat(player)
        if self._hears(seat, seq, reasoning, now):
            request = ActionRequest(
                seq, self._known(basis), reasoning, think_ms, anticipates, waits
            )
            self._when_it_counts(seat, partial(self._take_action, seat, action, request), now)

    def _when_it_counts(self, seat: Seat, take: Callable[[float], None], now: float) -> None:
        """Take what a seat has asked for now, or later where its actions are held back."""
        if not seat.treatment.delay_ms:
            take(now)
            return
        self._held.hold(seat.player, now + seat.treatment.delay_ms / 1000, take)

    def _take_action(
        self, seat: Seat, action: GroundAction | str | None, request: ActionRequest, now: float
    ) -> None:
        text = ""
        if isinstance(action, str):
            text = action
            try:
                action = self.world.parse(self.state, seat.player, text, valid=False)
            except UnknownNameError as error:
                self._reject(seat, request, text, only_words(str(error)), now, ACTION_UNKNOWN)
                return
        if unmet := self._faults(seat, action, anticipates=request.anticipates):
            self._reject(seat, request, _sentence(action), unmet, now, text=text)
            return
        self._supersede(seat, request.seq, now)
        self._decide(seat, action, request, now)

    def _supersede(self, seat: Seat, seq: int, now: float) -> None:
        """The action that a seat has asked for before, if it waits still, is not to be done."""
        pending = seat.pending
        if pending is not None and pending.seq > 0:
            superseded = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {seq}")
            before = ActionRequest(pending.seq, pending.basis, pending.reasoning)
            self._reject(seat, before, _sentence(pending.action), (superseded,), now)

    def reject(
        self,
        player: str,
        seq: int,
        request: str,
        why: ProtocolError,
        now: float,
        *,
        basis: int | None = None,
        reasoning: str = "",
    ) -> None:
        """A seat has asked for an action in another form than `submit` takes, and it is none, or
        not any more: it is rejected like those.

        Args:
            request: What was asked for, in words.
            why: With the code `action/unknown` it is no action, else one that is not valid now.
            basis: As for `submit`.

        Raises:
            ProtocolError: As `submit` does.
        """
        seat = self.seat(player)
        if self._hears(seat, seq, reasoning, now):
            asked = ActionRequest(seq, self._known(basis), reasoning)
            unmet, code = only_words(why.message), why.code
            self._when_it_counts(
                seat, lambda at: self._reject(seat, asked, request, unmet, at, code), now
            )

    def refuse(
        self,
        player: str,
        seq: int,
        request: str,
        why: ProtocolError,
        now: float,
        *,
        basis: int | None = None,
        reasoning: str = "",
    ) -> None:
        """A seat has asked for something that is not looked at: it is recorded as rejected, and
        the seat's last action is another.

        Args:
            request: What was asked for, in words.
            seq: 0 if it had none.
            why: With the code `action/stale`, `episode/waiting`, `rate/limited`, or `message/…` for
                what cannot be read.
            basis: As for `submit`.

        Raises:
            ProtocolError: `seat/unknown` or `episode/over`.
        """
        self._check_open()
        seat, unmet = self.seat(player), only_words(why.message)
        event = Rejected(
            player,
            seq,
            request,
            unmet,
            self._elapsed(now),
            reasoning,
            code=why.code,
            basis=self._known(basis),
            heard=False,
        )
        size = size_of_rejection((request, *texts_of(unmet))) + len(reasoning.encode())
        self._record_rejection(seat, event, size)

    def _known(self, basis: int | None) -> int | None:
        """The step that a choice was made on; None if there was no such step yet."""
        return basis if basis is not None and 0 <= basis <= self.step else None

    def _hears(self, seat: Seat, seq: int, reasoning: str, now: float) -> bool:
        """Whether a request is a new one of a seat; then it is the seat's last."""
        self._check_begun()
        if seq < seat.seq:
            message = f"action {seq} is older than {seat.seq}; ask for a snapshot"
            raise ProtocolError("action/stale", message, "seq")
        if seq == seat.seq and seq > 0:
            return False
        if reasoning:
            self._take_quota(seat.quota, len(reasoning.encode()), seat.player, now, "act without")
        seat.seq = seq
        return True

    def substitute(self, player: str, action: GroundAction | None, now: float) -> None:
        """A stand-in's action for the next step; nothing happens if it is not in control (any
        more), and one whose preconditions do not hold is taken for nothing.

        Raises:
            ProtocolError: `seat/unknown`.
        """
        seat = self.seat(player)
        if self.in_progress and seat.controller is Controller.STAND_IN:
            self._decide(seat, None if self._faults(seat, action) else action, UNASKED, now)

    def _decide(
        self, seat: Seat, action: GroundAction | None, request: ActionRequest, now: float
    ) -> None:
        self._arrivals += 1
        latency = seat.thought(self._ran(now))
        due = self.step + self._clock.delay(request.think_ms)
        seat.pending = PendingAction(
            action,
            request.seq,
            latency,
            self._arrivals,
            due,
            request.reasoning,
            request.anticipates,
            request.basis,
            request.waits and action is None,
        )
        self._take_decided_steps(now)

    def _reject(
        self,
        seat: Seat,
        request: ActionRequest,
        sentence: str,
        unmet: tuple[Unmet, ...],
        now: float,
        code: str = ACTION_INVALID,
        text: str = "",
    ) -> None:
        text = "" if text == sentence else text
        seq, basis, reasoning = request.seq, request.basis, request.reasoning
        time = self._elapsed(now)
        event = Rejected(
            seat.player, seq, sentence, unmet, time, reasoning, True, code, text, basis
        )
        seat.answer = ActionAnswer(seq, self.step, event.reasons, code)
        self._record_rejection(seat, event, size_of_rejection((sentence, text, *texts_of(unmet))))

    def _record_rejection(self, seat: Seat, event: Rejected, size: int) -> None:
        """Count and report it; it is recorded if the seat's quota of text has room."""
        reached = seat.quota.reached
        recorded = seat.quota.take(size)
        seat.count_rejection(event.kind, recorded=recorded)
        if seat.quota.reached and not reached:
            self._emit(QuotaReached(seat.player, event.time))
        self._emit(event if recorded else replace(event, recorded=False))

    # Time

    @property
    def waits_for(self) -> tuple[str, ...]:
        """The players whose decision the present step waits for; none where the clock rules."""
        if not self.running:
            return ()
        awaited = self._clock.awaited(self.step)
        return tuple(p for p in awaited if not self.seats[p].decided(self.state))

    def all_decided(self, players: Iterable[str]) -> bool:
        """Whether nothing more is to be waited for from these."""
        return all(self.seats[player].decided(self.state) for player in players)

    def due(self) -> float | None:
        """When `tick` has something to do; None while only messages can move the episode."""
        if self.phase is Phase.ENDED:
            return None
        clock = self._clock.due() if self.phase is Phase.RUNNING else self.starts_at
        held = self._held.due()
        if held is None and self._presence.complete and not self.pauses.until:
            return clock
        absence = self._presence.due(begun=self.in_progress)
        return min((time for time in (clock, held, absence) if time is not None), default=None)

    def tick(self, now: float) -> None:
        """Let time pass: take the steps that are due, give up what has been waited for enough."""
        if self.pauses.until or not self._presence.complete:
            self._tick_absence(now)
        if self.starts_at is not None and now >= self.starts_at:
            self._start(now)
        if not self.scheduled:
            self._held.release(now)
        if self.phase is Phase.RUNNING:
            for at in self._clock.on_tick(now, self):
                self._held.release(at)
                self._take_step(at)
        self._held.release(now)

    def _tick_absence(self, now: float) -> None:
        """Give up what has been waited for long enough."""
        for why in self.pauses.expired(now):
            if why in (PauseReason.DESERTED, PauseReason.ABSENCE):
                self._end(Reason.ABANDONED, now, self._presence.missing())
                return
            self.resume(why, now)
        overdue = self._presence.overdue(now, begun=self.in_progress)
        for players in by_holder(overdue):
            self.leave(players, now, Departure.LOST)

    def _start_move_timer(self, now: float) -> None:
        """Everybody who has to decide has its budget from now on."""
        self.step_began = now
        self._clock.start_move(now)

    def _take_decided_steps(self, now: float) -> None:
        """Take steps for as long as nobody needs to be waited for."""
        for at in self._clock.on_decision(now, self):
            self._take_step(at)

    def _take_step(self, now: float) -> None:
        waits = who_waits(self.seats.values(), self.step)
        moves, idle = joint_action(
            self.seats.values(), self.state, self.step, by_arrival=self.scheduled
        )
        goal = self._transition(moves, idle, waits, self._elapsed(now))
        if not self._end_if_finished(now, goal=goal):
            self._start_move_timer(now)

    def _end_if_finished(self, now: float, *, goal: bool) -> bool:
        """Whether the last step was the last one."""
        if goal:
            self._end(Reason.GOAL, now)
        elif self.step >= self.rules.max_steps:
            self._end(Reason.STEP_LIMIT, now)
        return self.ended


def _sentence(action: GroundAction | None) -> str:
    return action.sentence if action is not None else "nothing"
