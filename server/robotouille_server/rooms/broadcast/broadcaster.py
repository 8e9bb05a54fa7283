"""Those who play and watch an episode, and what is sent to them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from itertools import islice
from typing import Any

import msgpack
from pydantic import BaseModel

from robotouille.episode import (
    Episode,
    Outcome,
    PauseReason,
    Phase,
    QuotaReached,
    Rejected,
    Said,
    Stepped,
)
from robotouille.protocol import messages
from robotouille.protocol.codec import MSGPACK, Codec
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.states import StateWriter
from robotouille.world.unmet import UnmetKind
from robotouille_server.rooms.broadcast.episode_messages import EpisodeMessages
from robotouille_server.rooms.broadcast.snapshots import Snapshots, last_seq, own_answers
from robotouille_server.rooms.session import Session
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport import Peer, frame_of

__all__ = ["Broadcaster"]

KEPT_DELTAS = 64
"""Deltas kept for those who come back; with more missed, a snapshot is shorter."""
KEPT_SAID, KEPT_NOTICES = 200, 20

MAX_SPECTATOR_NAMES = 8
"""Names of spectators in a roster or snapshot, which goes to everybody: the rest are counted."""


class Broadcaster:
    """The sessions in a room. Each message is made and encoded once for all of them.

    `snapshot_when_committed` sends somebody a snapshot once the room may show its state;
    `waits_for` says for whom a step has waited long. `rematch` is the code of the game in which
    they play this one again, once it is over and somebody has asked for that.
    """

    __slots__ = (
        "_code",
        "_deltas",
        "_episode",
        "_episode_messages",
        "_id",
        "_last_delta",
        "_metrics",
        "_notices",
        "_now",
        "_said",
        "_snapshots",
        "_told",
        "_turn_told",
        "members",
        "rematch",
        "snapshot_when_committed",
        "waits_for",
    )

    def __init__(
        self,
        episode_id: str,
        code: str,
        episode: Episode,
        writer: StateWriter,
        metrics: Metrics,
        now: Callable[[], float],
    ) -> None:
        self.members: list[Session] = []
        self.snapshot_when_committed: Callable[[Session], None] = self.send_snapshot
        self.waits_for: Callable[[], tuple[str, ...]] = tuple
        self.rematch = ""
        self._id = episode_id
        self._code = code
        self._episode = episode
        self._episode_messages = EpisodeMessages(episode_id, episode, writer, now)
        self._snapshots = Snapshots(episode_id, episode, writer)
        self._metrics = metrics
        self._now = now
        self._deltas: deque[bytes] = deque(maxlen=KEPT_DELTAS)
        self._last_delta = 0
        self._told: messages.Roster | None = None
        self._turn_told: str | None = None
        self._said: deque[messages.Said] = deque(maxlen=KEPT_SAID)
        self._notices: deque[tuple[float, messages.Notice]] = deque(maxlen=KEPT_NOTICES)

    @property
    def spectators(self) -> int:
        return sum(1 for _ in self._watching())

    @property
    def spectator_names(self) -> list[str]:
        """What those who have watched longest are called."""
        return [session.name for session in islice(self._watching(), MAX_SPECTATOR_NAMES)]

    def _watching(self) -> Iterator[Session]:
        return (s for s in self.members if not s.players and s.peer is not None)

    def holder(self, player: str) -> Session | None:
        """The session that plays a seat."""
        return next((session for session in self.members if player in session.players), None)

    # Coming in and coming back

    def welcome(self, session: Session, ref: int | None, resume: str) -> None:
        """`joined` and a first snapshot."""
        self._send_joined(session, ref, resume)
        self.send_snapshot(session)

    def welcome_back(self, session: Session, seen: messages.Seen | None, resume: str) -> None:
        """`joined` and what was missed, in deltas as far as they are kept."""
        self._send_joined(session, None, resume)
        peer = session.peer
        if peer is None:
            return
        if seen is None or seen.episode != self._id:
            session.known.clear()  # It may be another program, on another machine.
            self.send_snapshot(session)
            return
        session.known.add(self._episode.world.task.digest)
        missed = self._missed(session, seen)
        if missed is None:
            self.send_snapshot(session)
        else:
            for payload in missed:
                peer.send_frame(frame_of(payload))
        for said in self._said:
            if said.number > seen.said:
                peer.send(said)
        for time, notice in self._notices:
            if time >= session.away_since > 0:
                peer.send(notice)
        peer.send(self.roster())

    def _send_joined(self, session: Session, ref: int | None, resume: str) -> None:
        role, episode = "player" if session.players else "spectator", self._episode
        joined = messages.Joined(
            ref=ref, episode=self._id, code=self._code, role=role, seat=session.player,
            name=session.name, seq=last_seq(episode, session.players), step=episode.step,
            said=episode.said, resume=resume, anticipates=True,
            seats=[*session.players] if session.has_several else [], waits=True,
        )  # fmt: skip
        self.send(session, joined)

    def _missed(self, session: Session, seen: messages.Seen) -> list[bytes | str] | None:
        """The payloads of the deltas after a step, ready to send; None if they are not kept."""
        step = self._episode.step
        if seen.stale or session.wants_text or session.peer is None:
            return None
        if not 0 <= seen.step <= step or self._episode.outcome is not None:
            return None
        count = step - seen.step
        if count > len(self._deltas) or (count and self._last_delta != step):
            return None
        payloads = list(self._deltas)[len(self._deltas) - count :]
        codec = session.peer.codec
        if codec is MSGPACK:
            return [*payloads]
        return [codec.pack(msgpack.unpackb(payload)) for payload in payloads]

    # What happens

    def publish_step(self, event: Stepped) -> None:
        """The delta of a step, to everybody who keeps up."""
        self._snapshots.forget()
        delta = self._episode_messages.delta(event)
        payload = MSGPACK.pack(delta)
        self._deltas.append(payload)  # type: ignore[arg-type]
        self._last_delta, self._turn_told = event.step, event.turn
        packed = frame_of(payload)
        frames: dict[Codec, bytes] = {}
        texts: dict[str | None, messages.Observation] = {}
        for session in self.members:
            peer = session.peer
            if peer is None:
                continue
            if peer.behind and not peer.keeps_up(partial(self.snapshot_when_committed, session)):
                continue
            if session.wants_state:
                frame = packed if peer.codec is MSGPACK else frames.get(peer.codec)
                if frame is None:
                    frame = frames[peer.codec] = frame_of(peer.codec.pack(delta))
                peer.send_frame(frame)
            if session.wants_text:
                self._send_observations(session, event, texts)

    def _send_observations(
        self,
        session: Session,
        event: Stepped,
        texts: dict[str | None, messages.Observation],
    ) -> None:
        """Whoever has only words is sent what became of its own actions, then what it sees."""
        for move, attempt in zip(event.moves, event.attempts, strict=True):
            if move.player in session.players and not attempt.applied and not session.wants_state:
                rejected = messages.Rejected(
                    seq=move.seq,
                    step=event.step,
                    action=move.action.sentence,
                    reasons=list(attempt.reasons),
                    why=[messages.Why.of(unmet) for unmet in attempt.unmet],
                    seat=session.seat_shown(move.player),
                )
                self.send(session, rejected)
        phase = "running" if event.step < self._episode.step else self._episode.phase.value
        for player in session.views:
            if player not in texts:
                texts[player] = self._episode_messages.observation(
                    player, event.state, event.step, event.turn, phase
                )
            self.send(session, texts[player])

    def publish_rejection(self, event: Rejected) -> None:
        """To the seat whose action it was; what could not be read was answered as an error."""
        session = self.holder(event.player)
        if session is None or event.seq == 0:
            return
        only_words = all(unmet.kind is UnmetKind.OTHER for unmet in event.unmet)
        rejected = messages.Rejected(
            seq=event.seq,
            step=self._episode.step,
            action=event.action,
            reasons=list(event.reasons),
            why=[] if only_words else [messages.Why.of(unmet) for unmet in event.unmet],
            code=event.code,
            seat=session.seat_shown(event.player),
        )
        self.send(session, rejected)
        if event.code == ErrorCode.ACTION_STALE:
            self.ask_snapshot(session)

    def publish_quota(self, event: QuotaReached) -> None:
        """To the seat whose words are not recorded any more; spectators notice when they talk."""
        session = self.holder(event.player)
        if session is not None:
            seat = session.seat_shown(event.player)
            where = f"here for {seat}" if seat else "here"
            text = (
                f"no more of what you write is recorded {where}: act without reasoning from now on"
            )
            self.send(session, messages.Notice(text=text))

    def publish_said(self, event: Said) -> None:
        said = messages.Said(
            step=self._episode.step,
            number=event.number,
            name=event.name,
            seat=event.player,
            text=event.text,
        )
        self._said.append(said)
        self.send_all(said)

    def publish_notice(self, text: str) -> None:
        """What the operator says."""
        notice = messages.Notice(text=text)
        self._notices.append((self._now(), notice))
        self.send_all(notice)

    def restore_chat(self, said: Iterable[Mapping[str, Any]]) -> None:
        """Chat from before a restart: recorded notes, all of them, in order."""
        for number, note in enumerate(said, 1):
            self._said.append(
                messages.Said(
                    step=0, number=number, name=note["name"], seat=note["player"], text=note["text"]
                )
            )

    def publish_end(self, outcome: Outcome) -> None:
        """The game is over."""
        self.send_all(self._episode_messages.ended(outcome))

    def publish_roster(self) -> None:
        """Who plays, and whether time runs. It tells how the episode stands: all of that must be
        written."""
        self._told = self.roster()
        self._turn_told = self._told.turn
        self.send_all(self._told)

    def publish_unwritable(self) -> None:
        """That the game stands still since nothing can be written; of all else, what was told
        last, for more is not written."""
        told = self._told
        if told is None:
            return
        begun, why = told.phase != Phase.WAITING, PauseReason.STORAGE.value
        if begun and (told.pause is None or told.pause.reason != PauseReason.OPERATOR):
            told = told.model_copy(update={"pause": messages.Pause(reason=why)})
        phase = Phase.PAUSED if begun else Phase.WAITING
        still: dict[str, Any] = {
            "phase": phase.value,
            "turn": self._turn_told,
            "waits_for": [],
            "starts_in": None,
        }
        self.send_all(told.model_copy(update=still))

    # Snapshots

    def ask_snapshot(self, session: Session) -> None:
        """A snapshot now; what else is asked for in the same turn of the event loop is answered
        by one more in the next."""
        peer = session.peer
        if peer is None:
            return
        if peer.snapshot_sent:
            peer.snapshot_due = True
        else:
            self._send_asked(session, peer)

    def _send_asked(self, session: Session, peer: Peer) -> None:
        peer.snapshot_sent, peer.snapshot_due = True, False
        peer.socket.loop.call_soon(self._next_turn, session, peer)
        self.snapshot_when_committed(session)

    def _next_turn(self, session: Session, peer: Peer) -> None:
        peer.snapshot_sent = False
        if peer.snapshot_due and session.peer is peer and session in self.members:
            self._send_asked(session, peer)

    def send_snapshot(self, session: Session) -> None:
        """The whole state, as a snapshot or in words or both."""
        peer = session.peer
        if peer is None:
            return
        if session.wants_state:
            known = self._episode.world.task.digest in session.known
            session.known.add(self._episode.world.task.digest)
            own = self._own_fields(session)
            peer.answer_frame(self._snapshots.frame(peer.codec, own, with_task=not known))
        if session.wants_text:
            episode = self._episode
            for player in session.views:
                observation = self._episode_messages.observation(
                    player, episode.state, episode.step, episode.on_turn, self._episode.phase.value
                )
                peer.answer(observation)
            if not session.wants_state and episode.outcome is not None:
                self.send(session, self._episode_messages.ended(episode.outcome))

    def _own_fields(self, session: Session) -> dict[str, Any]:
        """The fields of a `snapshot` message that change between steps, or by who gets it."""
        episode = self._episode
        pause = self._episode_messages.pause
        there_or_not: dict[str, Any] = {
            **own_answers(episode, session.players),
            "turn": episode.on_turn,
            "pause": pause and pause.model_dump(mode="json", exclude_defaults=True),
            "said": episode.said,
            "spectators": self.spectators,
            "spectator_names": self.spectator_names,
            "outcome": episode.outcome and episode.outcome.to_json(),
        }
        own: dict[str, Any] = {
            "phase": self._episode.phase.value,
            "seats": [s.model_dump(mode="json", exclude_defaults=True) for s in self.seats()],
            **{name: value for name, value in there_or_not.items() if value},
        }
        if (starts_in := self._episode_messages.starts_in) is not None:
            own["starts_in"] = starts_in
        if (due := episode.due()) is not None:
            own["left"] = max(0.0, due - self._now())
        return own

    def seats(self) -> list[messages.SeatInfo]:
        """The seats as everybody is told them."""
        return self._episode_messages.seats(
            {p: session.latency_ms for session in self.members for p in session.players}
        )

    def roster(self) -> messages.Roster:
        return messages.Roster(
            phase=self._episode.phase.value,
            turn=self._episode.on_turn,
            pause=self._episode_messages.pause,
            seats=self.seats(),
            waits_for=list(self.waits_for()),
            starts_in=self._episode_messages.starts_in,
            spectators=self.spectators,
            spectator_names=self.spectator_names,
            rematch=self.rematch,
        )

    # Sending

    def send(self, session: Session, message: BaseModel) -> None:
        if session.peer is not None:
            session.peer.send(message)

    def send_all(self, message: BaseModel) -> None:
        frames: dict[Codec, bytes] = {}
        for session in self.members:
            peer = session.peer
            if peer is None:
                continue
            frame = frames.get(peer.codec)
            if frame is None:
                frame = frames[peer.codec] = frame_of(peer.codec.encode(message))
            peer.send_frame(frame)
