"""A room: one episode, those who play and watch it, its timer and its recording."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from robotouille.episode import (
    Absence,
    Announced,
    Departure,
    Ended,
    Episode,
    Event,
    Moderated,
    Moderation,
    Paused,
    PauseReason,
    Phase,
    QuotaReached,
    Rejected,
    Restarted,
    Resumed,
    RosterChanged,
    Said,
    Started,
    Stepped,
)
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.action_requests import ground, in_words
from robotouille_server.rooms.broadcaster import Broadcaster
from robotouille_server.rooms.display_names import DisplayNames
from robotouille_server.rooms.recordings.journal import Journal
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.slow_seats import SlowSeats
from robotouille_server.rooms.substitutes.deadline_scheduler import BotScheduler
from robotouille_server.rooms.substitutes.substitute_bot import SubstituteBot
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue
from robotouille_server.runtime.token_bucket import TokenBucket

__all__ = ["Room", "RoomHost"]

MAX_WAITING = 4
"""Answers to one session that wait for its recording; more are asked for again."""
MAX_UNWRITTEN = 64 * 1024
"""Bytes of a failing recording that may wait; until they are written nobody can come back."""
SEAT_CHANGES, SEAT_CHANGES_AT_ONCE = 20, 40
"""How often a minute, and how often at once, a seat may be taken or come back to."""
RETRY_SECONDS = 1.0
"""Between two attempts to write what could not be written."""


@dataclass(frozen=True, slots=True)
class RoomHost:
    """What a room needs of its server.

    `resume_token` makes the token with which a session comes back; `vacated` is told when a
    session has lost its place, `sent_out` when it was sent out while it was away, `closed` when
    the episode is over.
    """

    metrics: Metrics
    resume_token: Callable[[Session], str]
    vacated: Callable[[Session], None]
    sent_out: Callable[[Session], None]
    closed: Callable[[Room], None]
    agenda: TimerQueue
    thoughts: BotScheduler


class Room:
    """Feeds an episode with messages and time, and tells everybody in it what happened."""

    __slots__ = (
        "_failing",
        "_host",
        "_loop",
        "_metrics",
        "_names",
        "_now",
        "_open",
        "_patience",
        "_retry",
        "_stand_ins",
        "_timer",
        "_turnover",
        "_unpainted",
        "_untold",
        "audience",
        "code",
        "episode",
        "id",
        "journal",
        "owner",
        "recording",
        "world",
    )

    def __init__(
        self,
        episode_id: str,
        code: str,
        episode: Episode,
        *,
        journal: Journal | None,
        audience: Broadcaster,
        host: RoomHost,
        owner: str = "",
    ) -> None:
        self.id = episode_id
        self.code = code
        self.owner = owner
        self.episode = episode
        self.world = episode.world
        self.journal = journal
        self.audience = audience
        self.recording = ""
        self._host = host
        self._names = DisplayNames(episode)
        self._metrics = host.metrics
        self._loop = asyncio.get_running_loop()
        self._now = host.agenda.time
        self._turnover = {
            player: TokenBucket(SEAT_CHANGES / 60, self._now(), SEAT_CHANGES_AT_ONCE)
            for player in self.world.players
        }
        self._timer: TimerHandle | None = None
        self._patience = SlowSeats(episode, host.agenda, self._now, audience.tell_roster)
        self._retry: asyncio.TimerHandle | None = None
        self._untold: list[Event] = []
        self._unpainted: dict[Session, list[Callable[[], None]]] = {}
        self._stand_ins: dict[str, SubstituteBot] = {}
        self._failing = False
        self._open = True
        audience.paint = self.send_picture
        audience.waits_for = lambda: self._patience.still
        if episode.rules.absence is Absence.BOT:
            self._stand_ins = {
                player: SubstituteBot(episode, player, host.thoughts, self._substitute)
                for player in self.world.players
            }

    @property
    def members(self) -> list[Session]:
        """Everybody who plays or watches."""
        return self.audience.members

    @property
    def spectators(self) -> int:
        return self.audience.spectators

    @property
    def problem(self) -> str:
        """What the operator should know; empty if all is well."""
        return self.journal.problem if self.journal is not None else ""

    # Coming and going

    def enter(self, session: Session, request: messages.Join, max_spectators: int) -> None:
        """Take a seat or watch; the session gets `joined` and a first picture."""
        self._check_recording()
        if self.bans(session.id, session.participant):
            raise ProtocolError("episode/banned", "you were sent out of this episode", "episode")
        name = self._names.choose(session.given_name)
        if request.role == "player":
            session.player = self.episode.join(
                self._seat_for(request),
                name,
                session.kind,
                self._now(),
                session=session.id,
                participant=session.participant,
            )
        elif self.spectators >= max_spectators:
            message = f"{max_spectators} spectators watch already"
            raise ProtocolError("episode/full", message, "role")
        else:
            session.player = None
            self._forget_away(max_spectators)
            self._names.watch(name)
        session.name, session.room = name, self
        session.view = request.view
        session.known = set(request.known)
        self.flush()
        self.members.append(session)
        self._confirm(session, partial(self._welcome, session, request.ref))

    def _forget_away(self, most: int) -> None:
        """Of the spectators who are away, and may come back for a while, there are not more than
        may watch."""
        away = [one for one in self.members if one.player is None and one.peer is None]
        if len(away) >= most > 0:
            longest = min(away, key=lambda one: one.away_since)
            self._part_with(longest)
            self._host.vacated(longest)

    def _welcome(self, session: Session, ref: int | None) -> None:
        self.audience.welcome(session, ref, self._host.resume_token(session))
        if session.player is None:
            self.audience.tell_roster()
        else:
            self.audience.send(session, self.audience.roster())

    def leave(self, session: Session, why: Departure = Departure.LEFT) -> None:
        """Leave for good."""
        player = self._part_with(session)
        if player is not None:
            self.episode.leave(player, self._now(), why)
        else:
            self.audience.tell_roster()
        self.flush()

    def _part_with(self, session: Session) -> str | None:
        """Forget a session; the seat it had."""
        if session in self.members:
            self.members.remove(session)
        self._unpainted.pop(session, None)
        player, session.room, session.player = session.player, None, None
        if player is None:
            self._names.release(session.name)
        session.name = session.given_name
        return player

    def seat_again(self, session: Session, player: str | None) -> None:
        """A participant of a process before this one has the place again, and the seat's name; a
        spectator's may be somebody else's by now."""
        session.room, session.player = self, player
        if player is not None:
            session.name = self.episode.seats[player].name
        else:
            session.name = self._names.choose(session.given_name)
            self._names.watch(session.name)
        self.members.append(session)

    def connection_lost(self, session: Session) -> None:
        """The seat of a player is kept; a spectator is only not told anything."""
        session.away_since = self._now()
        if session.player is not None:
            self.episode.set_present(session.player, False, self._now())
        self.flush()

    def check_return(self, session_id: str) -> None:
        """ProtocolError `server/recording` while so much cannot be written that no more coming and
        going can be recorded, `rate/seats` where somebody comes and goes all the time: who comes
        back now has to try again."""
        if self._failing and self.journal is not None and self.journal.waiting > MAX_UNWRITTEN:
            self._check_recording()
        player = self.holds_seat(session_id)
        if player is not None and self.episode.phase is not Phase.ENDED:
            self._take_turnover(player)

    def _seat_for(self, request: messages.Join) -> str | None:
        """The seat to ask for: of the free ones, one that has not changed hands too often."""
        if request.seat is not None:
            if request.seat in self._turnover:
                self._take_turnover(request.seat)
            return request.seat
        free = [seat.player for seat in self.episode.seats.values() if not seat.taken]
        now = self._now()
        calm = next((player for player in free if self._turnover[player].left(now) >= 1), None)
        if free:
            self._take_turnover(calm or free[0])
        return calm

    def _take_turnover(self, player: str) -> None:
        """Each coming and going is recorded: without end it would fill any recording."""
        if not self._turnover[player].take(self._now()):
            message = f"{player} has changed hands too often just now; try again in a while"
            raise ProtocolError("rate/seats", message, "seat")

    def connection_back(self, session: Session, seen: messages.Seen | None) -> None:
        """A session is here again: tell it what it has missed."""
        if session.player is not None:
            self.episode.set_present(
                session.player, True, self._now(), generation=session.generation
            )
        self.flush()
        resume = self._host.resume_token(session)
        self._confirm(session, partial(self.audience.welcome_back, session, seen, resume))

    def holds_seat(self, session_id: str) -> str | None:
        """The seat that belongs to a session, in this process or one before."""
        for seat in self.episode.seats.values():
            if seat.taken and seat.session == session_id:
                return seat.player
        return None

    def bans(self, session_id: str, participant: str) -> bool:
        """Whether somebody was sent out, in this session or another."""
        return not self.episode.banned.isdisjoint((session_id, participant))

    def kick(self, session: Session, reason: str) -> None:
        """Send somebody out, with all of their sessions, and do not let them in again."""
        self._moderate(Moderation.BANNED, session)
        for member in list(self.members):
            if self.bans(member.id, member.participant):
                self._send_out(member, reason)
        self.flush()

    def _send_out(self, session: Session, reason: str) -> None:
        self.leave(session, Departure.REMOVED)
        if session.peer is None:
            self._host.sent_out(session)
        self.audience.send(session, messages.Left(episode=self.id, reason=reason))

    def mute(self, session: Session) -> None:
        """Take the right to talk in this episode from somebody, until `unmute`."""
        if not self.mutes(session):
            self._moderate(Moderation.MUTED, session)
            self.flush()

    def unmute(self, session: Session) -> None:
        """Let somebody talk again."""
        if self.mutes(session):
            self._moderate(Moderation.UNMUTED, session)
            self.flush()

    def mutes(self, session: Session) -> bool:
        """Whether somebody may not talk, in this session or another."""
        return session.participant in self.episode.muted

    def _moderate(self, what: Moderation, session: Session) -> None:
        who = (session.id, session.participant, session.name)
        self.episode.moderate(what, *who, self._now())

    def dismiss(self) -> None:
        """Tell those who are still here that the room is closed."""
        for session in list(self.members):
            self._part_with(session)
            self.audience.send(
                session, messages.Left(episode=self.id, reason="the episode is over")
            )

    # Playing

    def act(self, session: Session, request: messages.Act) -> None:
        """Submit a seat's action; whatever is wrong with it is answered by `rejected`."""
        try:
            if session.player is None:
                raise ProtocolError("seat/none", "spectators do not act", "type")
            if self._failing:
                return  # It is sent again; what is held back must not grow.
            if request.seq == self.episode.seat(session.player).seq:
                self._answer_again(session, request)
                return
            action = ground(self.episode, session.player, request)
            self.episode.submit(
                session.player,
                request.seq,
                action,
                self._now(),
                think_ms=request.think_ms,
                reasoning=request.reasoning or "",
            )
            if request.reasoning:
                session.recorded_bytes += len(request.reasoning.encode())
        except ProtocolError as error:
            self._refuse(session, request, error)
        self.flush()

    def _answer_again(self, session: Session, request: messages.Act) -> None:
        """An action that was heard before: say what became of it, do nothing."""
        answer = self.audience.answer(session)
        if answer.seq != request.seq:
            return
        if not answer.reasons:
            self.ask_picture(session)
            return
        rejected = messages.Rejected(
            seq=answer.seq,
            step=answer.step,
            action=in_words(request),
            reasons=list(answer.reasons),
        )
        self._confirm(session, partial(self.audience.send, session, rejected))

    def _refuse(self, session: Session, request: messages.Act, error: ProtocolError) -> None:
        self._metrics.errors.labels(error.code).inc()
        self._metrics.rejected += 1
        rejected = messages.Rejected(
            seq=request.seq,
            step=self.episode.step,
            action=in_words(request),
            reasons=[error.message],
            code=error.code,
        )
        self.audience.send(session, rejected)
        if error.code == "action/stale":
            self.ask_picture(session)

    def _check_recording(self) -> None:
        if self._failing:
            raise ProtocolError("server/recording", f"{self.problem}; try again later")

    def say(self, session: Session, text: str) -> None:
        self._check_recording()
        if self.mutes(session):
            raise ProtocolError("seat/muted", "the operator has muted you in this episode", "text")
        self.episode.say(session.name, session.player or "", text, self._now())
        session.recorded_bytes += len(text.encode())
        self.flush()

    def ask_picture(self, session: Session) -> None:
        """The whole state, once for each turn of the event loop."""
        self.audience.ask_picture(session)

    def send_picture(self, session: Session) -> None:
        """The whole state, once all that led to it is written."""
        self._confirm(session, partial(self.audience.send_picture, session))

    def _substitute(self, player: str, action: GroundAction | None) -> None:
        self.episode.substitute(player, action, self._now())
        self.flush()

    # What an operator does

    def pause(self) -> None:
        """Let time stand still until `resume`."""
        self.episode.pause(PauseReason.OPERATOR, self._now())
        self.flush()

    def resume(self) -> None:
        self.episode.resume(PauseReason.OPERATOR, self._now())
        self.flush()

    def announce(self, text: str) -> None:
        """Say something to everybody in the episode."""
        self.episode.announce(text, self._now())
        self.flush()

    def abort(self, reason: str) -> None:
        """End the episode, because the server stops or an operator says so."""
        self.episode.abort(self._now(), reason)
        self.flush()

    # Time

    def _schedule(self) -> None:
        due = self.episode.due()
        if self._timer is not None:
            if due == self._timer.due:
                return
            self._host.agenda.cancel(self._timer)
        self._timer = None if due is None else self._host.agenda.call_at(due, self._on_time)

    def _on_time(self, due: float) -> None:
        self._timer = None
        now = self._now()
        episode = self.episode
        if episode.scheduled and episode.running:
            self._metrics.lateness.observe(max(0.0, now - due))
        try:
            episode.tick(max(now, due))
            self.flush()
        except Exception:
            self._fail()

    def _fail(self) -> None:
        """A fault in one episode ends that one only."""
        get_logger().exception("the episode failed", episode=self.id)
        self.abort("internal error")

    # Telling

    def flush(self) -> None:
        """Record what has happened, then tell it; nothing is told that is not written."""
        if not self._open:
            return
        begun = self._now()
        self._gather()
        if self._untold or self._failing:
            self._record_and_tell(begun)
        if not self._open or self._failing:
            return
        self._schedule()
        if self._patience.waits_for:
            self._patience.heed()
        for stand_in in self._stand_ins.values():
            stand_in.consider()

    def _record_and_tell(self, begun: float) -> None:
        if not self._written():
            return
        if self._unpainted:
            self._paint()
        events, self._untold = self._untold, []
        for event in events:
            self._tell(event)
        if events and isinstance(events[0], Stepped):
            self._metrics.age.observe(self._now() - begun)
        if self.episode.phase is Phase.ENDED:
            self._close()
        elif self.journal is not None and self.journal.full:
            self.abort("the recording is as long as one may be")

    def _gather(self) -> None:
        events = self.episode.events()
        if events:
            self._untold += events
            if self.journal is not None:
                self.journal.add(events)

    def _written(self) -> bool:
        """Write; where that fails the game stands still, and it is tried again in a while."""
        if self._failing and self._retry is not None:
            return False
        if self.journal is None or self.journal.write():
            if self._failing:
                self._failing = False
                self._metrics.failing.dec()
            if PauseReason.STORAGE in self.episode.pauses:
                self.episode.resume(PauseReason.STORAGE, self._now())
                self._gather()
                return self._written()
            return True
        if self._retry is None:
            self._retry = self._loop.call_later(RETRY_SECONDS, self._write_again)
        if not self._failing:
            self._failing = True
            self._metrics.failing.inc()
        if PauseReason.STORAGE not in self.episode.pauses and self.episode.phase is not Phase.ENDED:
            self.episode.pause(PauseReason.STORAGE, self._now())
            self._gather()
            self.audience.tell_roster()
        return False

    def _write_again(self) -> None:
        self._retry = None
        try:
            self.flush()
        except Exception:
            self._fail()

    def _confirm(self, session: Session, tell: Callable[[], None]) -> None:
        """Tell what a session sees, at once or, while the recording fails, when it is written."""
        if not self._failing:
            tell()
        elif len(waiting := self._unpainted.setdefault(session, [])) < MAX_WAITING:
            waiting.append(tell)

    def _paint(self) -> None:
        unpainted, self._unpainted = self._unpainted, {}
        for waiting in unpainted.values():
            for tell in waiting:
                tell()

    def _tell(self, event: Event) -> None:
        match event:
            case Stepped():
                self._count(event)
                self.audience.tell_step(event)
                for stand_in in self._stand_ins.values():
                    stand_in.observe(event)
            case Rejected():
                self._metrics.rejected += 1
                self.audience.tell_rejection(event)
            case QuotaReached():
                self.audience.tell_quota(event)
            case Said():
                self.audience.tell_said(event)
            case Announced():
                self.audience.tell_notice(event.text)
            case RosterChanged():
                self._roster_changed(event)
            case Started() | Paused() | Resumed() | Restarted():
                self._tell_roster()
                self._patience.begin()
                for stand_in in self._stand_ins.values():
                    stand_in.warm()
            case Ended():
                self._tell_end(event)
            case Moderated():
                pass  # Whom it concerns is told by what follows from it.

    def _count(self, event: Stepped) -> None:
        metrics = self._metrics
        metrics.steps += 1
        for attempt in event.attempts:
            if attempt.applied:
                metrics.applied += 1
            else:
                metrics.rejected += 1

    def _tell_roster(self) -> None:
        self._patience.told()
        self.audience.tell_roster()

    def _roster_changed(self, event: RosterChanged) -> None:
        self._tell_roster()
        holder = self.audience.holder(event.player)
        if not event.taken and holder is not None and holder.peer is None:
            self._part_with(holder)
            self._host.vacated(holder)

    def _tell_end(self, event: Ended) -> None:
        self._metrics.outcomes.labels(event.outcome.reason.value).inc()
        self.audience.send_all(self.audience.ended(event.outcome))

    # The end

    def suspend(self) -> None:
        """Stop here and now; another process goes on with the recording."""
        self._open = False
        self._stop_clocks()
        if self.journal is not None:
            self.journal.release()

    def _stop_clocks(self) -> None:
        if self._timer is not None:
            self._host.agenda.cancel(self._timer)
        if self._retry is not None:
            self._retry.cancel()
        self._patience.stop()
        for stand_in in self._stand_ins.values():
            stand_in.stop()

    def _close(self) -> None:
        self._open = False
        self._stop_clocks()
        self._host.closed(self)
        outcome = self.episode.outcome
        get_logger().info(
            "episode over",
            episode=self.id,
            task=self.world.task.name,
            reason=outcome.reason.value if outcome else "",
            steps=self.episode.step,
        )
