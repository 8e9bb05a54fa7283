"""Action requests: what an `act` message asks for, and how it is answered."""

from __future__ import annotations

from functools import partial

from robotouille.episode import ActionRequest, Episode
from robotouille.errors import ProtocolError, UnknownNameError
from robotouille.protocol import messages
from robotouille.visible_text import plain_text
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.recording.write_ahead import CommitGate
from robotouille_server.runtime.metrics import Metrics

RECORDED = ("action/stale", "episode/waiting", "rate/limited")
"""Codes of refusals that are recorded, because they are part of how people play. Their text counts
towards the quota of the seat."""
MAX_UNREADABLE = 300
"""Maximum number of characters recorded of an unreadable message."""


class ActionRequests:
    """Submits the actions of an episode's seats, and answers requests that cannot be submitted."""

    __slots__ = ("_broadcaster", "_episode", "_gate", "_metrics")

    def __init__(
        self,
        episode: Episode,
        broadcaster: Broadcaster,
        gate: CommitGate,
        metrics: Metrics,
    ) -> None:
        self._episode = episode
        self._broadcaster = broadcaster
        self._gate = gate
        self._metrics = metrics

    def submit(self, session: Session, request: messages.Act, now: float) -> None:
        """Submit the action of a seat; answer an invalid request by `rejected`."""
        try:
            self._submit(session, request, now)
        except ProtocolError as error:
            self.refuse(session, request, error, now)

    def refuse(
        self, session: Session, request: messages.Act, why: ProtocolError, now: float
    ) -> None:
        """Reject a request without evaluating it.

        The rejection is recorded and published like others. It is answered without a record if
        the episode has ended, the seat is another participant's, or the quota is used up.
        """
        # Every refusal is counted, even if it is not recorded, so the metrics show a client in a
        # loop.
        self._metrics.errors.labels(why.code).inc()
        # All other codes are faults of programs. A faulty client could fill the recording with
        # them.
        if why.code not in RECORDED:
            self._answer(session, request, why)
            return
        try:
            player = session.own_seat(request.seat)
            self._gate.check()
            self._episode.refuse(player, _with_action(request, in_words(request)), why, now)
        except ProtocolError:
            self._answer(session, request, why)

    def record_unreadable(
        self, session: Session, message: bytes | str, why: ProtocolError, now: float
    ) -> None:
        """Record an unreadable message of a player, unless the episode has ended.

        It is recorded for the participant's first seat, because its own seat is unknown.
        """
        if session.players and not self._episode.ended and not self._gate.failing:
            # The beginning shows what a model or program tried to send. The whole message may be 64
            # KiB.
            beginning = message[:MAX_UNREADABLE]
            text = plain_text(beginning) if isinstance(beginning, str) else repr(beginning)[2:-1]
            self._episode.refuse(
                session.players[0], ActionRequest(0, text[:MAX_UNREADABLE]), why, now
            )

    def _submit(self, session: Session, request: messages.Act, now: float) -> None:
        player = session.own_seat(request.seat)
        if self._gate.failing:
            # Events must not pile up while the recording cannot be written. The client repeats the
            # dropped request.
            return
        # A client that lost its connection cannot know whether its action arrived, so it repeats
        # the last one with the same number. Executing it twice would change the game.
        if request.seq == self._episode.seat(player).seq:
            self._answer_again(session, player, request)
            return
        try:
            action = requested_action(self._episode, player, request)
        except ProtocolError as error:
            self._metrics.errors.labels(error.code).inc()
            self._episode.reject(player, _with_action(request, in_words(request)), error, now)
            session.mistakes += 1
        else:
            self._episode.submit(player, _with_action(request, action), now)
            # A delayed seat's answer comes later, but its wrong text has been compared already.
            if self._episode.seat(player).misnamed == request.seq:
                session.mistakes += 1
        # This includes rejected actions, because their reasoning is recorded, too.
        session.recorded_bytes += len((request.reasoning or "").encode())

    def _answer_again(self, session: Session, player: str, request: messages.Act) -> None:
        """Send the result of an action again, because a returning client has repeated it."""
        answer = self._episode.seat(player).answer
        # The action still waits for its step; its answer comes with that step.
        if answer.seq != request.seq:
            return
        if not answer.reasons:
            # The action was applied in a step that the client may have missed. A snapshot shows the
            # result and is bounded, unlike a second copy of the old delta.
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
        self._gate.when_committed(session, send)

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
        # The client has acted on an old state, so it may have missed a delta.
        if error.code == "action/stale":
            self._broadcaster.ask_snapshot(session)


def _with_action(request: messages.Act, action: GroundAction | str | None) -> ActionRequest:
    return ActionRequest(
        request.seq,
        action,
        basis=request.basis,
        reasoning=request.reasoning or "",
        think_ms=request.think_ms,
        anticipates=request.anticipates,
        waits=request.waits,
        max_age=request.max_age,
    )


def requested_action(
    episode: Episode, player: str, request: messages.Act
) -> GroundAction | str | None:
    """Return the requested action, valid or not, or its text; None for nothing.

    Raises:
        ProtocolError: `action/unknown` if the action does not exist, `action/stale` for an index
            into the list of another step.
    """
    requested = request.action
    if requested is None:
        return None
    if isinstance(requested, str):
        return _visible(episode, player, requested)
    if isinstance(requested, int):
        return _at(episode, player, requested, request.basis)
    try:
        return episode.world.action(requested.name, *requested.args)
    except KeyError as error:
        raise ProtocolError("action/unknown", str(error.args[0]), "action") from None


def _visible(episode: Episode, player: str, text: str) -> GroundAction | str:
    """Return a text without invisible characters, or the action that it names with them."""
    shown = plain_text(text)
    if shown == text:
        return text
    # Sentences in scripts from right to left may have direction marks next to names.
    try:
        named = episode.world.find_named(text, episode.offered_actions(player))
    except UnknownNameError:
        named = None
    return named or shown


def _at(episode: Episode, player: str, index: int, basis: int | None) -> GroundAction:
    # An index is valid in one state only. In a later list it would name an action that nobody
    # chose.
    if basis != episode.step:
        raise ProtocolError("action/stale", _wrong_basis(basis, episode.step), "basis")
    actions = episode.offered_actions(player)
    if index >= len(actions):
        message = f"there are {len(actions)} valid actions; no action has index {index}"
        raise ProtocolError("action/unknown", message, "action")
    return actions[index]


def _wrong_basis(basis: int | None, step: int) -> str:
    if basis is None:
        return f"an index needs 'basis', the step of the list; the current step is {step}"
    when = "has passed" if basis < step else "has not begun"
    return f"step {basis} {when}; the current step is {step}"


def in_words(request: messages.Act) -> str:
    """Return the requested action as text."""
    requested = request.action
    if isinstance(requested, messages.NamedAction):
        return plain_text(f"{requested.name}({', '.join(requested.args)})")
    return "nothing" if requested is None else plain_text(str(requested))
