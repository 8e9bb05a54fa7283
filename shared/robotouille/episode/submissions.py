"""Requests to act: checked on arrival, held back if a study delays them, and joined into a step."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from itertools import count
from typing import NamedTuple

from robotouille.episode.events import (
    ACTION_INVALID,
    ACTION_STALE,
    ACTION_UNKNOWN,
    ActionRejected,
    PlayedMove,
    QuotaReached,
)
from robotouille.episode.lifecycle import Controller
from robotouille.episode.quota import size_of_rejection
from robotouille.episode.record import EpisodeRecord
from robotouille.episode.seats import ActionAnswer, ActionRequest, PendingAction, Seat
from robotouille.errors import ProtocolError, UnknownNameError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import Unmet, UnmetKind, only_words, texts_of
from robotouille.world.world import State

MAX_HELD_REQUESTS = 64
"""Requests of a delayed seat that may wait. All of them can be due at the same time."""
SUBSTITUTED = ActionRequest(seq=0)
"""Request behind a substitute's decision. Number 0 shows that the participant did not make it."""


class RejectionReasons(NamedTuple):
    """Reasons for which a request is rejected, and the code of the rejection."""

    unmet: tuple[Unmet, ...]
    code: str = ACTION_INVALID


KINDS = {ACTION_STALE: UnmetKind.STALE, ACTION_UNKNOWN: UnmetKind.UNKNOWN}
"""Kinds of reasons that only have words, by the code of the rejection."""


def _in_words(code: str, message: str) -> RejectionReasons:
    return RejectionReasons(only_words(message, kind=KINDS.get(code, UnmetKind.OTHER)), code)


class HeldRequest(NamedTuple):
    """Request of a delayed seat.

    Attributes:
        due: The time at which the request is evaluated.
        order: Number of the request among all held ones.
        fault: The reason for which the request is rejected when it is due, if that is certain.
        misnamed: The reason if its text still names no action when it is due.
    """

    due: float
    order: int
    seat: Seat
    request: ActionRequest
    fault: RejectionReasons | None
    misnamed: RejectionReasons


class StepDecisions(NamedTuple):
    """The seats' decisions for one step: moves in order, and who does nothing or waits."""

    moves: tuple[PlayedMove, ...]
    idle: tuple[tuple[str, int], ...]
    waits: tuple[str, ...] = ()


class Submissions:
    """Turns the requests of an episode's seats into pending decisions or rejections.

    Methods that return a boolean return True if a seat has decided. The caller then takes the
    steps that no longer wait for any seat.
    """

    __slots__ = ("_arrivals", "_held", "_order", "_record")

    def __init__(self, record: EpisodeRecord) -> None:
        self._record = record
        self._arrivals = 0
        # A heap: seats may have different delays, so requests do not fall due in arrival order.
        self._held: list[HeldRequest] = []
        self._order = count()

    def submit(self, player: str, request: ActionRequest, now: float) -> bool:
        """Accept or reject an action; see `Episode.submit`."""
        return self._receive(self._record.seat(player), request, None, now)

    def reject(self, player: str, request: ActionRequest, why: ProtocolError, now: float) -> None:
        """Reject a request whose action could not be read; see `Episode.reject`."""
        fault = _in_words(why.code, why.message)
        self._receive(self._record.seat(player), request, fault, now)

    def refuse(self, player: str, request: ActionRequest, why: ProtocolError, now: float) -> None:
        """Record a request that is not evaluated; see `Episode.refuse`."""
        self._record.check_open()
        seat, unmet = self._record.seat(player), _in_words(why.code, why.message).unmet
        sentence = _sentence(request.action)
        event = ActionRejected(
            player,
            request.seq,
            sentence,
            unmet,
            self._record.elapsed(now),
            request.reasoning,
            code=why.code,
            basis=self._known(request).basis,
            heard=False,
        )
        # Other requests pay for their reasoning in `_receive`, which this one skips.
        size = size_of_rejection((sentence, *texts_of(unmet))) + len(request.reasoning.encode())
        self._report(seat, event, size)

    def substitute(self, player: str, action: GroundAction | None, now: float) -> bool:
        """Accept a substitute's action; see `Episode.substitute`."""
        seat = self._record.seat(player)
        if not (self._record.in_progress and seat.controller is Controller.SUBSTITUTE):
            return False
        # An invalid action becomes "nothing": there is no participant who could try again.
        # Substitutes see the whole state.
        if action is not None and not self._record.world.applicable(self._record.state, action):
            action = None
        self._decide(seat, None if self._faults(seat, action) else action, SUBSTITUTED, now)
        return True

    # Held requests

    def due(self) -> float | None:
        """Return the time at which the next held request is due."""
        return self._held[0].due if self._held else None

    def release(self, now: float) -> Iterator[None]:
        """Evaluate the held requests whose time has come; yield after each decision."""
        while self._held and self._held[0].due <= now:
            if self._evaluate_held(heapq.heappop(self._held), now):
                yield

    def drop(self, player: str) -> None:
        """Forget the held requests of a player whose participant has left."""
        self._held = [held for held in self._held if held.seat.player != player]
        heapq.heapify(self._held)

    def clear(self) -> None:
        """Forget all held requests."""
        self._held.clear()

    # Evaluation

    def _receive(
        self, seat: Seat, request: ActionRequest, fault: RejectionReasons | None, now: float
    ) -> bool:
        record = self._record
        record.check_started()
        if request.seq < seat.seq:
            message = f"action {request.seq} is older than {seat.seq}; ask for a snapshot"
            raise ProtocolError("action/stale", message, "seq")
        if request.seq == seat.seq and request.seq > 0:
            return False  # Sent again after a reconnection; `Seat.answer` has its result.
        if seat.treatment.delay_ms and self._held_of(seat) >= MAX_HELD_REQUESTS:
            text = f"{MAX_HELD_REQUESTS} actions of this seat wait already; send fewer"
            raise ProtocolError("rate/limited", text)
        if request.reasoning:
            size = len(request.reasoning.encode())
            record.take_quota(seat.quota, size, seat.player, now, "act without")
        # From here on the number is used, even if the action is rejected: a client that repeats it
        # after a reconnection must get the same result.
        seat.seq = request.seq
        request = self._known(request)
        if delay := seat.treatment.delay_ms:
            self._hold(seat, request, fault, now + delay / 1000)
            return False
        return self._evaluate(seat, request, fault, now)

    def _held_of(self, seat: Seat) -> int:
        return sum(held.seat is seat for held in self._held)

    def _hold(
        self, seat: Seat, request: ActionRequest, fault: RejectionReasons | None, due: float
    ) -> None:
        misnamed = _in_words(ACTION_UNKNOWN, "the action was valid only before the delay")
        # Suggestions for a wrong text take a millisecond. They are found now, when the participant
        # is charged for the message: all held requests may be due in the same moment.
        if fault is None and isinstance(request.action, str):
            try:
                self._named(seat, request.action)
            except UnknownNameError as error:
                misnamed = _in_words(ACTION_UNKNOWN, str(error))
                seat.misnamed = request.seq
        held = HeldRequest(due, next(self._order), seat, request, fault, misnamed)
        heapq.heappush(self._held, held)

    def _known(self, request: ActionRequest) -> ActionRequest:
        # A basis ahead of the game would make the recorded staleness negative.
        if request.basis is None or 0 <= request.basis <= self._record.step:
            return request
        return request._replace(basis=None)

    def _evaluate(
        self, seat: Seat, request: ActionRequest, fault: RejectionReasons | None, now: float
    ) -> bool:
        action = request.action
        fault = fault or self._outdated(request)
        if fault is None and isinstance(action, str):
            try:
                action = self._named(seat, action)
            except UnknownNameError as error:
                fault = _in_words(ACTION_UNKNOWN, str(error))
                seat.misnamed = request.seq
        return self._judge(seat, request, action, fault, now)

    def _evaluate_held(self, held: HeldRequest, now: float) -> bool:
        request, seat = held.request, held.seat
        action = request.action
        fault = held.fault or self._outdated(request)
        if fault is None and isinstance(action, str):
            # An ambiguous text may name one action in the state after the delay.
            record = self._record
            try:
                found = record.world.find_named(action, record.offered_actions(seat.player))
            except UnknownNameError as error:
                fault = _in_words(ACTION_UNKNOWN, str(error))
            else:
                action = found or action
                fault = held.misnamed if found is None else None
        return self._judge(seat, request, action, fault, now)

    def _named(self, seat: Seat, text: str) -> GroundAction:
        return self._record.world.named(text, self._record.offered_actions(seat.player))

    def _judge(
        self,
        seat: Seat,
        request: ActionRequest,
        action: GroundAction | str | None,
        fault: RejectionReasons | None,
        now: float,
    ) -> bool:
        if fault is None and not isinstance(action, str):
            unmet = self._faults(seat, action, anticipates=request.anticipates)
            if not unmet:
                self._supersede(seat, request.seq, now)
                self._decide(seat, action, request, now)
                return True
            fault = RejectionReasons(unmet)
        if fault is not None:
            self._reject(seat, request, _sentence(action), fault, now)
        return False

    def _outdated(self, request: ActionRequest) -> RejectionReasons | None:
        """Return the fault of a request that is older than it allows, if it is."""
        allowed, basis = request.max_age, request.basis
        if allowed is None:
            return None
        if basis is None:
            words = f"max_age needs 'basis', a step up to the current step {self._record.step}"
            return _in_words(ACTION_STALE, words)
        # Declared thinking counts: the action is tried when it is over.
        age = self._record.step + self._record.clock.delay(request.think_ms) - basis
        if age <= allowed:
            return None
        words = f"the action is {age} steps old, and at most {allowed} are allowed"
        return _in_words(ACTION_STALE, words)

    def _faults(
        self, seat: Seat, action: GroundAction | None, *, anticipates: bool = False
    ) -> tuple[Unmet, ...]:
        record = self._record
        turn = record.on_turn
        if turn is not None and turn != seat.player:
            return (Unmet(UnmetKind.TURN, f"it is {turn}'s turn", objects=(turn,)),)
        if action is None:
            return ()
        if action.player is not None and action.player != seat.player:
            words = f"{action.player} is not yours to move: you play {seat.player}"
            return (Unmet(UnmetKind.SEAT, words, objects=(action.player,)),)
        return () if anticipates else record.unmet(seat.player, action)

    def _supersede(self, seat: Seat, seq: int, now: float) -> None:
        """Reject the seat's pending action, which the action `seq` replaces."""
        pending = seat.pending
        if pending is not None and pending.request.seq > 0:
            superseded = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {seq}")
            sentence = _sentence(pending.action)
            request = pending.request._replace(action=sentence)
            self._reject(seat, request, sentence, RejectionReasons((superseded,)), now)

    def _decide(
        self, seat: Seat, action: GroundAction | None, request: ActionRequest, now: float
    ) -> None:
        record = self._record
        self._arrivals += 1
        due = record.step + record.clock.delay(request.think_ms)
        latency = seat.thought(record.ran(now))
        seat.pending = PendingAction(action, request, latency, self._arrivals, due)

    def _reject(
        self, seat: Seat, request: ActionRequest, sentence: str, fault: RejectionReasons, now: float
    ) -> None:
        asked = request.action
        text = asked if isinstance(asked, str) and asked != sentence else ""
        event = ActionRejected(
            seat.player,
            request.seq,
            sentence,
            fault.unmet,
            self._record.elapsed(now),
            request.reasoning,
            code=fault.code,
            text=text,
            basis=request.basis,
        )
        seat.answer = ActionAnswer(request.seq, self._record.step, event.reasons, fault.code)
        self._report(seat, event, size_of_rejection((sentence, text, *texts_of(fault.unmet))))

    def _report(self, seat: Seat, event: ActionRejected, size: int) -> None:
        """Count and report a rejection, which is recorded if the seat's quota has room for it."""
        reached = seat.quota.reached
        recorded = seat.quota.take(size)
        seat.count_rejection(event.kind, recorded=recorded)
        if seat.quota.reached and not reached:
            self._record.emit(QuotaReached(seat.player, event.time))
        self._record.emit(event if recorded else replace(event, recorded=False))


def _sentence(action: GroundAction | str | None) -> str:
    if action is None:
        return "nothing"
    return action if isinstance(action, str) else action.sentence


def joint_action(
    seats: Iterable[Seat], state: State, step: int, *, by_arrival: bool
) -> StepDecisions:
    """Remove the seats' decisions for the step after `step` and join them.

    Moves are in seat order, or in the order of their arrival. Moves that anticipate another move
    come after it.
    """
    idle, waits, ready, anticipating = [], [], [], set()
    for seat in seats:
        pending = seat.take_pending(step)
        if pending is None:
            continue
        action, request = pending.action, pending.request
        if action is not None:
            move = PlayedMove(
                seat.player, action, request.seq, pending.latency, request.reasoning, request.basis
            )
            ready.append((pending.order, move))
            if request.anticipates:
                anticipating.add(seat.player)
            continue
        if request.seq > 0:
            idle.append((seat.player, request.seq))
        if request.waits:
            waits.append(seat.player)
    # In lockstep moves stay in seat order: the fastest seat must not win every conflict.
    if by_arrival and len(ready) > 1:
        ready.sort(key=lambda pair: pair[0])
    moves = [move for _, move in ready]
    if anticipating:
        moves = _arranged(state, moves, anticipating)
    return StepDecisions(tuple(moves), tuple(idle), tuple(waits))


def _arranged(
    state: State, moves: list[PlayedMove], anticipating: Collection[str]
) -> list[PlayedMove]:
    """Return the moves with the anticipating ones last, starting with those that apply."""
    arranged = [move for move in moves if move.player not in anticipating]
    late = [move for move in moves if move.player in anticipating]
    while late:
        move = next((m for m in late if _applies(state, [*arranged, m])), late[0])
        late.remove(move)
        arranged.append(move)
    return arranged


def _applies(state: State, moves: Collection[PlayedMove]) -> bool:
    """Return whether the last of some moves would be applied."""
    return state.step([move.action for move in moves]).attempts[-1].applied
