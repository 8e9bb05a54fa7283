"""Episodes without I/O: requests and the time go in, events come out.

An episode reads no clock. The same calls produce the same events in real and in simulated time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from robotouille.episode.events import (
    AnnouncementMade,
    CountdownChanged,
    Departure,
    Event,
    Moderated,
    Moderation,
    Outcome,
    Paused,
    ReadinessChanged,
    Reason,
    Restarted,
    Resumed,
    RoundTripMeasured,
    Started,
)
from robotouille.episode.lifecycle import Absence, Controller, PauseReason, Phase, PhaseEvent
from robotouille.episode.presence import Presence
from robotouille.episode.record import EpisodeRecord, RandomReversal, no_reversal
from robotouille.episode.rules import Rules, SeatTreatment
from robotouille.episode.seats import ActionRequest, Seat, by_holder
from robotouille.episode.speech import Speech
from robotouille.episode.submissions import Submissions, joint_action
from robotouille.errors import ProtocolError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.presentation.signals import Signal
from robotouille.world.world import State, World

DEPARTURES = {
    Departure.LEFT: "left",
    Departure.LOST: "did not come back",
    Departure.REMOVED: "was removed by the operator",
}


class Episode:
    """One play of a task under given rules.

    All methods take `now`: seconds on a clock that the caller reads. The clock never goes back,
    except by the moment by which a tick may come early.

    Methods that name a player raise ProtocolError `seat/unknown` if there is no such seat.

    Args:
        random_reversal: Chooses the facts that become false by chance after each step.
        treatments: A study's treatment of seats, by player.

    Attributes:
        record: The episode's data.
        pauses: The reasons for which the game is paused now.
        step_began: Time at which the move budget of the current step started.
    """

    # A server has one episode for each room. Slots helped to reduce the memory for a room from 137
    # to 52 KiB (docs/decisions/0019).
    __slots__ = (
        "_presence", "_reported", "_speech", "_submissions", "pauses", "record", "step_began",
    )  # fmt: skip

    def __init__(
        self,
        world: World,
        rules: Rules,
        now: float = 0.0,
        *,
        random_reversal: RandomReversal = no_reversal,
        treatments: Mapping[str, SeatTreatment] | None = None,
    ) -> None:
        self.record = EpisodeRecord(world, rules, random_reversal, treatments or {})
        self.step_began = now
        self._submissions = Submissions(self.record)
        self._speech = Speech(self.record)
        self._presence = Presence(self.record, opened=now)
        self.pauses = self._presence.pauses
        # The reasons in the last `Paused` event. Comparing with them avoids an event, and a note in
        # the recording, for each call that changes nothing.
        self._reported: tuple[PauseReason, ...] = ()
        self._presence.update(now)

    # Reading

    @property
    def world(self) -> World:
        """The world of the task."""
        return self.record.world

    @property
    def rules(self) -> Rules:
        """The rules of play."""
        return self.record.rules

    @property
    def state(self) -> State:
        """The state after the last step."""
        return self.record.state

    @property
    def step(self) -> int:
        """Number of steps taken."""
        return self.record.step

    @property
    def phase(self) -> Phase:
        """The phase: waiting, running, paused or ended."""
        return self.record.phase

    @property
    def in_progress(self) -> bool:
        """True from the start to the end, pauses included."""
        return self.record.in_progress

    @property
    def running(self) -> bool:
        """True from the start to the end, except during pauses."""
        return self.record.phase is Phase.RUNNING

    @property
    def paused(self) -> bool:
        """True while the game is paused."""
        return self.record.phase is Phase.PAUSED

    @property
    def ended(self) -> bool:
        """True once the episode has an outcome."""
        return self.record.phase is Phase.ENDED

    @property
    def starts_at(self) -> float | None:
        """Time at which a running countdown ends."""
        return self.record.starts_at

    @property
    def outcome(self) -> Outcome | None:
        """The outcome; None before the end."""
        return self.record.outcome

    @property
    def seats(self) -> Mapping[str, Seat]:
        """The seats by player."""
        return self.record.seats

    def seat(self, player: str) -> Seat:
        """Return the seat of a player."""
        return self.record.seat(player)

    def offered_actions(self, player: str) -> tuple[GroundAction, ...]:
        """Return the actions that are valid for all that a player sees."""
        return self.record.offered_actions(player)

    @property
    def on_turn(self) -> str | None:
        """The only player who may act now; None without turns, or if no game is in progress."""
        return self.record.on_turn

    @property
    def waits_for(self) -> tuple[str, ...]:
        """The players whose decisions the current step awaits; none with the wall clock."""
        record = self.record
        if not record.running:
            return ()
        # A missing decision alone does not delay the step: nobody waits for a seat that is busy, or
        # that has neither a participant nor a substitute.
        awaited = record.clock.awaited(record.step)
        return tuple(p for p in awaited if not record.seats[p].decided(record.state))

    def events(self) -> list[Event]:
        """Return the events since the last call, in order."""
        record = self.record
        if not record.events:
            return []
        # Replace the list instead of clearing it: the caller keeps the old one while it writes and
        # publishes, which may cause further events.
        events, record.events = record.events, []
        return events

    # Participants

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
        agent: str = "",
    ) -> str:
        """Give a seat to a participant. The game starts when all seats are taken and ready.

        Args:
            player: The seat's player; None for the first free seat.
            name: The participant's name, as others see it.
            kind: `human`, `bot` or `model`.
            session: Pseudonym of the session that holds the seat.
            participant: Pseudonym that stays the same in later sessions.
            ready: False if the start must wait for `set_ready`.
            agent: The program that plays, in its own words.

        Returns:
            The player whose seat it is.

        Raises:
            ProtocolError: `episode/ended`, `episode/full`, `seat/unknown` or `seat/taken`.
        """
        # Choose the first free seat, so that the same joins always fill the same seats.
        players = (player,) if player is not None else self.record.free_seats()[:1]
        (taken,) = self.join_several(
            players,
            name,
            kind,
            now,
            session=session,
            participant=participant,
            ready=ready,
            agent=agent,
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
        generation: int = 0,
        ready: bool = True,
        agent: str = "",
    ) -> tuple[str, ...]:
        """Give several seats to one participant: all of them, or none. See `join`.

        Args:
            generation: Generation of the last resume token that the session has used.

        Returns:
            The players, in seat order.

        Raises:
            ProtocolError: `episode/ended`, `seat/unknown` or `seat/taken`.
        """
        record = self.record
        # All checks come before the first change, so a participant gets all seats or none
        # (docs/decisions/0031).
        seats = record.check_free(players)
        for seat in seats:
            seat.take(name, kind, session, participant, record.ran(now))
            seat.generation, seat.agent = generation, agent
        # `used` separates the outcomes `everybody left` and `nobody came`, and lets a participant
        # return after `open_for` has passed.
        record.used = True
        # Report after all seats are taken: no event may show a participant with some of them.
        for seat in seats:
            record.emit_roster(seat, now)
        self._change_readiness(seats, ready)
        self._update_presence(now)
        return tuple(seat.player for seat in seats)

    def set_ready(self, players: str | Collection[str], ready: bool, now: float) -> None:
        """Set whether a participant is ready. A participant who is not ready stops the countdown.

        After the start this has no effect.
        """
        seats = [seat for seat in self.record.seats_of(players) if seat.taken]
        if self._change_readiness(seats, ready):
            self._start_when_complete(now)

    def _change_readiness(self, seats: Iterable[Seat], ready: bool) -> bool:
        """Return whether any seat changed."""
        if self.record.phase is not Phase.WAITING:
            return False
        changed = [seat for seat in seats if seat.ready != ready]
        for seat in changed:
            seat.ready = ready
            self.record.emit(ReadinessChanged(seat.player, ready))
        return bool(changed)

    def leave(
        self, players: str | Collection[str], now: float, why: Departure = Departure.LEFT
    ) -> None:
        """Free a participant's seats for good. The absence rule decides how the game continues.

        Has no effect on free seats or after the end.
        """
        record = self.record
        seats = [seat for seat in record.seats_of(players) if seat.taken]
        if not seats or record.ended:
            return
        name = seats[0].name
        for seat in seats:
            # There are two loops, here and in `set_present`: no step, pause or end may occur while
            # only some seats of a participant have changed (docs/decisions/0031).
            seat.vacate(record.ran(now))
            # Otherwise a delayed action would count for the seat's next participant.
            self._submissions.drop(seat.player)
            seat.away = now
        for seat in seats:
            record.emit_roster(seat, now, why)
        if record.in_progress and record.rules.absence is Absence.END:
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
        """Record that the connection to a participant was lost or is back.

        Args:
            generation: Generation of the resume token with which the participant came back.
        """
        record = self.record
        # A new generation is recorded even if nothing else changes: after a restart, the recording
        # has to know which resume token is the valid one.
        seats = [
            seat
            for seat in record.seats_of(players)
            if seat.taken and (seat.present != present or generation not in (None, seat.generation))
        ]
        if not seats or record.ended:
            return
        for seat in seats:
            seat.set_present(present, now, record.ran(now))
            if generation is not None:
                seat.generation = generation
        for seat in seats:
            record.emit_roster(seat, now)
        self._update_presence(now)

    def take_over(
        self,
        players: str | Collection[str],
        kind: str,
        now: float,
        *,
        session: str,
        generation: int = 0,
        agent: str = "",
    ) -> None:
        """Let the participant of some seats go on in a new session.

        The seats keep everything else, such as the name and the numbers of the requests.

        Args:
            generation: Generation of the last resume token that the new session has used.

        Raises:
            ProtocolError: `episode/ended`.
        """
        record = self.record
        record.check_open()
        seats = [seat for seat in record.seats_of(players) if seat.taken]
        for seat in seats:
            seat.set_present(True, now, record.ran(now))
            seat.change_session(session, kind)
            seat.generation, seat.agent = generation, agent
        for seat in seats:
            record.emit_roster(seat, now)
        self._update_presence(now)

    # Start and end

    def _start_when_complete(self, now: float) -> None:
        record = self.record
        if record.phase is not Phase.WAITING:
            return
        if not (self._presence.complete and all(seat.ready for seat in record.seats.values())):
            if record.starts_at is not None:
                record.starts_at = None
                record.emit(CountdownChanged(None))
            return
        # Only people in real time need a countdown: bots and models are ready at once, and other
        # clocks wait for the first decision. The shown kinds count, because a countdown that
        # depends on the real ones would reveal them.
        people = any(seat.shown_kind == Controller.HUMAN for seat in record.seats.values())
        if not (record.rules.countdown and record.rules.scheduled and people):
            self._start(now)
        elif record.starts_at is None:
            record.starts_at = now + record.rules.countdown
            record.emit(CountdownChanged(record.rules.countdown))

    def _start(self, now: float) -> None:
        record = self.record
        record.starts_at = None
        record.start()
        record.started = now
        record.clock.start(now)
        # The time is zero by definition: all times in events count from the start.
        record.emit(Started(0.0))
        self._update_presence(now)
        if record.state.goal_reached:  # A task may begin with its goal reached.
            self._end(Reason.GOAL, now)
            return
        self._start_move_timer(now)
        self._take_decided_steps(now)

    def abort(self, now: float, detail: str) -> None:
        """End the episode from outside, for example because the server shuts down."""
        if not self.record.ended:
            self._end(Reason.ABORTED, now, detail)

    def _end(self, reason: Reason, now: float, detail: str = "") -> None:
        self.record.end(reason, now, detail)
        self.record.starts_at = None
        # Requests that are still delayed get no answer: `ended` informs the client instead.
        self._submissions.clear()
        self.pauses.until.clear()

    def resume_after_restart(
        self,
        now: float,
        *,
        elapsed: float,
        patience: float,
        expected: Collection[str] = (),
        paused: bool = False,
    ) -> None:
        """Continue an episode whose record was restored from a recording.

        The game stays paused until the participants who were present are back.

        Args:
            elapsed: Seconds since the start of the game.
            patience: Seconds to wait for the participants.
            expected: Players to wait for in addition to those who were present.
            paused: True if an operator had paused the game. It stays paused.
        """
        record = self.record
        if record.in_progress:
            record.started = now - elapsed
        record.clock.start(now)
        # The recording needs this event: if the process stops again before anybody returns, the
        # next recovery must know for whom this one waited.
        record.emit(Restarted(elapsed))
        # Times of absence use the clock of the stopped process, which this process does not have.
        # Every grace period restarts, as after other pauses that participants did not cause
        # (docs/decisions/0015).
        present = [seat for seat in record.seats.values() if seat.present]
        for seat in record.seats.values():
            seat.away = now
        for seat in present:
            seat.lose_connection(record.ran(now))
        for seat in present:
            record.emit_roster(seat, now)
        self.pauses.until.clear()
        if record.in_progress:
            awaited = {seat.player for seat in present} | set(expected)
            self._presence.expect(awaited, now + patience)
        if paused:
            self.pauses.until[PauseReason.OPERATOR] = None
        self._presence.update(now)
        # The process may have stopped between recording the last step and recording the end.
        if record.in_progress and self._end_if_finished(now, goal=record.state.goal_reached):
            return
        self._update_pauses(now)

    def restore_ended(self, outcome: Outcome) -> None:
        """Set the outcome of an episode that had ended before the process stopped.

        Raises:
            IllegalEventError: The episode has already ended.
        """
        self.record.enter_phase(PhaseEvent.END)
        self.record.outcome = outcome
        self.pauses.until.clear()

    # Pauses

    def pause(self, why: PauseReason, now: float, until: float | None = None) -> None:
        """Pause the game for a reason until `resume`, or until the given time."""
        if not self.record.ended and why not in self.pauses:
            self.pauses.until[why] = until
            self._update_pauses(now)

    def resume(self, why: PauseReason, now: float) -> None:
        """Remove a reason for a pause. The game resumes if there is no other reason."""
        if why in self.pauses:
            # `Presence` removes the reason, because the end of a pause that absent participants did
            # not cause starts their grace periods again.
            self._presence.lift(why, now)
            self._update_pauses(now)

    def renew_patience(self, now: float, patience: float) -> None:
        """Start the time again for which the game waits for participants after a restart."""
        if PauseReason.RESTART in self.pauses:
            self.pauses.until[PauseReason.RESTART] = now + patience
        if not self.pauses.outer:
            self._presence.grant_grace(now)

    def opened_at(self, opened: float, now: float) -> None:
        """Set the time at which another process opened this episode."""
        self._presence.opened = opened
        if self.record.phase is Phase.WAITING and not self.pauses.outer:
            self._presence.grant_grace(now)

    def _update_presence(self, now: float) -> None:
        self._presence.update(now)
        self._start_when_complete(now)
        self._update_pauses(now)

    def _update_pauses(self, now: float) -> None:
        record = self.record
        if not record.in_progress:
            return
        # A change of the reasons is reported too: participants see the first reason, and the
        # recording has all of them.
        reasons = tuple(self.pauses.until)
        if reasons != self._reported:
            self._reported = reasons
            elapsed = record.elapsed(now)
            if reasons:
                record.enter_phase(PhaseEvent.PAUSE)
                record.stopwatch.stop(elapsed)
                record.emit(Paused(reasons, elapsed))
            else:
                record.enter_phase(PhaseEvent.RESUME)
                record.stopwatch.go_on(elapsed)
                # The budgets of the step and the seats restart, so that a pause costs no player
                # thinking time (docs/decisions/0015).
                record.clock.resume(now)
                self._start_move_timer(now)
                record.emit(Resumed(elapsed))
        self._take_decided_steps(now)

    # Actions

    def submit(self, player: str, request: ActionRequest, now: float) -> None:
        """Submit a seat's decision for the next step.

        An action whose preconditions do not hold, or a text that names no action, is rejected at
        once, and the seat may decide again. During a pause the decision waits. If a treatment
        delays the seat, the request is handled after the delay.

        Raises:
            ProtocolError: `seat/unknown`, `episode/waiting`, `episode/ended` or `action/stale`; or
                `rate/words` if the seat's quota has no room for the reasoning. The action can be
                submitted again without it.
        """
        if self._submissions.submit(player, request, now):
            self._take_decided_steps(now)

    def reject(self, player: str, request: ActionRequest, why: ProtocolError, now: float) -> None:
        """Reject a request as `submit` would, because the caller could not read its action.

        Args:
            request: The request, with its action as text.
            why: The reason. Code `action/unknown` means that the text names no action.

        Raises:
            ProtocolError: As for `submit`.
        """
        self._submissions.reject(player, request, why, now)

    def refuse(self, player: str, request: ActionRequest, why: ProtocolError, now: float) -> None:
        """Record a request that is not evaluated. The seat's last action stays the same.

        Args:
            request: The request, with its action as text; `seq` is 0 if it had no number.
            why: Code `action/stale`, `episode/waiting`, `rate/limited` or `message/...`.

        Raises:
            ProtocolError: `seat/unknown` or `episode/ended`.
        """
        self._submissions.refuse(player, request, why, now)

    def substitute(self, player: str, action: GroundAction | None, now: float) -> None:
        """Submit a substitute's action for the next step.

        Has no effect if the substitute does not control the seat. An invalid action counts as doing
        nothing.
        """
        if self._submissions.substitute(player, action, now):
            self._take_decided_steps(now)

    # Chat, notes and operator decisions

    def say(self, name: str, player: str, text: str, now: float) -> None:
        """Post a chat message to everybody in the episode.

        Args:
            name: The sender's name.
            player: The sender's seat; empty for a spectator.

        Raises:
            ProtocolError: `episode/ended`, `seat/unknown`, `chat/off`, `chat/phrase`, or
                `rate/words` if the quota of the seat, or of all spectators, is used up.
        """
        self._speech.say(name, player, text, now)

    def signal(self, name: str, player: str, signal: Signal, now: float) -> None:
        """Post a signal of a seat to everybody in the episode, with a sentence that states it.

        Args:
            name: The sender's name.

        Raises:
            ProtocolError: `episode/ended`, `seat/unknown`, `chat/off` or `chat/phrase` if the rules
                permit no signals, `chat/target` if the signal cannot point at this, or
                `rate/words`.
        """
        self._speech.signal(name, player, signal, now)

    def note(self, player: str, topic: str, text: str, now: float, *, more: bool = False) -> None:
        """Record a text of a seat. No participant receives it.

        Args:
            topic: Subject of the note.
            more: True if the next note continues this one.

        Raises:
            ProtocolError: `episode/ended`, `seat/unknown`, or `rate/words` if the seat may record
                no more notes.
        """
        self._speech.note(player, topic, text, now, more=more)

    def note_round_trip(self, player: str, seconds: float, now: float) -> None:
        """Record the round-trip time of messages to a seat's participant."""
        self.record.seat(player)
        if not self.record.ended:
            self.record.emit(RoundTripMeasured(player, seconds, self.record.elapsed(now)))

    def announce(self, text: str, now: float) -> None:
        """Send an operator's message to everybody in the episode."""
        if not self.record.ended:
            self.record.emit(AnnouncementMade(text, self.record.elapsed(now)))

    def moderate(
        self, what: Moderation, session: str, participant: str, name: str, now: float
    ) -> None:
        """Apply an operator's decision about a participant.

        Args:
            session: Pseudonym of the participant's current session.
            participant: Pseudonym for later sessions; possibly empty.
            name: The participant's name, for the recording.
        """
        # After the end, the decision still applies in the room, but it is not recorded: nothing may
        # follow the footer of a recording.
        self.record.apply_moderation(what, session, participant)
        if not self.record.ended:
            elapsed = self.record.elapsed(now)
            self.record.emit(Moderated(what, session, participant, name, elapsed))

    # Time

    def due(self, *, with_held: bool = True) -> float | None:
        """Return when to call `tick`; None if only requests can advance the episode.

        Args:
            with_held: False to ignore requests that a treatment delays. Participants must not
                receive a time that reveals the treatment.
        """
        record = self.record
        if record.ended:
            return None
        clock = record.clock.due() if record.running else record.starts_at
        held = self._submissions.due() if with_held else None
        if held is None and self._presence.complete and not self.pauses.until:
            return clock  # Fast path for the usual case: servers ask after every message.
        absence = self._presence.due()
        return min((time for time in (clock, held, absence) if time is not None), default=None)

    @property
    def behind(self) -> bool:
        """True if due steps are left for `tick`, which takes a limited number at once."""
        return self.record.running and self.record.clock.behind

    def tick(self, now: float) -> None:
        """Let time pass: take due steps, end expired pauses and free the seats of lost players."""
        self.tick_briefly(now)
        while self.record.clock.scheduled and self.behind:
            self.tick_briefly(now)

    def tick_briefly(self, now: float) -> None:
        """Let time pass as `tick` does, but take at most `MAX_LATE_AT_ONCE` late steps.

        The rest follows when it is called again, while the episode is `behind`.
        """
        record = self.record
        if self.pauses.until or not self._presence.complete:
            self._end_expired_pauses(now)
        if record.starts_at is not None and now >= record.starts_at:
            self._start(now)
        scheduled = record.clock.scheduled
        # Without the wall clock, a held request that is due may complete the step's decisions. It
        # must count before the clock finds the budget used up.
        if not scheduled:
            self._release_held(now)
        if record.running:
            # A late tick may take several scheduled steps. Each one includes the held requests
            # that were due at its own time, as if the tick had not been late.
            for at in record.clock.on_tick(now, record):
                self._release_held(at)
                self._take_step(at, now - at)
        if not (scheduled and self.behind):
            self._release_held(now)

    # Requests are released one at a time: a decision may complete a step, and then the next held
    # request is evaluated in another state.
    def _release_held(self, now: float) -> None:
        for _ in self._submissions.release(now):
            self._take_decided_steps(now)

    def _end_expired_pauses(self, now: float) -> None:
        for why in self.pauses.expired(now):
            # Only these two reasons end the game when they expire. After any other reason, the
            # absence rule applies to participants who are not back.
            if why in (PauseReason.DESERTED, PauseReason.ABSENCE):
                self._end(Reason.ABANDONED, now, self._presence.missing())
                return
            self.resume(why, now)
        # Each participant leaves by one call: with the absence rule `end`, the first departure ends
        # the game, and the outcome names only that participant.
        for players in by_holder(self._presence.overdue(now)):
            self.leave(players, now, Departure.LOST)

    def _start_move_timer(self, now: float) -> None:
        self.step_began = now
        self.record.clock.start_move(now)

    def _take_decided_steps(self, now: float) -> None:
        for at in self.record.clock.on_decision(now, self.record):
            self._take_step(at)

    def _take_step(self, now: float, late: float = 0.0) -> None:
        """Take a step that was due at `now` and is taken `late` seconds after that."""
        record = self.record
        joint = joint_action(
            record.seats.values(), record.state, record.step, by_arrival=record.clock.scheduled
        )
        goal = record.take_step(
            joint.moves, joint.idle, joint.waits, record.elapsed(now), late=late
        )
        if not self._end_if_finished(now, goal=goal):
            self._start_move_timer(now)

    def _end_if_finished(self, now: float, *, goal: bool) -> bool:
        """Return whether the episode has ended."""
        # Check the goal first, because a goal reached in the very last step counts.
        if goal:
            self._end(Reason.GOAL, now)
        elif self.record.state.shift_over:
            self._end(Reason.SHIFT_OVER, now)
        elif self.record.step >= self.record.rules.max_steps:
            self._end(Reason.STEP_LIMIT, now)
        return self.record.ended
