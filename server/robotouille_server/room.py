"""A room: one episode, those who play and watch it, its timer and its recording."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from robotouille.episode import (
    Answer,
    Ended,
    Episode,
    Event,
    Phase,
    Rejected,
    RosterChanged,
    Said,
    Started,
    Stepped,
)
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import Codec
from robotouille.replay.recorder import HASH_EVERY, Recorder
from robotouille.world.actions import GroundAction
from robotouille.world.state import State
from robotouille_server.files import RecordingFile
from robotouille_server.logs import get_logger
from robotouille_server.metrics import Metrics
from robotouille_server.session import Session

__all__ = ["Room"]


class Room:
    """Feeds an episode with messages and time, and tells everybody in it what happened."""

    def __init__(
        self,
        episode_id: str,
        code: str,
        episode: Episode,
        *,
        recorder: Recorder,
        file: RecordingFile | None,
        metrics: Metrics,
        on_close: Callable[[Room], None],
    ) -> None:
        self.id = episode_id
        self.code = code
        self.episode = episode
        self.world = episode.world
        self.members: list[Session] = []
        self.closed = asyncio.Event()
        self._writer = recorder.writer
        self._recorder = recorder
        self._file = file
        self._metrics = metrics
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._seat_number = {player: i for i, player in enumerate(self.world.players)}
        self._on_close = on_close
        self._schedule()

    # Coming and going

    def enter(self, session: Session, request: messages.Join, max_spectators: int) -> None:
        """Take a seat or watch; the session gets `joined` and a first picture."""
        self.flush()
        self._begin_recording()
        if request.role == "player":
            player = request.seat
            session.player = self.episode.join(player, session.name, session.kind, self._now())
        elif self.spectators >= max_spectators:
            message = f"{max_spectators} spectators watch already"
            raise ProtocolError("episode/full", message, "role")
        else:
            session.player = None
        session.room = self
        session.view = request.view
        session.known = set(request.known)
        self.flush()
        self.members.append(session)
        self.welcome(session, request.ref)
        if session.player is None:
            self._send_all(self.roster())
        else:
            self._send(session, self.roster())

    def _begin_recording(self) -> None:
        """Open the file when the first participant comes; ProtocolError where it cannot be."""
        if self._file is None or self._file.begun:
            return
        try:
            self._file.open()
        except OSError as error:
            message = f"the episode cannot be recorded: {error.strerror}"
            get_logger().error("recording not begun", file=str(self._file.path), error=str(error))
            raise ProtocolError("server/recording", message) from None
        self._file.append(self._recorder.begin())

    def welcome(self, session: Session, ref: int | None) -> None:
        """`joined` and a first picture, at the first visit or after a lost connection."""
        if session.peer is None:
            return
        role = "player" if session.player else "spectator"
        joined = messages.Joined(
            ref=ref, episode=self.id, code=self.code, role=role, seat=session.player,
            seq=self._seq(session),
        )  # fmt: skip
        session.peer.send(joined)
        self.send_picture(session)

    def leave(self, session: Session) -> None:
        """Leave for good."""
        if session in self.members:
            self.members.remove(session)
        player = session.player
        session.room = session.player = None
        if player is not None:
            self.episode.leave(player, self._now())
        else:
            self._send_all(self.roster())
        self.flush()

    def connection_lost(self, session: Session) -> None:
        if session.player is not None:
            self.episode.set_present(session.player, False, self._now())
        self.flush()

    def connection_back(self, session: Session) -> None:
        if session.player is not None:
            self.episode.set_present(session.player, True, self._now())
        self.flush()

    def dismiss(self) -> None:
        """Tell those who are still here that the room is closed."""
        for session in self.members:
            session.room = session.player = None
            self._send(session, messages.Left(episode=self.id, reason="the episode is over"))
        self.members.clear()

    @property
    def spectators(self) -> int:
        return sum(session.player is None for session in self.members)

    # Playing

    def act(self, session: Session, request: messages.Act) -> None:
        """Submit a seat's action; whatever is wrong with it is answered by `rejected`."""
        try:
            if session.player is None:
                raise ProtocolError("seat/none", "spectators do not act", "type")
            if request.seq == self.episode.seat(session.player).seq:
                self._answer_again(session, request)
                return
            action = self._action(session.player, request)
            self.episode.submit(
                session.player,
                request.seq,
                action,
                self._now(),
                think_ms=request.think_ms,
                reasoning=request.reasoning or "",
            )
        except ProtocolError as error:
            self._refuse(session, request, error)
        self.flush()

    def _answer_again(self, session: Session, request: messages.Act) -> None:
        """An action that was heard before: say what became of it, do nothing."""
        answer = self._answer(session)
        if answer.seq == request.seq and answer.reasons:
            rejected = messages.Rejected(
                seq=answer.seq,
                step=answer.step,
                action=_said_action(request),
                reasons=list(answer.reasons),
            )
            self._send(session, rejected)
        elif answer.seq == request.seq:
            self.send_picture(session)

    def _action(self, player: str, request: messages.Act) -> GroundAction | None:
        wanted = request.action
        state = self.episode.state
        if wanted is None:
            return None
        if isinstance(wanted, int):
            if request.basis != self.episode.step:
                message = f"step {request.basis} is past; it is step {self.episode.step}"
                raise ProtocolError("action/stale", message, "basis")
            actions = state.actions(player)
            if wanted >= len(actions):
                message = f"there are {len(actions)} valid actions, found {wanted}"
                raise ProtocolError("action/unknown", message, "action")
            return actions[wanted]
        try:
            if isinstance(wanted, str):
                return self.world.parse(state, player, wanted)
            return self.world.action(wanted.name, *wanted.args)
        except KeyError as error:
            raise ProtocolError("action/unknown", str(error.args[0]), "action") from None

    def _refuse(self, session: Session, request: messages.Act, error: ProtocolError) -> None:
        self._metrics.errors.labels(error.code).inc()
        self._metrics.rejected.inc()
        rejected = messages.Rejected(
            seq=request.seq,
            step=self.episode.step,
            action=_said_action(request),
            reasons=[error.message],
            code=error.code,
        )
        self._send(session, rejected)
        if error.code == "action/stale":
            self.send_picture(session)

    def say(self, session: Session, text: str) -> None:
        self.episode.say(session.name, session.player or "", text, self._now())
        self.flush()

    def abort(self, reason: str) -> None:
        """End the episode, because the server stops or an operator says so."""
        self.episode.abort(self._now(), reason)
        self.flush()

    # Time

    def _now(self) -> float:
        return self._loop.time()

    def _schedule(self) -> None:
        due = self.episode.due()
        if self._timer is not None:
            if due == self._timer.when():
                return
            self._timer.cancel()
        self._timer = None if due is None else self._loop.call_at(due, self._on_time, due)

    def _on_time(self, due: float) -> None:
        self._timer = None
        now = self._now()
        if self.episode.rules.scheduled and self.episode.phase is Phase.RUNNING:
            self._metrics.lateness.observe(max(0.0, now - due))
        try:
            self.episode.tick(max(now, due))
            self.flush()
        except Exception:
            get_logger().exception("the episode failed", episode=self.id)
            self.abort("internal error")

    # Telling

    def flush(self) -> None:
        """Record what has happened, then tell it."""
        events = self.episode.events()
        if events:
            if self._file is not None:
                self._file.append(self._recorder.record(events))
            for event in events:
                self._tell(event)
        if self.episode.phase is Phase.OVER:
            self._close()
        else:
            self._schedule()

    def _tell(self, event: Event) -> None:
        match event:
            case Stepped():
                self._tell_step(event)
            case Rejected():
                self._metrics.rejected.inc()
                self._tell_rejection(event)
            case Said():
                said = messages.Said(
                    step=self.episode.step, name=event.name, seat=event.player, text=event.text
                )
                self._send_all(said)
            case Started() | RosterChanged():
                self._send_all(self.roster())
            case Ended():
                self._metrics.outcomes.labels(event.outcome.reason.value).inc()
                ended = messages.Ended(
                    step=self.episode.step,
                    outcome=event.outcome.to_json(),
                    hash=self.episode.state.digest,
                )
                self._send_all(ended)

    def _tell_step(self, event: Stepped) -> None:
        self._metrics.steps.inc()
        applied = sum(attempt.applied for attempt in event.attempts)
        self._metrics.applied.inc(applied)
        self._metrics.rejected.inc(len(event.attempts) - applied)
        delta = self._delta(event)
        payloads: dict[Codec, bytes | str] = {}
        texts: dict[str | None, messages.Observation] = {}
        for session in self.members:
            peer = session.peer
            if peer is None or not peer.keeps_up(partial(self.send_picture, session)):
                continue
            if session.wants_state:
                payload = payloads.get(peer.codec)
                if payload is None:
                    payload = payloads[peer.codec] = peer.codec.pack(delta)
                peer.send_payload(payload)
            if session.wants_text:
                self._tell_reader(session, event, texts)

    def _tell_reader(
        self,
        session: Session,
        event: Stepped,
        texts: dict[str | None, messages.Observation],
    ) -> None:
        """Whoever has only words is told what became of its own action, then what it sees."""
        for move, attempt in zip(event.moves, event.attempts, strict=True):
            if move.player == session.player and not attempt.applied and not session.wants_state:
                rejected = messages.Rejected(
                    seq=move.seq,
                    step=event.step,
                    action=move.action.sentence,
                    reasons=list(attempt.unmet),
                )
                self._send(session, rejected)
        player = session.player
        if player not in texts:
            phase = "running" if event.step < self.episode.step else self.episode.phase.value
            texts[player] = self._observation(player, event.state, event.step, event.turn, phase)
        self._send(session, texts[player])

    def _send(self, session: Session, message: messages.Message) -> None:
        if session.peer is not None:
            session.peer.send(message)

    def _delta(self, event: Stepped) -> dict[str, Any]:
        """The fields of a `delta` message, as plain values: it is made for every step."""
        delta: dict[str, Any] = {"type": "delta", "step": event.step}
        delta |= self._writer.changes(event.before, event.state)
        if event.moves:
            delta["did"] = [
                [self._seat_number[m.player], m.action.name, *m.action.arguments]
                for m in event.moves
            ]
            delta["seq"] = [move.seq for move in event.moves]
        unmet = {
            str(i): list(attempt.unmet)
            for i, attempt in enumerate(event.attempts)
            if not attempt.applied
        }
        if unmet:
            delta["unmet"] = unmet
        if event.turn is not None:
            delta["turn"] = event.turn
        if event.step % HASH_EVERY == 0:
            delta["hash"] = event.state.digest
        return delta

    def _tell_rejection(self, event: Rejected) -> None:
        rejected = messages.Rejected(
            seq=event.seq,
            step=self.episode.step,
            action=event.action,
            reasons=list(event.reasons),
        )
        for session in self.members:
            if session.player == event.player and session.peer is not None:
                session.peer.send(rejected)

    def send_picture(self, session: Session) -> None:
        """The whole state, as a snapshot or in words or both."""
        if session.peer is None:
            return
        if session.wants_state:
            session.peer.send(self._snapshot(session))
        if session.wants_text:
            episode = self.episode
            observation = self._observation(
                session.player, episode.state, episode.step, episode.on_turn, episode.phase.value
            )
            self._send(session, observation)

    def _snapshot(self, session: Session) -> messages.Snapshot:
        episode, state = self.episode, self.episode.state
        task = self.world.task
        due = episode.due()
        answer = self._answer(session)
        known = task.digest in session.known
        session.known.add(task.digest)
        return messages.Snapshot(
            episode=self.id,
            step=episode.step,
            phase=episode.phase.value,
            digest=task.digest,
            task=None if known else task.to_json(),
            hash=state.digest,
            seat=session.player,
            seq=self._seq(session),
            last_seq=answer.seq,
            last_step=answer.step,
            last_reasons=list(answer.reasons),
            turn=episode.on_turn,
            clock=episode.rules.model_dump(mode="json"),
            left=None if due is None else max(0.0, due - self._now()),
            seats=self._seats(),
            spectators=self.spectators,
            outcome=episode.outcome.to_json() if episode.outcome else None,
            **self._writer.tables(state),
            **self._writer.values(state),
        )

    def _observation(
        self, player: str | None, state: State, step: int, turn: str | None, phase: str
    ) -> messages.Observation:
        return messages.Observation(
            episode=self.id,
            step=step,
            phase=phase,
            seat=player,
            text=state.text(player),
            actions=[a.sentence for a in state.actions(player)] if player else [],
            turn=turn,
            seq=self.episode.seats[player].answer.seq if player else 0,
        )

    def _seq(self, session: Session) -> int:
        return self.episode.seats[session.player].seq if session.player else 0

    def _answer(self, session: Session) -> Answer:
        return self.episode.seats[session.player].answer if session.player else Answer(0, 0)

    def _seats(self) -> list[messages.SeatInfo]:
        return [
            messages.SeatInfo(
                player=seat.player,
                name=seat.name,
                kind=seat.kind,
                present=seat.present,
                applied=seat.tally.applied,
                rejected=seat.tally.rejected,
            )
            for seat in self.episode.seats.values()
        ]

    def roster(self) -> messages.Roster:
        return messages.Roster(
            phase=self.episode.phase.value,
            turn=self.episode.on_turn,
            seats=self._seats(),
            spectators=self.spectators,
        )

    def info(self) -> messages.EpisodeInfo:
        """What the lobby lists."""
        rules = self.episode.rules
        return messages.EpisodeInfo(
            episode=self.id,
            code=self.code,
            task=self.world.task.name,
            clock=rules.clock.value,
            phase=self.episode.phase.value,
            step=self.episode.step,
            max_steps=rules.max_steps,
            seats=self._seats(),
            spectators=self.spectators,
        )

    def _send_all(self, message: Any) -> None:
        payloads: dict[Codec, bytes | str] = {}
        for peer in self._peers():
            payload = payloads.get(peer.codec)
            if payload is None:
                payload = payloads[peer.codec] = peer.codec.encode(message)
            peer.send_payload(payload)

    def _peers(self) -> Iterable[Any]:
        return [session.peer for session in self.members if session.peer is not None]

    def _close(self) -> None:
        if self.closed.is_set():
            return
        self.closed.set()
        self._on_close(self)
        if self._timer is not None:
            self._timer.cancel()
        path = self._file.close() if self._file is not None else None
        outcome = self.episode.outcome
        get_logger().info(
            "episode over",
            episode=self.id,
            task=self.world.task.name,
            reason=outcome.reason.value if outcome else "",
            steps=self.episode.step,
            recording=str(path) if path else None,
        )


def _said_action(request: messages.Act) -> str:
    wanted = request.action
    if isinstance(wanted, messages.NamedAction):
        return f"{wanted.name}({', '.join(wanted.args)})"
    return "nothing" if wanted is None else str(wanted)
