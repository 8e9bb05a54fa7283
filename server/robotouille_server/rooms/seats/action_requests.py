"""Requests to act: what an `act` message asks for, and how it is answered."""

from __future__ import annotations

from functools import partial

from robotouille.episode import Episode
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.broadcast.broadcaster import Broadcaster
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.write_ahead import WriteAhead
from robotouille_server.runtime.metrics import Metrics

__all__ = ["ActionRequests", "in_words", "requested_action"]

RECORDED = ("action/stale", "episode/waiting", "rate/limited")
"""Why a request is not looked at, where that is recorded: its text fits into the seat's quota."""
MAX_UNREADABLE = 300
"""Characters of a message that cannot be read, in the recording."""


class ActionRequests:
    """Submits the actions of one episode's seats, and answers those that cannot be."""

    __slots__ = ("_broadcaster", "_episode", "_metrics", "_write_ahead")

    def __init__(
        self,
        episode: Episode,
        broadcaster: Broadcaster,
        write_ahead: WriteAhead,
        metrics: Metrics,
    ) -> None:
        self._episode = episode
        self._broadcaster = broadcaster
        self._write_ahead = write_ahead
        self._metrics = metrics

    def submit(self, session: Session, request: messages.Act, now: float) -> None:
        """Submit a seat's action; whatever is wrong with it is answered by `rejected`."""
        try:
            self._submit(session, request, now)
        except ProtocolError as error:
            self.refuse(session, request, error, now)

    def refuse(
        self, session: Session, request: messages.Act, why: ProtocolError, now: float
    ) -> None:
        """Reject a request that is not looked at. It is recorded, unless the episode is over, it is
        about another's seat, or no more of its words are recorded: then it is answered at once."""
        self._metrics.errors.labels(why.code).inc()
        if why.code not in RECORDED:
            self._answer(session, request, why)
            return
        try:
            player, seq = session.own_seat(request.seat), request.seq
            self._write_ahead.check()
            basis, reasoning = request.basis, request.reasoning or ""
            words = in_words(request)
            self._episode.refuse(player, seq, words, why, now, basis=basis, reasoning=reasoning)
        except ProtocolError:
            self._answer(session, request, why)

    def record_unreadable(
        self, session: Session, message: bytes | str, why: ProtocolError, now: float
    ) -> None:
        """Record what a player has sent and nobody can read, unless the episode is over. Whoever
        has several seats may have meant any of them."""
        if session.players and not self._episode.ended and not self._write_ahead.failing:
            beginning = message[:MAX_UNREADABLE]
            text = beginning if isinstance(beginning, str) else repr(beginning)[2:-1]
            self._episode.refuse(session.players[0], 0, text[:MAX_UNREADABLE], why, now)

    def _submit(self, session: Session, request: messages.Act, now: float) -> None:
        player = session.own_seat(request.seat)
        if self._write_ahead.failing:
            return  # It is sent again; what is held back must not grow.
        if request.seq == self._episode.seat(player).seq:
            self._answer_again(session, player, request)
            return
        seq, reasoning = request.seq, request.reasoning or ""
        basis = request.basis
        try:
            action = requested_action(self._episode, player, request)
        except ProtocolError as error:
            self._metrics.errors.labels(error.code).inc()
            words = in_words(request)
            self._episode.reject(player, seq, words, error, now, basis=basis, reasoning=reasoning)
        else:
            self._episode.submit(
                player,
                seq,
                action,
                now,
                think_ms=request.think_ms,
                basis=basis,
                reasoning=reasoning,
                anticipates=request.anticipates,
                waits=request.waits,
            )
        session.recorded_bytes += len(reasoning.encode())

    def _answer_again(self, session: Session, player: str, request: messages.Act) -> None:
        """An action that was received before: send what became of it, do nothing."""
        answer = self._episode.seat(player).answer
        if answer.seq != request.seq:
            return
        if not answer.reasons:
            self._broadcaster.ask_snapshot(session)
            return
        rejected = messages.Rejected(
            seq=answer.seq,
            step=answer.step,
            action=in_words(request),
            reasons=list(answer.reasons),
            code=answer.code,
            seat=session.seat_shown(player),
        )
        send = partial(self._broadcaster.send, session, rejected)
        self._write_ahead.when_committed(session, send)

    def _answer(self, session: Session, request: messages.Act, error: ProtocolError) -> None:
        self._metrics.rejected += 1
        rejected = messages.Rejected(
            seq=request.seq,
            step=self._episode.step,
            action=in_words(request),
            reasons=[error.message],
            code=error.code,
            seat=session.seat_shown(request.seat),
        )
        self._broadcaster.send(session, rejected)
        if error.code == "action/stale":
            self._broadcaster.ask_snapshot(session)


def requested_action(
    episode: Episode, player: str, request: messages.Act
) -> GroundAction | str | None:
    """The action, valid at present or not, or the text that says one; None for nothing.

    ProtocolError `action/unknown` if there is no such action, `action/stale` for a position in the
    list of another step.
    """
    requested = request.action
    if requested is None or isinstance(requested, str):
        return requested
    if isinstance(requested, int):
        return _at(episode, player, requested, request.basis)
    try:
        return episode.world.action(requested.name, *requested.args)
    except KeyError as error:
        raise ProtocolError("action/unknown", str(error.args[0]), "action") from None


def _at(episode: Episode, player: str, position: int, basis: int | None) -> GroundAction:
    if basis != episode.step:
        raise ProtocolError("action/stale", _wrong_basis(basis, episode.step), "basis")
    actions = episode.state.actions(player)
    if position >= len(actions):
        message = f"there are {len(actions)} valid actions, found {position}"
        raise ProtocolError("action/unknown", message, "action")
    return actions[position]


def _wrong_basis(basis: int | None, step: int) -> str:
    if basis is None:
        return f"a position needs the step whose list it is in, as 'basis'; it is step {step}"
    when = "is past" if basis < step else "is still to come"
    return f"step {basis} {when}; it is step {step}"


def in_words(request: messages.Act) -> str:
    """The action as it was asked for."""
    requested = request.action
    if isinstance(requested, messages.NamedAction):
        return f"{requested.name}({', '.join(requested.args)})"
    return "nothing" if requested is None else str(requested)
