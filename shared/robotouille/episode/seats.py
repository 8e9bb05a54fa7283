"""Seats: who plays each player of the world, and what became of the seat's actions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from robotouille.episode.events import (
    ACTION_INVALID,
    Departure,
    PlayedMove,
    RejectionKind,
    SeatChanged,
)
from robotouille.episode.lifecycle import Controller, SeatEvent, SeatState, next_seat_state
from robotouille.episode.quota import SEAT_QUOTA_BYTES, Quota
from robotouille.episode.rules import NO_TREATMENT, SeatTreatment
from robotouille.episode.tallies import SeatTally, activity
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Attempt
from robotouille.world.world import State


class ActionRequest(NamedTuple):
    """One request of a seat to act.

    Attributes:
        seq: The seat's number for the request. A repeated number has no second effect, and a lower
            one is stale.
        action: The action, or the text that names it (see `World.parse`); None to do nothing.
        basis: The step on whose state the choice was made. A future step is dropped.
        max_age: Most steps between the basis and the state in which the action is tried. An older
            action is stale.
        reasoning: Text for the recording. Nobody else receives it.
        think_ms: Milliseconds of thought, which count if the rules say `declared`.
        anticipates: The action may become possible through another player's action in the same
            step. Its preconditions are checked in the step, after the actions it may depend on.
        waits: With no action: the seat waits for a place or a player, and is not idle.
    """

    seq: int
    action: GroundAction | str | None = None
    basis: int | None = None
    reasoning: str = ""
    think_ms: int = 0
    anticipates: bool = False
    waits: bool = False
    max_age: int | None = None


@dataclass(slots=True)
class PendingAction:
    """Decision of a seat that waits for its step.

    Attributes:
        action: None is the decision to do nothing.
        request: The request; number 0 marks a substitute's decision.
        latency: Seconds that the seat took to decide.
        order: Number of the decision among all seats' decisions.
        due_step: The step before which the decision has no effect.
    """

    action: GroundAction | None
    request: ActionRequest
    latency: float
    order: int
    due_step: int


class ActionAnswer(NamedTuple):
    """Result of a seat's action: taken in `step`, or rejected with reasons and a code."""

    seq: int
    step: int
    reasons: tuple[str, ...] = ()
    code: str = ACTION_INVALID


@dataclass(slots=True)
class Seat:
    """A player of the world and the participant who plays it.

    Attributes:
        agent: The program that plays, in its own words.
        session: Pseudonym of the session that holds the seat.
        participant: Pseudonym of the participant, the same in later sessions.
        generation: Generation of the last resume token used.
        seq: Highest sequence number of a request so far.
        asked_at: Running time of the game since when the seat could act and has not.
        left_at: Running time of the game when the participant was lost.
        away: Time since when the participant has been absent.
        misnamed: Number of the last request whose text named no action when it arrived.
        refused: True if a request since the last step was rejected or refused.
        ready: False until the participant agrees to start.
        answer: Result of the last decided action.
        quota: Bytes of text that are still recorded for this seat.
    """

    player: str
    name: str = ""
    kind: str = ""
    agent: str = ""
    session: str = ""
    participant: str = ""
    generation: int = 0
    state: SeatState = SeatState.FREE
    controller: Controller = Controller.FREE
    seq: int = 0
    misnamed: int | None = None
    asked_at: float = 0.0
    left_at: float = 0.0
    away: float = 0.0
    refused: bool = False
    ready: bool = True
    pending: PendingAction | None = None
    answer: ActionAnswer = field(default_factory=lambda: ActionAnswer(0, 0))
    tally: SeatTally = field(default_factory=lambda: SeatTally(""))
    quota: Quota = field(default_factory=lambda: Quota(SEAT_QUOTA_BYTES))
    treatment: SeatTreatment = NO_TREATMENT

    @property
    def disguised(self) -> bool:
        """True if a treatment sets the kind that others see, even if it is the real one."""
        return self.treatment.shown_as is not None

    @property
    def shown_kind(self) -> str:
        """The participant's kind as others see it; empty if the seat is free."""
        return (self.treatment.shown_as or self.kind) if self.taken else ""

    @property
    def shown_controller(self) -> Controller:
        """The controller as others see it."""
        # A treatment may hide the participant's kind, but not an absence or a substitute.
        by_participant = self.present and self.controller == self.kind
        return Controller(self.shown_kind) if by_participant else self.controller

    @property
    def taken(self) -> bool:
        """True if a participant, present or absent, has the seat."""
        return self.state is not SeatState.FREE

    @property
    def present(self) -> bool:
        """True if the participant is connected."""
        return self.state is SeatState.PRESENT

    @property
    def active(self) -> bool:
        """True if the participant or a substitute decides for the seat."""
        return self.state is SeatState.PRESENT or self.controller is Controller.SUBSTITUTE

    def decided(self, state: State) -> bool:
        """Return whether a step need not wait for this seat."""
        return self.pending is not None or not self.active or state.busy_steps(self.player) > 0

    def take(self, name: str, kind: str, session: str, participant: str, ran: float) -> None:
        """Give the seat to a new participant.

        Args:
            ran: Seconds for which the game has run, here and below.

        Raises:
            IllegalEventError: The seat is taken.
        """
        self.state = next_seat_state(self.state, SeatEvent.TAKE)
        self.name, self.kind = name, kind
        self.session, self.participant, self.generation = session, participant, 0
        self.quota.renew()
        self.ready = True
        self.asked_at = ran
        # The new participant numbers its requests from 1 again.
        self.seq, self.pending, self.answer = 0, None, ActionAnswer(0, 0)
        self.misnamed = None

    def change_session(self, session: str, kind: str) -> None:
        """Let the participant go on in another session."""
        self.session, self.kind, self.generation = session, kind, 0

    def lose_connection(self, ran: float) -> None:
        """Mark the participant as absent.

        Raises:
            IllegalEventError: The seat is free, or the participant is already absent.
        """
        self.state = next_seat_state(self.state, SeatEvent.LOSE)
        self.left_at = ran

    def come_back(self, ran: float) -> None:
        """Mark the participant as present.

        Raises:
            IllegalEventError: The seat is free.
        """
        # The participant could not see the game while it ran, so its decision time restarts. In a
        # paused game nothing has changed, and the time before the absence still counts.
        if not self.present and ran > self.left_at:
            self.asked_at = ran
        self.state = next_seat_state(self.state, SeatEvent.RETURN)

    def set_present(self, present: bool, now: float, ran: float) -> None:
        """Record that the participant is present or absent.

        Raises:
            IllegalEventError: The seat is free.
        """
        if self.present != present:
            self.away = now
        # Drop a decision of the substitute: the participant must not find itself moved by it.
        if self.pending is not None and self.pending.request.seq == 0:
            self.pending = None
        if present:
            self.come_back(ran)
        elif self.present:
            self.lose_connection(ran)

    def vacate(self, ran: float) -> None:
        """Free the seat.

        Raises:
            IllegalEventError: The seat is already free.
        """
        if self.present:
            self.left_at = ran
        self.state = next_seat_state(self.state, SeatEvent.VACATE)
        self.refused, self.ready = False, True
        self.name = self.kind = self.session = self.participant = self.agent = ""
        self.generation = 0
        self.pending = None

    def roster_change(self, time: float, why: Departure | None = None) -> SeatChanged:
        """Return the seat as an event.

        Args:
            time: Seconds since the game started.
            why: Reason for which the participant has just lost the seat.
        """
        return SeatChanged(
            self.player,
            self.name,
            self.kind,
            self.present,
            time,
            taken=self.taken,
            controller=self.controller,
            session=self.session,
            participant=self.participant,
            generation=self.generation,
            why=why,
            agent=self.agent,
        )

    def thought(self, ran: float) -> float:
        """Return the seconds for which the current controller could have acted and has not."""
        # A substitute is only responsible for the time since the participant left.
        since = self.asked_at if self.present else max(self.asked_at, self.left_at)
        return max(0.0, ran - since)

    def count_rejection(self, kind: RejectionKind, *, recorded: bool = True) -> None:
        """Count a request that was not taken into a step."""
        # The activity of a step must be the same when it is computed from the recording, so an
        # unrecorded rejection cannot turn an idle step into a waiting one.
        self.refused |= recorded and kind is not RejectionKind.SUPERSEDED
        self.tally.rejected += 1
        self.tally.invalid += kind is RejectionKind.INVALID
        self.tally.malformed += kind is RejectionKind.MALFORMED

    def take_pending(self, step: int) -> PendingAction | None:
        """Remove and return the decision for the step after `step`, if there is one."""
        pending = self.pending
        if pending is None or pending.due_step > step:
            return None
        self.pending = None
        if pending.request.seq > 0:
            self.answer = ActionAnswer(pending.request.seq, step + 1)
        return pending


def by_holder(seats: Iterable[Seat]) -> list[list[str]]:
    """Group the players of some seats by the participant who holds them."""
    players: dict[str, list[str]] = {}
    for seat in seats:
        players.setdefault(seat.session or seat.player, []).append(seat.player)
    return list(players.values())


def names_of(seats: Iterable[Seat]) -> str:
    """Return the participants' names as text, with the player's name for a free seat."""
    return " and ".join(dict.fromkeys(seat.name or seat.player for seat in seats))


def count_step(
    seats: Iterable[Seat],
    busy: Collection[str],
    moves: Sequence[PlayedMove],
    attempts: Sequence[Attempt],
    turn: str | None,
    waits: Collection[str] = (),
) -> None:
    """Count one step for every seat.

    Args:
        busy: Players who could not act.
        turn: The player whose turn it was, with the turn clock.
        waits: Players who declared a wait.
    """
    applied = {move.player: attempts[i].applied for i, move in enumerate(moves)}
    for seat in seats:
        player = seat.player
        others_turn = turn is not None and turn != player
        waiting = seat.refused or player in waits
        facts = applied.get(player), player in busy, waiting, others_turn
        seat.tally.count(activity(seat.controller, *facts))
        seat.refused = False
