"""Seats: the players of a world, who plays them, and what became of their actions."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from robotouille.episode.events import (
    ACTION_INVALID,
    Departure,
    Move,
    RejectionKind,
    RosterChanged,
)
from robotouille.episode.lifecycle import Controller, SeatEvent, SeatState, next_seat_state
from robotouille.episode.quota import SEAT_QUOTA_BYTES, Quota
from robotouille.episode.rules import NO_TREATMENT, SeatTreatment
from robotouille.episode.tallies import SeatTally, activity
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Attempt
from robotouille.world.world import State

__all__ = [
    "ActionAnswer",
    "ActionRequest",
    "HeldActions",
    "PendingAction",
    "Seat",
    "by_holder",
    "count_step",
    "joint_action",
    "names_of",
    "who_waits",
]


class ActionRequest(NamedTuple):
    """What comes with an action that a seat asks for: its number, the step on which the choice was
    made, what is recorded as the reason, the milliseconds of thought, and what it `anticipates` or
    `waits` for (see `Episode.submit`)."""

    seq: int
    basis: int | None = None
    reasoning: str = ""
    think_ms: int = 0
    anticipates: bool = False
    waits: bool = False


@dataclass(slots=True)
class PendingAction:
    """An action that waits for its step; None is the decision to do nothing. A stand-in's has
    the sequence number 0. One that `anticipates` is to be made possible by another's; nothing is
    done for once, and not for want of anything to do, where somebody `waits`."""

    action: GroundAction | None
    seq: int
    latency: float
    order: int
    due_step: int
    reasoning: str = ""
    anticipates: bool = False
    basis: int | None = None
    waits: bool = False


class ActionAnswer(NamedTuple):
    """What became of a seat's action: taken in `step`, or rejected for some reasons, with the
    code that it was told."""

    seq: int
    step: int
    reasons: tuple[str, ...] = ()
    code: str = ACTION_INVALID


@dataclass(slots=True)
class Seat:
    """A player of the world and who plays it.

    `session` is who holds the seat, `participant` its pseudonym, `generation` that of the resume
    token which was used last. `away` is since when it is absent, `answer` what became of the last
    of its actions that was decided, `quota` how much of what is written in its name is recorded,
    `refused` whether something that it asked for since the last step was refused, `treatment` what
    a study does to it. `ready` says whether the game may begin, as far as it goes.

    `asked_at` is since when it could act, and has not; `left_at` is when its participant was lost.
    Both are in seconds for which the game has run.
    """

    player: str
    name: str = ""
    kind: str = ""
    session: str = ""
    participant: str = ""
    generation: int = 0
    state: SeatState = SeatState.FREE
    controller: Controller = Controller.FREE
    seq: int = 0
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
    def shown_kind(self) -> str:
        """The kind of participant that others see."""
        return (self.treatment.shown_as or self.kind) if self.taken else ""

    @property
    def shown_controller(self) -> Controller:
        """Who moves it, as others see it."""
        itself = self.present and self.controller == self.kind
        return Controller(self.shown_kind) if itself else self.controller

    @property
    def taken(self) -> bool:
        """Whether it is somebody's, present or not."""
        return self.state is not SeatState.FREE

    @property
    def present(self) -> bool:
        """Whether its participant is here."""
        return self.state is SeatState.PRESENT

    @property
    def active(self) -> bool:
        """Whether somebody decides for it."""
        return self.state is SeatState.PRESENT or self.controller is Controller.STAND_IN

    def decided(self, state: State) -> bool:
        """Whether a step need not wait for it (any more)."""
        return self.pending is not None or not self.active or state.busy_steps(self.player) > 0

    def take(self, name: str, kind: str, session: str, participant: str, ran: float) -> None:
        """A newcomer sits down.

        Args:
            ran: Seconds for which the game has run, here and in what follows.

        Raises:
            IllegalEventError: The seat is taken.
        """
        self.state = next_seat_state(self.state, SeatEvent.TAKE)
        self.name, self.kind = name, kind
        self.session, self.participant, self.generation = session, participant, 0
        self.quota.renew()
        self.ready = True
        self.asked_at = ran
        self.seq, self.pending, self.answer = 0, None, ActionAnswer(0, 0)

    def lose_connection(self, ran: float) -> None:
        """Its participant is away.

        Raises:
            IllegalEventError: The seat is free, or its participant is away already.
        """
        self.state = next_seat_state(self.state, SeatEvent.LOSE)
        self.left_at = ran

    def come_back(self, ran: float) -> None:
        """Its participant is here again; where the game has run meanwhile, it is asked anew.

        Raises:
            IllegalEventError: The seat is free.
        """
        if not self.present and ran > self.left_at:
            self.asked_at = ran
        self.state = next_seat_state(self.state, SeatEvent.RETURN)

    def set_present(self, present: bool, now: float, ran: float) -> None:
        """Its participant is here (again), or away; what a stand-in was about to do is dropped.

        Raises:
            IllegalEventError: The seat is free.
        """
        if self.present != present:
            self.away = now
        if self.pending is not None and self.pending.seq == 0:
            self.pending = None
        if present:
            self.come_back(ran)
        elif self.present:
            self.lose_connection(ran)

    def vacate(self, ran: float) -> None:
        """Nobody's seat any more.

        Raises:
            IllegalEventError: It is free already.
        """
        if self.present:
            self.left_at = ran
        self.state = next_seat_state(self.state, SeatEvent.VACATE)
        self.refused, self.ready = False, True
        self.name = self.kind = self.session = self.participant = ""
        self.generation = 0
        self.pending = None

    def roster_change(self, time: float, why: Departure | None = None) -> RosterChanged:
        """How it is now, as an event.

        Args:
            time: Seconds since the game began.
            why: Why it has become free, if it just has.
        """
        return RosterChanged(
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
        )

    def thought(self, ran: float) -> float:
        """Seconds for which whoever moves it could have acted, and has not."""
        since = self.asked_at if self.present else max(self.asked_at, self.left_at)
        return max(0.0, ran - since)

    def count_rejection(self, kind: RejectionKind, *, recorded: bool = True) -> None:
        """One more of its actions was taken into no step. What is not recorded makes no step one
        in which it waited: nobody could tell from the recording."""
        self.refused |= recorded and kind is not RejectionKind.SUPERSEDED
        self.tally.rejected += 1
        self.tally.invalid += kind is RejectionKind.INVALID
        self.tally.malformed += kind is RejectionKind.MALFORMED

    def take_pending(self, step: int) -> PendingAction | None:
        """What it has decided on for the step after `step`, which is its answer; None: nothing."""
        pending = self.pending
        if pending is None or pending.due_step > step:
            return None
        self.pending = None
        if pending.seq > 0:
            self.answer = ActionAnswer(pending.seq, step + 1)
        return pending


class HeldActions:
    """Actions that have come and do not count yet. Times are in seconds, as the episode's."""

    __slots__ = ("_held", "_order")

    def __init__(self) -> None:
        self._held: list[tuple[float, int, str, Callable[[float], None]]] = []
        self._order = count()

    def hold(self, player: str, until: float, take: Callable[[float], None]) -> None:
        """Keep an action of a player; `take` is called with the time when it counts."""
        heapq.heappush(self._held, (until, next(self._order), player, take))

    def due(self) -> float | None:
        """When the next one counts."""
        return self._held[0][0] if self._held else None

    def release(self, now: float) -> None:
        """Let those count whose time has come, in its order."""
        while self._held and self._held[0][0] <= now:
            heapq.heappop(self._held)[3](now)

    def drop(self, player: str) -> None:
        """Forget those of a player who has left."""
        self._held = [held for held in self._held if held[2] != player]
        heapq.heapify(self._held)

    def clear(self) -> None:
        """Forget all: the game is over."""
        self._held.clear()


def by_holder(seats: Iterable[Seat]) -> list[list[str]]:
    """The players of some seats, those of one participant together."""
    players: dict[str, list[str]] = {}
    for seat in seats:
        players.setdefault(seat.session or seat.player, []).append(seat.player)
    return list(players.values())


def names_of(seats: Iterable[Seat]) -> str:
    """Who plays some seats, in words; a free one has only its player's name."""
    return " and ".join(dict.fromkeys(seat.name or seat.player for seat in seats))


def joint_action(
    seats: Collection[Seat], state: State, step: int, *, by_arrival: bool
) -> tuple[tuple[Move, ...], tuple[tuple[str, int], ...]]:
    """What all seats do in the step after `step`: their moves, in the order in which they decided
    or else in seat order, those that anticipate after those that make them possible; and the
    decisions to do nothing, with their sequence numbers."""
    idle = []
    ready = []
    anticipating = set()
    for seat in seats:
        pending = seat.take_pending(step)
        if pending is None:
            continue
        action = pending.action
        if action is not None:
            told = pending.seq, pending.latency, pending.reasoning, pending.basis
            move = Move(seat.player, action, *told)
            ready.append((pending.order, move))
            if pending.anticipates:
                anticipating.add(seat.player)
        elif pending.seq > 0:
            idle.append((seat.player, pending.seq))
    if by_arrival and len(ready) > 1:
        ready.sort(key=lambda pair: pair[0])
    moves = [move for _, move in ready]
    return tuple(_arranged(state, moves, anticipating) if anticipating else moves), tuple(idle)


def who_waits(seats: Iterable[Seat], step: int) -> tuple[str, ...]:
    """The players that have decided to wait in the step after `step`."""
    return tuple(
        seat.player
        for seat in seats
        if seat.pending is not None and seat.pending.waits and seat.pending.due_step <= step
    )


def _arranged(state: State, moves: list[Move], anticipating: Collection[str]) -> list[Move]:
    """The moves, each that anticipates as soon as it is possible after others; else last."""
    arranged = [move for move in moves if move.player not in anticipating]
    late = [move for move in moves if move.player in anticipating]
    while late:
        move = next((m for m in late if _applies(state, [*arranged, m])), late[0])
        late.remove(move)
        arranged.append(move)
    return arranged


def _applies(state: State, moves: Collection[Move]) -> bool:
    """Whether the last of some moves would be applied."""
    return state.step([move.action for move in moves]).attempts[-1].applied


def count_step(
    seats: Iterable[Seat],
    busy: Collection[str],
    moves: Sequence[Move],
    attempts: Sequence[Attempt],
    turn: str | None,
    waits: Collection[str] = (),
) -> None:
    """Count what the seats did in a step.

    Args:
        busy: The players who could not act.
        turn: Whose turn it was, with the turn clock.
        waits: The players who said that they wait.
    """
    applied = {move.player: attempts[i].applied for i, move in enumerate(moves)}
    for seat in seats:
        player = seat.player
        others_turn = turn is not None and turn != player
        waiting = seat.refused or player in waits
        told = applied.get(player), player in busy, waiting, others_turn
        seat.tally.count(activity(seat.controller, *told))
        seat.refused = False
