"""Messages from a room to its participants and spectators."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import chain, islice
from typing import Any

import msgpack
from pydantic import BaseModel

from robotouille.episode import (
    ActionRejected,
    ChatPosted,
    Controller,
    Episode,
    Noted,
    Outcome,
    PauseReason,
    Phase,
    QuotaReached,
    Stepped,
)
from robotouille.protocol import messages
from robotouille.protocol.codec import MSGPACK
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.states import StateWriter
from robotouille.world.unmet import UnmetKind
from robotouille.world.world import State
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.audience import Audience, SharedMessage, SharedStep
from robotouille_server.rooms.publishing.disguises import Disguises
from robotouille_server.rooms.publishing.episode_messages import (
    EpisodeMessages,
    Snapshots,
    last_seq,
    own_answers,
    sent_task,
)
from robotouille_server.rooms.publishing.limited_sight import LimitedSight
from robotouille_server.rooms.publishing.text_views import TextViews
from robotouille_server.rooms.recording.write_ahead import CommitGate
from robotouille_server.runtime.budgets import TEXT_COST
from robotouille_server.runtime.timer_queue import TimerQueue
from robotouille_server.runtime.weak_calls import weakly
from robotouille_server.transport import LoopBudget, Peer, frame_of

KEPT_DELTAS = 64
"""Deltas kept for clients that come back. If more were missed, a snapshot is shorter."""
_FOR_BOTS = re.compile(r"planner \d{1,3}")
"""Text that bots may tell each other: the version by which they plan together."""
MAX_TOLD = 20
"""Number of such texts from one seat in an episode."""
KEPT_SAID, KEPT_NOTICES = 200, 20

REPEATED_SAID = 20
"""Number of recent chat messages for a participant who returns in a new program."""

MAX_SPECTATOR_NAMES = 8
"""Maximum number of spectator names in a roster or snapshot. Everybody receives both, so a longer
list would cost too much; further spectators are only counted."""


class LongWait:
    """Seats for which the current step has waited so long that the roster names them.

    Attributes:
        players: The seats that the last roster named; empty if it named none.
        since: The start of the step in which they were named.
    """

    __slots__ = ("_episode", "players", "since")

    def __init__(self, episode: Episode) -> None:
        self._episode = episode
        self.players: tuple[str, ...] = ()
        self.since = 0.0

    @property
    def still(self) -> tuple[str, ...]:
        """Seats for which the announced step still waits; empty after the step."""
        if not self.players or self._episode.step_began != self.since:
            return ()
        return self._episode.waits_for


class Broadcaster:
    """Sends messages to the sessions in a room. Each message is encoded once for all of them.

    Players receive messages at once; spectators receive them through an `Audience`.

    Attributes:
        members: The sessions in the room. Change it by `enter` and `leave` only.
        mirrored: The number of spectators on other nodes, and the first names.
        long_wait: The seats that rosters report as slow.
        rematch: The code of the next game with the same task and participants, if one was opened.
    """

    __slots__ = (
        "__weakref__",
        "_audience",
        "_code",
        "_deltas",
        "_disguises",
        "_episode",
        "_episode_messages",
        "_gate",
        "_id",
        "_last_delta",
        "_last_roster",
        "_last_turn",
        "_limited",
        "_loop_budget",
        "_notices",
        "_now",
        "_public",
        "_roster_waits",
        "_said",
        "_shown_step",
        "_snapshots",
        "_text_views",
        "_told",
        "_told_by",
        "long_wait",
        "members",
        "mirrored",
        "rematch",
    )

    def __init__(
        self,
        episode_id: str,
        code: str,
        episode: Episode,
        writer: StateWriter,
        timers: TimerQueue,
        loop_budget: LoopBudget,
        gate: CommitGate,
    ) -> None:
        now = timers.time
        self.members: list[Session] = []
        self.mirrored: tuple[int, tuple[str, ...]] = (0, ())
        self.long_wait = LongWait(episode)
        self.rematch = ""
        self._id = episode_id
        self._code = code
        self._episode = episode
        self._episode_messages = EpisodeMessages(episode_id, episode, writer, now)
        self._snapshots = Snapshots(episode_id, episode, writer)
        sight = episode.record.sight
        self._disguises = Disguises(episode, weakly(self.holder))
        self._limited: LimitedSight | None = None
        if sight is not None:
            self._limited = LimitedSight(episode, sight, self._episode_messages)
        self._now = now
        self._gate = gate
        self._loop_budget = loop_budget
        self._audience = Audience(
            timers, loop_budget, weakly(self._public_observation), weakly(self._commit_snapshot)
        )
        self._text_views = TextViews(timers, loop_budget, weakly(self._commit_views))
        self._shown_step: Stepped | None = None
        self._deltas: deque[bytes] = deque(maxlen=KEPT_DELTAS)
        self._last_delta = 0
        self._last_roster: messages.Roster | None = None
        self._roster_waits = False
        self._last_turn: str | None = None
        self._public: tuple[tuple[int, str | None, str], SharedMessage] | None = None
        self._said: deque[messages.Said] = deque(maxlen=KEPT_SAID)
        self._notices: deque[tuple[float, messages.Notice]] = deque(maxlen=KEPT_NOTICES)
        self._told: deque[tuple[float, messages.Told]] = deque(maxlen=KEPT_NOTICES)
        self._told_by: Counter[str] = Counter()

    @property
    def spectators(self) -> int:
        """Number of spectators, those on other nodes included."""
        return self.spectators_here + self.mirrored[0]

    @property
    def spectators_here(self) -> int:
        return sum(1 for _ in self._watching())

    @property
    def spectator_names(self) -> list[str]:
        """Names of the spectators who have watched longest, those of this node first."""
        here = (session.name for session in self._watching())
        return list(islice(chain(here, self.mirrored[1]), MAX_SPECTATOR_NAMES))

    def _watching(self) -> Iterator[Session]:
        return (s for s in self.members if not s.players and s.peer is not None)

    def holder(self, player: str) -> Session | None:
        """Return the session that plays a seat."""
        return next((session for session in self.members if player in session.players), None)

    # Coming in, coming back and leaving

    def enter(self, session: Session) -> None:
        """Send everything from now on to a session."""
        self.members.append(session)
        if not session.players:
            self._audience.enter(session)

    def begin_relay(self, relay: Session) -> None:
        """Send everything that spectators receive to a session outside the room."""
        self._audience.enter(relay)

    def send_to_relay(self, relay: Session, said: int) -> None:
        """Send a relay everything that is pending, then what new spectators need.

        Args:
            relay: The session of the relay.
            said: The number of the last chat message that all other nodes have.
        """
        # Unlike a spectator, a relay receives the steps before a snapshot: it passes them on to
        # spectators who need no snapshot.
        self._audience.catch_up(relay)
        if relay.peer is not None:
            # Nodes see from this whether the chat contains all lines that they lack.
            after = SharedMessage({"type": "said_after", "number": said})
            relay.peer.send_frame(after.frame(MSGPACK))
        for line in self._said:
            if line.number > said:
                self.send(relay, line)
        self.send_snapshot(relay)
        self.send(relay, self.roster())

    def leave(self, session: Session) -> None:
        """Send nothing more to a session."""
        if session in self.members:
            self.members.remove(session)
        self._text_views.discard(session)
        self._audience.leave(session)

    def welcome(self, session: Session, ref: int | None, resume: str) -> None:
        """Send `joined` and a first snapshot."""
        self._send_joined(session, ref, resume)
        self.send_snapshot(session)

    def welcome_back(self, session: Session, seen: messages.Seen | None, resume: str) -> None:
        """Send `joined` and everything that the client has missed, as deltas if possible."""
        if not session.players:
            # This drops what is pending: everything that the client has missed is sent below.
            self._audience.enter(session)
        self._send_joined(session, None, resume)
        peer = session.peer
        if peer is None:
            return
        if seen is None or seen.episode != self._id:
            # Deltas need a state to start from, which this client does not have. The session may
            # even continue in another program, which does not have the task.
            session.known.clear()
            self.send_snapshot(session)
            for said in tuple(self._said)[-REPEATED_SAID:]:
                peer.send(said)
            return
        session.known.add(self._task_digest(session))
        missed = self._missed(session, seen)
        if missed is None:
            self.send_snapshot(session)
        else:
            for payload in missed:
                peer.send_frame(frame_of(payload))
        for said in self._said:
            # Chat is never skipped, even for clients that receive a snapshot (docs/decisions/0006).
            if said.number > seen.said:
                peer.send(said)
        for time, notice in self._notices:
            if time >= session.away_since > 0:
                peer.send(notice)
        for time, told in self._told:
            if time >= session.away_since > 0 and self._may_hear(session, told):
                peer.send(told)
        peer.send(self._shown(self.roster(), session))

    def _send_joined(self, session: Session, ref: int | None, resume: str) -> None:
        role, episode = "player" if session.players else "spectator", self._episode
        joined = messages.Joined(
            ref=ref, episode=self._id, code=self._code, role=role, seat=session.player,
            name=session.name, seq=last_seq(episode, session.players), step=episode.step,
            said=episode.record.said, resume=resume,
            seats=[*session.players] if session.has_several else [],
        )  # fmt: skip
        self.send(session, joined)

    def _missed(self, session: Session, seen: messages.Seen) -> list[bytes | str] | None:
        """Return the payloads of the deltas that a client has missed; None if some are gone."""
        step = self._episode.step
        # Text clients receive observations, which show a whole state, so they need no missed
        # deltas.
        if seen.stale or session.wants_text or session.peer is None:
            return None
        # The kept deltas have the changes of the whole kitchen.
        if self._limited is not None and session.players:
            return None
        # After the end, a snapshot is needed anyway, because it contains the outcome.
        if not 0 <= seen.step <= step or self._episode.outcome is not None:
            return None
        count = step - seen.step
        # The kept deltas must end at the current step, because a restored episode lacks earlier
        # deltas.
        if count > len(self._deltas) or (count and self._last_delta != step):
            return None
        payloads = list(self._deltas)[len(self._deltas) - count :]
        codec = session.peer.codec
        if codec is MSGPACK:
            return [*payloads]
        return [codec.pack(msgpack.unpackb(payload)) for payload in payloads]

    # Events

    def publish_step(self, event: Stepped) -> None:
        """Send the delta of a step to all clients that keep up."""
        self._snapshots.forget()
        delta = self._episode_messages.delta(event)
        payload = MSGPACK.pack(delta)
        self._deltas.append(payload)  # type: ignore[arg-type]
        self._last_delta, self._last_turn = event.step, event.turn
        # All readers share one frame, because server frames are neither masked nor compressed
        # (docs/decisions/0016).
        shared = SharedStep(delta, event, MSGPACK, frame_of(payload))
        self._audience.add(shared)
        self._shown_step = event
        for session in self.members:
            peer = session.peer
            if peer is None or not session.players:
                continue
            # `behind` is one comparison, so a reader that keeps up costs almost nothing
            # (docs/decisions/0006).
            if peer.behind and not peer.keeps_up(partial(self._commit_snapshot, session)):
                continue
            if session.wants_state:
                if self._limited is None:
                    # JSON is encoded only if a member uses it.
                    peer.send_frame(shared.frame(peer.codec))
                else:
                    seen = self._limited.delta(event, session.players)
                    peer.send_frame(frame_of(peer.codec.pack(seen)))
            if session.wants_text:
                self._send_text(session, event)

    def _send_text(self, session: Session, event: Stepped) -> None:
        """Send a text client the rejections of its own actions, then its view of the state."""
        for move, attempt in zip(event.moves, event.attempts, strict=True):
            if move.player in session.players and not attempt.applied and not session.wants_state:
                unmet = self._episode.record.told_in_step(
                    move.player, attempt.unmet, event.before, event.state
                )
                rejected = messages.Rejected(
                    seq=move.seq,
                    step=event.step,
                    action=move.action.sentence,
                    reasons=[str(each) for each in unmet],
                    why=[messages.Why.of(each) for each in unmet],
                    seat=session.seat_shown(move.player),
                )
                self.send(session, rejected)
        if self._episode.rules.scheduled:
            self._text_views.add(session)
        # A text shows a whole state. Of several steps published together, only the last is shown:
        # nobody could decide between them.
        elif event.step == self._episode.step:
            self._loop_budget.spend(TEXT_COST * len(session.views))
            self._send_views(session)

    def _commit_views(self, session: Session) -> None:
        # The views contain the answer to the last action, which may not be written yet.
        if self._gate.closed:
            self._gate.when_committed(session, partial(self._send_views, session))
        else:
            self._send_views(session)

    def _send_views(self, session: Session) -> None:
        """Send a text client its views of the state after the last published step."""
        peer, event = session.peer, self._shown_step
        if peer is None or event is None:
            return
        for player in session.views:
            peer.send_frame(self._observation_after(event, player).frame(peer.codec))

    def _public_observation(self, event: Stepped) -> SharedMessage:
        return self._observation_after(event, None)

    def _observation_after(self, event: Stepped, player: str | None) -> SharedMessage:
        # Several steps may be published together. Only the last one shows the current phase.
        phase = "running" if event.step < self._episode.step else self._episode.phase.value
        return self._observation(player, event.state, event.step, event.turn, phase)

    def _observation(
        self, player: str | None, state: State, step: int, turn: str | None, phase: str
    ) -> SharedMessage:
        key = (step, turn, phase)
        if player is None and self._public is not None and self._public[0] == key:
            return self._public[1]
        text = self._episode_messages.observation(player, state, step, turn, phase)
        shared = SharedMessage(text)
        if player is None:
            # All spectators see the same text, which takes longer to write than a step.
            self._public = key, shared
        return shared

    def publish_rejection(self, event: ActionRejected) -> None:
        """Send a rejection to the participant whose action was rejected."""
        session = self.holder(event.player)
        if session is None or event.seq == 0:  # Unreadable messages were answered by `error`.
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
        # The client acted on an earlier state, so it may have missed a delta.
        if event.code == ErrorCode.ACTION_STALE:
            self.ask_snapshot(session)

    def publish_quota(self, event: QuotaReached) -> None:
        """Tell a participant that its reasoning and chat are no longer recorded."""
        session = self.holder(event.player)
        if session is not None:
            seat = session.seat_shown(event.player)
            whose = f" of {seat}" if seat else ""
            text = f"the recording quota{whose} is used up: send no more reasoning in this episode"
            self.send(session, messages.Notice(text=text))

    def publish_said(self, event: ChatPosted) -> None:
        said = messages.Said(
            step=self._episode.step,
            number=event.number,
            name=event.name,
            seat=event.player,
            text=event.text,
            intent=event.intent,
            target=event.target,
        )
        self._said.append(said)
        self.send_all(said)

    def publish_told(self, event: Noted) -> None:
        """Send a bot's text for its team to all bots, the sender included.

        If the sender is disguised, only the sender receives it. Only a version is sent, a few
        times, so that nobody can use it as a hidden chat.
        """
        sender = self.holder(event.player)
        if sender is None or sender.kind != Controller.BOT or not _FOR_BOTS.fullmatch(event.text):
            return
        self._told_by[event.player] += 1
        if self._told_by[event.player] > MAX_TOLD:
            return
        told = messages.Told(seat=event.player, text=event.text)
        self._told.append((self._now(), told))
        for session in self.members:
            if self._may_hear(session, told):
                self.send(session, told)

    def _may_hear(self, session: Session, told: messages.Told) -> bool:
        """Return whether a session receives a text that a bot has sent to its team."""
        if not session.players or session.kind != Controller.BOT:
            return False
        return self._disguises.hears(session, told.seat)

    def publish_notice(self, text: str) -> None:
        """Send an announcement of the operator."""
        notice = messages.Notice(text=text)
        self._notices.append((self._now(), notice))
        self.send_all(notice)

    def restore_chat(self, said: Iterable[Mapping[str, Any]]) -> None:
        """Restore the chat from a recording after a restart."""
        for number, note in enumerate(said, 1):
            self._said.append(
                messages.Said(
                    step=0,
                    number=number,
                    name=note["name"],
                    seat=note["player"],
                    text=note["text"],
                    intent=note.get("intent", ""),
                    target=note.get("target", ""),
                )
            )

    def publish_end(self, outcome: Outcome) -> None:
        """Send the outcome."""
        self._text_views.deliver_now()
        self.send_all(self._episode_messages.ended(outcome))

    def publish_roster(self) -> None:
        """Send the roster. The caller makes sure that everything in it has been written."""
        self._last_roster = self.roster()
        self._last_turn = self._last_roster.turn
        self.send_all(self._last_roster)

    def publish_roster_when_owned(self) -> None:
        """Send the roster once everything is written and this process owns the episode.

        Rosters without an event need this: if the process was suspended, another node may have the
        episode.
        """
        if not self._roster_waits:
            self._roster_waits = True
            self._gate.when_committed(self, self._publish_waiting_roster)

    def _publish_waiting_roster(self) -> None:
        self._roster_waits = False
        self.publish_roster()

    def publish_unwritable(self) -> None:
        """Tell everybody that the episode is paused because its recording cannot be written.

        The rest of the roster repeats the last one, because later changes are not written yet.
        """
        # Before the first roster, there is no roster to correct.
        last = self._last_roster
        if last is None:
            return
        begun, why = last.phase != Phase.WAITING, PauseReason.STORAGE.value
        if begun and (last.pause is None or last.pause.reason != PauseReason.OPERATOR):
            last = last.model_copy(update={"pause": messages.Pause(reason=why)})
        phase = Phase.PAUSED if begun else Phase.WAITING
        still: dict[str, Any] = {
            "phase": phase.value,
            "turn": self._last_turn,
            "waits_for": [],
            "starts_in": None,
        }
        self.send_all(last.model_copy(update=still))

    # Snapshots

    def ask_snapshot(self, session: Session) -> None:
        """Send a snapshot: to players at once, to spectators with their next delivery.

        A player receives at most one in each turn of the event loop; further requests in the same
        turn share one in the next turn. A snapshot can be a hundred times as large as the request,
        so a flood of requests would otherwise use up the server's time.
        """
        peer = session.peer
        if peer is None:
            return
        if not session.players:
            self._audience.ask_snapshot(session)
            return
        if peer.snapshot_sent:
            peer.snapshot_due = True
        else:
            self._send_asked(session, peer)

    def _send_asked(self, session: Session, peer: Peer) -> None:
        # One snapshot per turn answers any number of requests. Therefore, resyncs cost less than
        # their answers (see `PACED` and `COSTS` in `runtime.budgets`).
        peer.snapshot_sent, peer.snapshot_due = True, False
        peer.socket.loop.call_soon(self._next_turn, session, peer)
        self._commit_snapshot(session)

    def _next_turn(self, session: Session, peer: Peer) -> None:
        peer.snapshot_sent = False
        # The client may have reconnected or left since its request.
        if peer.snapshot_due and session.peer is peer and session in self.members:
            self._send_asked(session, peer)

    def _commit_snapshot(self, session: Session) -> None:
        self._gate.when_committed(session, partial(self.send_snapshot, session))

    def send_snapshot(self, session: Session) -> None:
        """Send the whole state as a snapshot, as text, or both."""
        peer = session.peer
        if peer is None:
            return
        self._audience.catch_up(session, steps=False)
        if session.wants_state:
            task = self._task_digest(session)
            known = task in session.known
            # From now on the client has the task: frames are delivered in order or not at all.
            session.known.add(task)
            own = self._own_fields(session)
            part = None
            if self._limited is not None and session.players:
                part = self._limited.seen(self._episode.state, session.players)
            frame = self._snapshots.frame(peer.codec, own, with_task=not known, seen=part)
            peer.answer_frame(frame)
        if session.wants_text:
            self._text_views.discard(session)
            episode = self._episode
            for player in session.views:
                seen = episode.state, episode.step, episode.on_turn, episode.phase.value
                peer.answer_frame(self._observation(player, *seen).frame(peer.codec))
            if not session.wants_state and episode.outcome is not None:
                self.send(session, self._episode_messages.ended(episode.outcome))

    def _task_digest(self, session: Session) -> str:
        """Return the digest of the task that a session receives."""
        limited = self._limited is not None and bool(session.players)
        return sent_task(self._episode.world, limited=limited).digest

    def _own_fields(self, session: Session) -> dict[str, Any]:
        """Return the fields of a snapshot that depend on the session or change between steps."""
        episode = self._episode
        pause = self._episode_messages.pause
        optional: dict[str, Any] = {
            **own_answers(episode, session.players),
            "turn": episode.on_turn,
            "pause": pause and pause.model_dump(mode="json", exclude_defaults=True),
            "said": episode.record.said,
            "spectators": self.spectators,
            "spectator_names": self.spectator_names,
            "outcome": episode.outcome and self._episode_messages.outcome(episode.outcome),
        }
        seats = self._disguises.seats(self.seats(), session)
        if self._limited is not None and session.players:
            seats = self._limited.seats(seats, session.players)
        own: dict[str, Any] = {
            "phase": self._episode.phase.value,
            "seats": [s.model_dump(mode="json", exclude_defaults=True) for s in seats],
            **{name: value for name, value in optional.items() if value},
        }
        if (starts_in := self._episode_messages.starts_in) is not None:
            own["starts_in"] = starts_in
        if (due := episode.due(with_held=False)) is not None:
            own["left"] = max(0.0, due - self._now())
        return own

    def seats(self) -> list[messages.SeatInfo]:
        """Return the seats as everybody sees them."""
        return self._episode_messages.seats(
            {p: session.latency_ms for session in self.members for p in session.players}
        )

    def roster(self) -> messages.Roster:
        return messages.Roster(
            phase=self._episode.phase.value,
            turn=self._episode.on_turn,
            pause=self._episode_messages.pause,
            seats=self.seats(),
            waits_for=list(self.long_wait.still),
            starts_in=self._episode_messages.starts_in,
            spectators=self.spectators,
            spectator_names=self.spectator_names,
            rematch=self.rematch,
        )

    # Sending

    def deliver_now(self) -> None:
        """Send what is pending, because the server stops."""
        self._text_views.deliver_now()
        self._audience.deliver_now()

    def send(self, session: Session, message: BaseModel) -> None:
        """Send a message to one session, after everything that is pending for it."""
        if session.peer is not None:
            self._audience.catch_up(session)
            session.peer.send(self._shown(message, session))

    def send_all(self, message: BaseModel) -> None:
        """Send a message to everybody."""
        # The message is encoded once per codec, because rooms may have hundreds of spectators.
        shared = SharedMessage(message)
        self._audience.add(shared)
        for session in self.members:
            peer = session.peer
            if peer is not None and session.players:
                if self._limited is None and not self._disguises.sees_through(session):
                    peer.send_frame(shared.frame(peer.codec))
                else:
                    peer.send(self._shown(message, session))

    def _shown(self, message: BaseModel, session: Session) -> BaseModel:
        """Return a message as a session may see it."""
        message = self._disguises.shown(message, session)
        if self._limited is None or not session.players:
            return message
        return self._limited.shown(message, session.players)
