"""The data of an episode, and the changes that both play and recovery make to it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from robotouille.episode.clocks import MAX_LATE_AT_ONCE, clock_for
from robotouille.episode.events import (
    Departure,
    EpisodeEnded,
    Event,
    Moderation,
    Outcome,
    PlayedMove,
    QuotaReached,
    Reason,
    Score,
    Stepped,
)
from robotouille.episode.lifecycle import (
    Absence,
    Controller,
    Phase,
    PhaseEvent,
    Stopwatch,
    next_phase,
)
from robotouille.episode.quota import MAX_AUDIENCE_BYTES, Quota, take_or_refuse
from robotouille.episode.rules import NO_TREATMENT, Rules, SeatTreatment
from robotouille.episode.seats import ActionAnswer, Seat, count_step, names_of
from robotouille.episode.tallies import SeatTally
from robotouille.errors import ProtocolError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.objects import Atom
from robotouille.world.sight import Seen, Sight, seen_by, told
from robotouille.world.unmet import Unmet
from robotouille.world.world import State, World

KEPT_STATES = MAX_LATE_AT_ONCE + 1
"""Number of states whose visible parts the record keeps: those before and after all steps that are
published together."""

RandomReversal = Callable[[State], Sequence[Atom]]
"""Function that chooses which facts of a state after a step become false again by chance."""


def no_reversal(state: State) -> Sequence[Atom]:
    """Reverse nothing: the world is deterministic."""
    return ()


class EpisodeRecord:
    """State, seats, phase and unreported events of one episode.

    `Episode` decides what happens and when. Recovery (`robotouille.replay.restore`) writes recorded
    steps into the record directly, because their decisions were made by another process.

    Attributes:
        starts_at: Time at which a running countdown ends.
        started: Time at which the game started; None before.
        said: Number of chat messages so far.
        used: True once a participant has taken a seat.
        banned: Sessions and participants that may not enter.
        muted: Participants (or sessions without a participant) that may not chat.
    """

    __slots__ = (
        "_last_seen",
        "_seen",
        # Slots and shared objects brought a room of two from 137 to 52 KiB (docs/decisions/0019).
        "audience_quota",
        "banned",
        "clock",
        "events",
        "muted",
        "outcome",
        "phase",
        "random_reversal",
        "rules",
        "said",
        "seats",
        "sight",
        "started",
        "starts_at",
        "state",
        "step",
        "stopwatch",
        "used",
        "world",
    )

    def __init__(
        self,
        world: World,
        rules: Rules,
        random_reversal: RandomReversal = no_reversal,
        treatments: Mapping[str, SeatTreatment] = MappingProxyType({}),
    ) -> None:
        self.world = world
        self.rules = rules
        self.sight = rules.limited_sight
        self._last_seen: dict[tuple[str, ...], tuple[int, Seen]] = {}
        self._seen: list[tuple[State, dict[tuple[str, ...], Seen]]] = []
        self.random_reversal = random_reversal
        self.state: State = world.initial
        self.step = 0
        self.phase = Phase.WAITING
        self.starts_at: float | None = None
        self.started: float | None = None
        self.outcome: Outcome | None = None
        self.seats = {
            p: Seat(p, tally=SeatTally(p), treatment=treatments.get(p, NO_TREATMENT))
            for p in world.players
        }
        self.said = 0
        self.audience_quota = Quota(MAX_AUDIENCE_BYTES)
        self.used = False
        self.banned: set[str] = set()
        self.muted: set[str] = set()
        self.clock = clock_for(rules, world.players)
        self.stopwatch = Stopwatch()
        # Collected and not sent at once: the server writes them to the disk before it publishes any
        # of them (docs/decisions/0013).
        self.events: list[Event] = []

    # Time and phases

    def elapsed(self, now: float) -> float:
        """Return the seconds since the game started, pauses included; 0 before the start."""
        # The time must not be negative: after a restart, `started` is computed from a rounded
        # recorded time.
        return 0.0 if self.started is None else max(0.0, now - self.started)

    def ran(self, now: float) -> float:
        """Return the seconds for which the game has run, without pauses."""
        return self.stopwatch.read(self.elapsed(now))

    @property
    def in_progress(self) -> bool:
        """True from the start to the end, pauses included."""
        return self.phase is Phase.RUNNING or self.phase is Phase.PAUSED

    @property
    def running(self) -> bool:
        """True from the start to the end, except during pauses."""
        return self.phase is Phase.RUNNING

    @property
    def ended(self) -> bool:
        """True once the episode has an outcome."""
        return self.phase is Phase.ENDED

    @property
    def on_turn(self) -> str | None:
        """The only player who may act now; None without turns, or if no game is in progress."""
        # This also holds during a pause, because an action may be submitted then and waits for its
        # step.
        turn = self.clock.on_turn(self.step)
        return turn if turn is not None and self.in_progress else None

    def enter_phase(self, event: PhaseEvent) -> None:
        """Move to the phase that follows an event.

        Raises:
            IllegalEventError: The event cannot happen in the current phase.
        """
        self.phase = next_phase(self.phase, event)

    def start(self) -> None:
        """Enter the running phase.

        Raises:
            IllegalEventError: The game has already started.
        """
        self.enter_phase(PhaseEvent.START)
        # A request before the start was refused for being early, not because the seat had to wait.
        for seat in self.seats.values():
            seat.refused = False

    def end(self, reason: Reason, now: float, detail: str = "") -> None:
        """End the episode and report the outcome."""
        self.enter_phase(PhaseEvent.END)
        # Copies: the outcome must not change if a seat is still counted afterwards.
        tallies = tuple(replace(seat.tally) for seat in self.seats.values())
        orders = self.state.orders
        score = None if orders is None else Score(orders.score, orders.served, orders.expired)
        self.outcome = Outcome(reason, self.step, self.elapsed(now), tallies, detail, score)
        self.emit(EpisodeEnded(self.outcome))

    def check_open(self) -> None:
        """Raise ProtocolError `episode/ended` if the episode has ended."""
        if self.ended:
            raise ProtocolError("episode/ended", "the episode has ended", "episode")

    def check_started(self) -> None:
        """Raise ProtocolError `episode/waiting` or `episode/ended` unless the game is on."""
        if self.phase is Phase.WAITING:
            raise ProtocolError("episode/waiting", self._missing_for_start(), "episode")
        self.check_open()

    def _missing_for_start(self) -> str:
        if self.starts_at is not None:
            return "the episode starts in a moment"
        missing = sum(not seat.present for seat in self.seats.values())
        if missing:
            return f"the episode waits for {missing} more player{'s' * (missing > 1)}"
        unready = names_of(seat for seat in self.seats.values() if not seat.ready)
        return f"the episode waits until {unready} can begin"

    # Seats

    def seat(self, player: str) -> Seat:
        """Return the seat of a player.

        Raises:
            ProtocolError: `seat/unknown`.
        """
        if player not in self.seats:
            listed = ", ".join(self.seats)
            raise ProtocolError("seat/unknown", f"no seat {player!r}; there are {listed}", "seat")
        return self.seats[player]

    def seats_of(self, players: str | Collection[str]) -> list[Seat]:
        """Return the seats of some players, in seat order.

        Raises:
            ProtocolError: `seat/unknown`.
        """
        wanted = {players} if isinstance(players, str) else set(players)
        # Sorting keeps the error from depending on the order of a set.
        for player in sorted(wanted.difference(self.seats)):
            self.seat(player)
        return [seat for seat in self.seats.values() if seat.player in wanted]

    def check_free(self, players: Collection[str]) -> list[Seat]:
        """Return the seats of some players, in seat order, if all are free.

        Raises:
            ProtocolError: `episode/ended`, `seat/unknown` or `seat/taken`.
        """
        self.check_open()
        seats = self.seats_of(players)
        for seat in seats:
            # An absent participant's seat stays taken until it is freed, which is what a resume
            # token relies on (docs/decisions/0014).
            if seat.taken:
                raise ProtocolError("seat/taken", f"{seat.player} is played by {seat.name}", "seat")
        return seats

    def free_seats(self) -> tuple[str, ...]:
        """Return the players whose seats are free.

        Raises:
            ProtocolError: `episode/ended`, or `episode/full` if no seat is free.
        """
        self.check_open()
        if free := tuple(seat.player for seat in self.seats.values() if not seat.taken):
            return free
        message = f"all {len(self.seats)} seats are taken"
        if away := names_of(seat for seat in self.seats.values() if not seat.present):
            message += f"; {away} may still come back to theirs"
        raise ProtocolError("episode/full", message, "episode")

    def all_decided(self, players: Iterable[str]) -> bool:
        """Return whether a step need not wait for any of these players."""
        return all(self.seats[player].decided(self.state) for player in players)

    def emit_roster(self, seat: Seat, now: float, why: Departure | None = None) -> None:
        """Update a seat's controller and report the seat."""
        seat.controller = self._controller(seat)
        self.emit(seat.roster_change(self.elapsed(now), why))

    def _controller(self, seat: Seat) -> Controller:
        if seat.present:
            return Controller(seat.kind)
        # There are no substitutes before the start: a participant may still take or regain the
        # seat, and no step needs it yet.
        if self.in_progress and self.rules.absence is Absence.BOT:
            return Controller.SUBSTITUTE
        # Reports keep a seat that its participant still holds apart from one that is free.
        return Controller.ABSENT if seat.taken else Controller.FREE

    def apply_moderation(self, what: Moderation, session: str, participant: str) -> None:
        """Apply an operator's decision about a participant."""
        match what:
            case Moderation.BANNED:
                self.banned |= {session, participant} - {""}
            case Moderation.MUTED:
                # The key is the participant if possible, so that a new session does not end the
                # mute.
                self.muted.add(participant or session)
            case Moderation.UNMUTED:
                self.muted.discard(participant or session)

    # Steps

    def take_step(
        self,
        moves: tuple[PlayedMove, ...],
        idle: tuple[tuple[str, int], ...],
        waits: tuple[str, ...],
        time: float,
        undone: Sequence[Atom] | None = None,
        late: float = 0.0,
    ) -> bool:
        """Apply a joint action, count it for every seat and report it.

        Args:
            moves: The moves, in the order in which they apply.
            idle: Seats that decided to do nothing, with the sequence numbers of these decisions.
            waits: Seats among them that declared a wait.
            time: Seconds from the start of the game until the step was due.
            undone: Recorded random reversals; None draws them now.
            late: Seconds from then until the step is taken.

        Returns:
            True if the goal is reached.
        """
        before = self.state
        # Each move is checked again in the state that the moves before it leave
        # (docs/decisions/0005). A conflict is a part of the step and not an error.
        result = before.step([move.action for move in moves])
        turn = self.on_turn  # Before the step number changes: the turn that was played.
        self.step += 1
        if undone is None:
            # A reached goal ends the game, so a reversal after it would never be seen.
            undone = () if result.goal_reached else self.random_reversal(result.state)
        # Without reversals the state stays the same object, which `StateWriter` compares by.
        self.state = result.state.without(undone) if undone else result.state
        for move, attempt in zip(moves, result.attempts, strict=True):
            if move.seq > 0:  # Number 0: a substitute's move, which nobody waits to hear about.
                seat = self.seats[move.player]
                unmet = self.told_in_step(seat.player, attempt.unmet, before, self.state)
                seat.answer = ActionAnswer(move.seq, self.step, tuple(map(str, unmet)))
                seat.tally.rejected += not attempt.applied
        busy = [player for player, _ in before.timers.busy]
        count_step(self.seats.values(), busy, moves, result.attempts, turn, waits)
        self._restart_decision_time(busy, moves, time)
        self.emit(
            Stepped(
                self.step,
                time,
                moves,
                result.attempts,
                before,
                self.state,
                self.on_turn,
                idle,
                tuple(undone),
                waits,
                late,
            )
        )
        # A reversal can also reach a goal that requires a fact to be false. The state is only asked
        # in that case, as the step has already computed the answer for the others.
        return result.goal_reached or (bool(undone) and self.state.goal_reached)

    def _restart_decision_time(
        self, busy: Collection[str], moves: tuple[PlayedMove, ...], time: float
    ) -> None:
        # With the wall clock a step does not ask anybody: a seat that may act and did not is still
        # thinking about its first chance. All other clocks ask every seat for each step.
        ran = self.stopwatch.read(time)
        moved = {move.player for move in moves}
        for seat in self.seats.values():
            player = seat.player
            if not self.clock.scheduled or player in moved or player in busy:
                seat.asked_at = ran

    # Sight

    def seen(self, state: State, players: tuple[str, ...], sight: Sight) -> Seen:
        """Return what some players see of a state together; the last results are kept."""
        kept = next((each for known, each in self._seen if known is state), None)
        if kept is None:
            kept = {}
            self._seen = [*self._seen[-(KEPT_STATES - 1) :], (state, kept)]
        if players not in kept:
            kept[players] = self._newly_seen(state, players, sight)
            self._last_seen[players] = state.facts, kept[players]
        return kept[players]

    def _newly_seen(self, state: State, players: tuple[str, ...], sight: Sight) -> Seen:
        if players not in self._last_seen:
            return seen_by(state, players, sight)
        facts, last = self._last_seen[players]
        # In most steps of a fast game, only time passes.
        if facts == state.facts:
            return last.of_later(state)
        return seen_by(state, players, sight).after(last)

    def seen_state(self, player: str) -> State:
        """Return the part of the state that a player sees."""
        if self.sight is None:
            return self.state
        return self.seen(self.state, (player,), self.sight).state

    def offered_actions(self, player: str) -> tuple[GroundAction, ...]:
        """Return the actions that are valid for all that a player sees."""
        if self.sight is None:
            return self.state.actions(player)
        return self.seen(self.state, (player,), self.sight).actions

    def unmet(self, player: str, action: GroundAction) -> tuple[Unmet, ...]:
        """Return the reasons against a player's action now, as far as the player sees them."""
        if self.sight is not None:
            # Otherwise a player could find out about hidden things by requests that cost no step.
            return self.seen(self.state, (player,), self.sight).unmet(action)
        if self.world.applicable(self.state, action):
            return ()
        return self.world.unmet(self.state, action)

    def told_in_step(
        self, player: str, unmet: tuple[Unmet, ...], before: State, after: State
    ) -> tuple[Unmet, ...]:
        """Return the reasons against an action in a step that its player may learn."""
        if self.sight is None or not unmet:
            return unmet
        things = self.seen(before, (player,), self.sight).things
        return told(unmet, things & self.seen(after, (player,), self.sight).things)

    # Events and quotas

    def emit(self, event: Event) -> None:
        """Append an event to those that the episode will report."""
        self.events.append(event)

    def take_quota(self, quota: Quota, size: int, player: str, now: float, instead: str) -> None:
        """Take bytes from a quota of text, and report when the quota is used up.

        Args:
            player: Owner of the quota; empty for the spectators.
            instead: Advice for the participant, for the error.

        Raises:
            ProtocolError: `rate/words`.
        """
        reached = quota.reached
        try:
            take_or_refuse(quota, size, instead)
        finally:
            if quota.reached and not reached:
                self.emit(QuotaReached(player, self.elapsed(now)))
