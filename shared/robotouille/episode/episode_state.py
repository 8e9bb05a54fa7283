"""What an episode is at present, and what it reports: state, phase, seats, texts and events."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from robotouille.episode.clocks import clock_for
from robotouille.episode.events import (
    Announced,
    Departure,
    Ended,
    Event,
    Moderated,
    Moderation,
    Move,
    Noted,
    Outcome,
    QuotaReached,
    Reason,
    RoundTripMeasured,
    Said,
    Stepped,
)
from robotouille.episode.lifecycle import Controller, Phase, PhaseEvent, next_phase
from robotouille.episode.pauses import Stopwatch
from robotouille.episode.quota import (
    MAX_AUDIENCE_BYTES,
    NOTE_BYTES,
    Quota,
    size_of_note,
    take_or_refuse,
)
from robotouille.episode.rules import NO_TREATMENT, Absence, Chat, Rules, SeatTreatment
from robotouille.episode.seats import ActionAnswer, Seat, count_step, names_of
from robotouille.episode.tallies import SeatTally
from robotouille.errors import ProtocolError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.objects import Atom
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille.world.world import State, World

__all__ = ["EpisodeState", "Undone", "nothing_undone"]


Undone = Callable[[State], Sequence[Atom]]
"""What chance takes back of the facts of a state after a step's actions."""


def nothing_undone(state: State) -> Sequence[Atom]:
    """Nothing ever is: the world is deterministic."""
    return ()


class EpisodeState:
    """A game under some rules, without the decisions on it: those are `Episode`'s.

    `starts_at` is when the game begins, while that is counted down to. `said` counts chat messages;
    `used` says whether anybody ever took a seat; `banned` are the sessions and participants that
    may not come in, `muted` the participants that may not talk. `scheduled` says whether steps
    follow the wall clock, whoever has acted.

    Args:
        undone: What chance takes back after each step.
        treatments: What a study does to seats, by player.
    """

    __slots__ = (
        "_clock",
        "_events",
        "_started",
        "_stopwatch",
        "_undone",
        "audience_quota",
        "banned",
        "muted",
        "outcome",
        "phase",
        "rules",
        "said",
        "scheduled",
        "seats",
        "starts_at",
        "state",
        "step",
        "used",
        "world",
    )

    def __init__(
        self,
        world: World,
        rules: Rules,
        undone: Undone = nothing_undone,
        treatments: Mapping[str, SeatTreatment] = MappingProxyType({}),
    ) -> None:
        self.world = world
        self._undone = undone
        self.rules = rules
        self.state: State = world.initial
        self.step = 0
        self.phase = Phase.WAITING
        self.starts_at: float | None = None
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
        self._clock = clock_for(rules, world.players)
        self.scheduled = self._clock.scheduled
        self._started: float | None = None
        self._stopwatch = Stopwatch()
        self._events: list[Event] = []

    # Phases

    @property
    def in_progress(self) -> bool:
        """Whether the game has begun and has not ended; it may stand still."""
        return self.phase is Phase.RUNNING or self.phase is Phase.PAUSED

    @property
    def running(self) -> bool:
        """Whether the game has begun, has not ended, and time runs."""
        return self.phase is Phase.RUNNING

    @property
    def paused(self) -> bool:
        """Whether the game has begun, has not ended, and stands still."""
        return self.phase is Phase.PAUSED

    @property
    def ended(self) -> bool:
        """Whether it has an outcome."""
        return self.phase is Phase.ENDED

    def _enter_phase(self, event: PhaseEvent) -> None:
        self.phase = next_phase(self.phase, event)

    def _end(self, reason: Reason, now: float, detail: str = "") -> None:
        self._enter_phase(PhaseEvent.END)
        tallies = tuple(replace(seat.tally) for seat in self.seats.values())
        self.outcome = Outcome(reason, self.step, self._elapsed(now), tallies, detail)
        self._emit(Ended(self.outcome))

    def _check_open(self) -> None:
        if self.ended:
            raise ProtocolError("episode/over", "the episode is over", "episode")

    def _check_begun(self) -> None:
        if self.phase is Phase.WAITING:
            raise ProtocolError("episode/waiting", self._waits_for(), "episode")
        self._check_open()

    def _waits_for(self) -> str:
        """What the beginning waits for, in words."""
        if self.starts_at is not None:
            return "the episode begins in a moment"
        missing = sum(not seat.present for seat in self.seats.values())
        if missing:
            return f"the episode waits for {missing} more player{'s' * (missing > 1)}"
        unready = names_of(seat for seat in self.seats.values() if not seat.ready)
        return f"the episode waits until {unready} can begin"

    # Seats and steps

    def seat(self, player: str) -> Seat:
        """The seat of a player.

        Raises:
            ProtocolError: `seat/unknown`, if there is none.
        """
        if player not in self.seats:
            listed = ", ".join(self.seats)
            raise ProtocolError("seat/unknown", f"no seat {player!r}; there are {listed}", "seat")
        return self.seats[player]

    def seats_of(self, players: str | Collection[str]) -> list[Seat]:
        """The seats of some players, in seat order; ProtocolError `seat/unknown`."""
        wanted = {players} if isinstance(players, str) else set(players)
        for player in sorted(wanted.difference(self.seats)):
            self.seat(player)
        return [seat for seat in self.seats.values() if seat.player in wanted]

    def check_free(self, players: Collection[str]) -> list[Seat]:
        """The seats of some players, in seat order, which anybody may take.

        Raises:
            ProtocolError: `episode/over`, `seat/unknown` or `seat/taken`.
        """
        self._check_open()
        seats = self.seats_of(players)
        for seat in seats:
            if seat.taken:
                raise ProtocolError("seat/taken", f"{seat.player} is played by {seat.name}", "seat")
        return seats

    def free_seats(self) -> tuple[str, ...]:
        """The players whose seats anybody may take.

        Raises:
            ProtocolError: `episode/over`, or `episode/full` where there is none.
        """
        self._check_open()
        if free := tuple(seat.player for seat in self.seats.values() if not seat.taken):
            return free
        message = f"all {len(self.seats)} seats are taken"
        if away := names_of(seat for seat in self.seats.values() if not seat.present):
            message += f"; {away} may still come back to theirs"
        raise ProtocolError("episode/full", message, "episode")

    def _emit_roster(self, seat: Seat, now: float, why: Departure | None = None) -> None:
        seat.controller = self._controller(seat)
        self._emit(seat.roster_change(self._elapsed(now), why))

    def _controller(self, seat: Seat) -> Controller:
        if seat.present:
            return Controller(seat.kind)
        if self.in_progress and self.rules.absence is Absence.BOT:
            return Controller.STAND_IN
        return Controller.ABSENT if seat.taken else Controller.FREE

    @property
    def on_turn(self) -> str | None:
        """Whose turn it is, with the turn clock."""
        turn = self._clock.on_turn(self.step)
        return turn if turn is not None and self.in_progress else None

    def _faults(
        self, seat: Seat, action: GroundAction | None, *, anticipates: bool = False
    ) -> tuple[Unmet, ...]:
        """Why an action cannot be taken; empty if it can."""
        turn = self.on_turn
        if turn is not None and turn != seat.player:
            return (Unmet(UnmetKind.TURN, f"it is {turn}'s turn", objects=(turn,)),)
        if action is None:
            return ()
        if action.player is not None and action.player != seat.player:
            words = f"{action.player} is not yours to move: you play {seat.player}"
            return (Unmet(UnmetKind.SEAT, words, objects=(action.player,)),)
        if anticipates or self.world.applicable(self.state, action):
            return ()
        return self.world.unmet(self.state, action)

    def _transition(
        self,
        moves: tuple[Move, ...],
        idle: tuple[tuple[str, int], ...],
        waits: tuple[str, ...],
        time: float,
    ) -> bool:
        """Take a joint action; whether it reaches the goal."""
        before = self.state
        result = before.step([move.action for move in moves])
        turn = self.on_turn
        self.step += 1
        undone = () if result.goal_reached else self._undone(result.state)
        self.state = result.state.without(undone) if undone else result.state
        for move, attempt in zip(moves, result.attempts, strict=True):
            if move.seq > 0:
                seat, reasons = self.seats[move.player], attempt.reasons
                seat.answer = ActionAnswer(move.seq, self.step, () if attempt.applied else reasons)
                seat.tally.rejected += not attempt.applied
        busy = [player for player, _ in before.timers.busy]
        count_step(self.seats.values(), busy, moves, result.attempts, turn, waits)
        self._ask_anew(busy, moves, time)
        turn = self.on_turn
        step, after = self.step, self.state
        told = turn, idle, tuple(undone), waits
        self._emit(Stepped(step, time, moves, result.attempts, before, after, *told))
        return result.goal_reached or (bool(undone) and after.goal_reached)

    def _ask_anew(self, busy: Collection[str], moves: tuple[Move, ...], time: float) -> None:
        """A step was taken: from now on counts the time that these take for their next move. Where
        steps follow the wall clock that is whoever has moved, or could not; else all are asked."""
        ran = self._stopwatch.read(time)
        moved = {move.player for move in moves}
        for seat in self.seats.values():
            player = seat.player
            if not self.scheduled or player in moved or player in busy:
                seat.asked_at = ran

    # Texts

    def say(self, name: str, player: str, text: str, now: float) -> None:
        """A chat message to everybody in the episode; it is recorded.

        Args:
            name: Who says it.
            player: Whose seat that one has; empty for a spectator.

        Raises:
            ProtocolError: `episode/over`, `seat/unknown`, `chat/off` or `chat/phrase` where this
                may not be said here, or `rate/words` where no more text is recorded of the seat,
                or of spectators.
        """
        self._check_open()
        self._check_chat(text)
        quota = self.seat(player).quota if player else self.audience_quota
        size = NOTE_BYTES + len(name.encode()) + len(text.encode())
        self._take_quota(quota, size, player, now, "you can say no more here")
        if player:
            self.seat(player).tally.said += 1
        self.said += 1
        self._emit(Said(name, player, text, self._elapsed(now), self.said))

    def _check_chat(self, text: str) -> None:
        if self.rules.chat is Chat.OFF:
            raise ProtocolError("chat/off", "nothing is said in this episode", "text")
        if self.rules.chat is Chat.PHRASES and text not in self.rules.phrases:
            listed = ", ".join(map(repr, self.rules.phrases))
            message = f"only these may be said in this episode: {listed}"
            raise ProtocolError("chat/phrase", message, "text")

    def note(self, player: str, topic: str, text: str, now: float, *, more: bool = False) -> None:
        """A text of a seat's own for the recording, which nobody is told.

        Notes leave half of the seat's quota to its reasoning and chat.

        Args:
            topic: What it is about.
            more: The next piece follows.

        Raises:
            ProtocolError: `episode/over`, `seat/unknown`, or `rate/words` where no more notes are
                recorded of the seat.
        """
        self._check_open()
        seat = self.seat(player)
        size = size_of_note(topic, text)
        if seat.quota.reached or not seat.quota.half_left(size):
            raise ProtocolError("rate/words", "no more notes of this seat are recorded", "text")
        seat.quota.take(size)
        self._emit(Noted(player, topic, text, self._elapsed(now), more))

    def _take_quota(self, quota: Quota, size: int, player: str, now: float, instead: str) -> None:
        reached = quota.reached
        try:
            take_or_refuse(quota, size, instead)
        finally:
            if quota.reached and not reached:
                self._emit(QuotaReached(player, self._elapsed(now)))

    def note_round_trip(self, player: str, seconds: float, now: float) -> None:
        """How long a message takes to a seat's participant and back; it is recorded.

        Raises:
            ProtocolError: `seat/unknown`.
        """
        self.seat(player)
        if not self.ended:
            self._emit(RoundTripMeasured(player, seconds, self._elapsed(now)))

    def announce(self, text: str, now: float) -> None:
        """Something the operator says to everybody in the episode; it is recorded."""
        if not self.ended:
            self._emit(Announced(text, self._elapsed(now)))

    def moderate(
        self, what: Moderation, session: str, participant: str, name: str, now: float
    ) -> None:
        """An operator's decision on somebody; it is recorded, if the episode has not ended.

        Args:
            session: A pseudonym, under which they are here now.
            participant: A pseudonym, for any later session; empty where there is none.
            name: What they are called, for the record.
        """
        self._apply_moderation(what, session, participant)
        if not self.ended:
            self._emit(Moderated(what, session, participant, name, self._elapsed(now)))

    def _apply_moderation(self, what: Moderation, session: str, participant: str) -> None:
        match what:
            case Moderation.BANNED:
                self.banned |= {session, participant} - {""}
            case Moderation.MUTED:
                self.muted.add(participant or session)
            case Moderation.UNMUTED:
                self.muted.discard(participant or session)

    # Events

    def events(self) -> list[Event]:
        """What has happened since this was last asked, in order."""
        if not self._events:
            return []
        events, self._events = self._events, []
        return events

    def _elapsed(self, now: float) -> float:
        """Seconds since the game began; 0 until then."""
        return 0.0 if self._started is None else max(0.0, now - self._started)

    def _ran(self, now: float) -> float:
        """Seconds for which the game has run until now."""
        return self._stopwatch.read(self._elapsed(now))

    def _emit(self, event: Event) -> None:
        self._events.append(event)
