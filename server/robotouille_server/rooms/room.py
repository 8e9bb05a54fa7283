"""A room: one episode, those who play and watch it, its timer and its recording."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Protocol

from robotouille.episode import (
    Controller,
    Departure,
    Episode,
    Event,
    Moderation,
    PauseReason,
    Phase,
    Stepped,
)
from robotouille.episode.rules import NO_TREATMENT
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.broadcast.broadcaster import Broadcaster
from robotouille_server.rooms.broadcast.spectator_rosters import SpectatorRosters
from robotouille_server.rooms.publisher import Publisher
from robotouille_server.rooms.recordings import Journal
from robotouille_server.rooms.seats.action_requests import ActionRequests
from robotouille_server.rooms.seats.display_names import DisplayNames
from robotouille_server.rooms.seats.round_trips import RoundTrips
from robotouille_server.rooms.seats.seat_turnover import SeatTurnover
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.substitutes.bot_scheduler import BotScheduler
from robotouille_server.rooms.write_ahead import WriteAhead
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue

__all__ = ["Room", "RoomHost", "RoomObserver"]

RETRY_SECONDS = 1.0
"""Between two attempts to write what could not be written."""


class RoomObserver(Protocol):
    """Is told of rooms, in the middle of their steps: it must be quick, and raise nothing."""

    def opened(self, room: Room) -> None:
        """There is a new room, or one that goes on after a restart."""

    def published(self, room: Room, events: list[Event]) -> None:
        """What was written, and is published."""


@dataclass(slots=True)
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
    timers: TimerQueue
    bot_scheduler: BotScheduler
    observer: RoomObserver | None = None


class Room:
    """Feeds an episode with messages and time, and publishes what happened to those in it.

    `seed` is that with which the task was loaded; `players` are the sessions and participants that
    had a seat in this process, or have one.
    """

    __slots__ = (
        "_actions",
        "_host",
        "_loop",
        "_metrics",
        "_names",
        "_now",
        "_open",
        "_publisher",
        "_retry",
        "_round_trips",
        "_spectator_rosters",
        "_timer",
        "_turnover",
        "_write_ahead",
        "broadcaster",
        "code",
        "created",
        "episode",
        "id",
        "journal",
        "labels",
        "owner",
        "players",
        "recording",
        "seed",
        "world",
    )

    def __init__(
        self,
        episode_id: str,
        code: str,
        episode: Episode,
        *,
        journal: Journal | None,
        broadcaster: Broadcaster,
        host: RoomHost,
        owner: str = "",
        labels: Mapping[str, str] = MappingProxyType({}),
        created: str = "",
        seed: int = 0,
    ) -> None:
        self.id = episode_id
        self.code = code
        self.owner = owner
        self.labels = labels
        self.created = created
        self.seed = seed
        self.episode = episode
        taken = [seat for seat in episode.seats.values() if seat.taken]
        self.players = {one for seat in taken for one in (seat.session, seat.participant)}
        self.world = episode.world
        self.journal = journal
        self.broadcaster = broadcaster
        self.recording = ""
        self._host = host
        self._names = DisplayNames(episode)
        self._metrics = host.metrics
        self._loop = asyncio.get_running_loop()
        self._now = host.timers.time
        self._turnover = SeatTurnover(self.world.players, self._now())
        self._timer: TimerHandle | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._round_trips = RoundTrips()
        self._publisher = Publisher(
            episode,
            broadcaster,
            metrics=host.metrics,
            timers=host.timers,
            bot_scheduler=host.bot_scheduler,
            substitute=self._substitute,
            away=self._forget,
        )
        self._write_ahead = WriteAhead(
            episode, journal, self._publisher.publish, self._failing_changed
        )
        self._spectator_rosters = SpectatorRosters(
            host.timers, lambda: self._write_ahead.failing, broadcaster.publish_roster
        )
        self._actions = ActionRequests(episode, broadcaster, self._write_ahead, host.metrics)
        self._open = True
        broadcaster.snapshot_when_committed = self._send_snapshot

    @property
    def members(self) -> list[Session]:
        """Everybody who plays or watches."""
        return self.broadcaster.members

    @property
    def spectators(self) -> int:
        return self.broadcaster.spectators

    @property
    def problem(self) -> str:
        """What the operator should know; empty if all is well."""
        return self.journal.problem if self.journal is not None else ""

    @property
    def reserved(self) -> bool:
        """Whether it is kept open for somebody who has not come yet."""
        return self.episode.rules.open_for is not None and not self.episode.used

    @property
    def closes_in(self) -> float | None:
        """Seconds until it is closed if nobody comes, where it is kept open for somebody."""
        until = self.episode.pauses.until.get(PauseReason.DESERTED) if self.reserved else None
        return None if until is None else round(max(0.0, until - self._now()), 3)

    # Coming and going

    def enter(self, session: Session, request: messages.Join, max_spectators: int) -> None:
        """Take seats or watch; the session gets `joined` and a first snapshot."""
        self._write_ahead.check()
        if self.bans(session.id, session.participant):
            raise ProtocolError("episode/banned", "you were sent out of this episode", "episode")
        name = self._names.choose(session.given_name)
        if request.role == "player":
            session.players = self.episode.join_several(
                self._turnover.choose(
                    self.episode, request, self._now(), idle=self._may_idle(session, request)
                ),
                name,
                session.kind,
                self._now(),
                session=session.id,
                participant=session.participant,
                ready=request.ready,
            )
            self.players |= {session.id, session.participant}
        elif self.spectators >= max_spectators:
            message = f"{max_spectators} spectators watch already"
            raise ProtocolError("episode/full", message, "role")
        else:
            session.players = ()
            self._forget_away(max_spectators)
            self._names.watch(name)
        session.name, session.room = name, self
        session.view = request.view
        session.known = set(request.known)
        self.flush()
        self.members.append(session)
        welcome = partial(self._welcome, session, request.ref)
        self._write_ahead.when_committed(session, welcome)

    def _may_idle(self, session: Session, request: messages.Join) -> bool:
        """Whether a newcomer may stand still for long: a person who is still to say that they are
        ready. In a study, where there are tokens, labels or treatments, seats are given in their
        order."""
        seats = self.episode.seats.values()
        study = session.token_id or self.labels or any(s.treatment != NO_TREATMENT for s in seats)
        return session.kind == Controller.HUMAN and not request.ready and not study

    def _forget_away(self, most: int) -> None:
        """Of the spectators who are away, and may come back for a while, there are not more than
        may watch."""
        away = [one for one in self.members if not one.players and one.peer is None]
        if len(away) >= most > 0:
            longest = min(away, key=lambda one: one.away_since)
            self._forget(longest)

    def _forget(self, session: Session) -> None:
        """Somebody who is away has lost the place."""
        self._remove(session)
        self._host.vacated(session)

    def _welcome(self, session: Session, ref: int | None) -> None:
        self.broadcaster.welcome(session, ref, self._host.resume_token(session))
        self.broadcaster.send(session, self.broadcaster.roster())
        if not session.players:
            self._spectator_rosters.changed()

    def set_ready(self, session: Session, ready: bool) -> None:
        """A player is ready for the beginning, or is not any more; each change is recorded.

        ProtocolError `seat/none` for a spectator, `rate/seats` if that is too often.
        """
        session.own_seat(None)
        seats = self.episode.seats_of(session.players)
        if self.episode.phase is not Phase.WAITING or all(seat.ready == ready for seat in seats):
            return
        self._write_ahead.check_space()
        self._turnover.charge(session.players, self._now(), "was ready, and then not,")
        self.episode.set_ready(session.players, ready, self._now())
        self.flush()

    def leave(self, session: Session, why: Departure = Departure.LEFT) -> None:
        """Leave for good."""
        players = self._remove(session)
        if players:
            self.episode.leave(players, self._now(), why)
        else:
            self._spectator_rosters.changed()
        self.flush()

    def _remove(self, session: Session) -> tuple[str, ...]:
        """Take a session out of the room; the seats it had."""
        if session in self.members:
            self.members.remove(session)
        self._write_ahead.forget(session)
        players, session.room, session.players = session.players, None, ()
        if not players:
            self._names.release(session.name)
        session.name = session.given_name
        return players

    def seat_again(self, session: Session, players: tuple[str, ...]) -> None:
        """A participant of a process before this one has the place again, and its seats' name; a
        spectator's may be somebody else's by now."""
        session.room, session.players = self, players
        if players:
            session.name = self.episode.seats[players[0]].name
        else:
            session.name = self._names.choose(session.given_name)
            self._names.watch(session.name)
        self.members.append(session)

    def connection_lost(self, session: Session) -> None:
        """The seats of a player are kept; a spectator is only not told anything."""
        session.away_since = self._now()
        if not session.players:
            self._spectator_rosters.changed()
        self.episode.set_present(session.players, False, self._now())
        self.flush()

    def check_return(self, session_id: str) -> None:
        """ProtocolError `server/recording` while so much cannot be written that no more coming and
        going can be recorded, `rate/seats` where somebody comes and goes all the time: who comes
        back now has to try again."""
        self._write_ahead.check_space()
        if self.episode.phase is not Phase.ENDED:
            players = self.players_of(session_id)
            self._turnover.charge(players, self._now(), "has lost and regained its connection")

    def connection_back(self, session: Session, seen: messages.Seen | None) -> None:
        """A session is here again: send it what it has missed."""
        self.episode.set_present(session.players, True, self._now(), generation=session.generation)
        self.flush()
        resume = self._host.resume_token(session)
        welcome = partial(self.broadcaster.welcome_back, session, seen, resume)
        self._write_ahead.when_committed(session, welcome)
        if not session.players:
            self._spectator_rosters.changed()

    def players_of(self, session_id: str) -> tuple[str, ...]:
        """The seats that belong to a session, in this process or one before."""
        seats = self.episode.seats.values()
        return tuple(s.player for s in seats if s.taken and s.session == session_id)

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
        self.broadcaster.send(session, messages.Left(episode=self.id, reason=reason))

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

    def play_again(self, code: str) -> None:
        """The game is over: tell those who are still here where it is played again."""
        self.broadcaster.rematch = code
        self.broadcaster.publish_roster()

    def dismiss(self) -> None:
        """Tell those who are still here that the room is closed."""
        for session in list(self.members):
            self._remove(session)
            self.broadcaster.send(
                session, messages.Left(episode=self.id, reason="the episode is over")
            )

    # Playing

    def act(self, session: Session, request: messages.Act) -> None:
        """Submit a seat's action; whatever is wrong with it is answered by `rejected`."""
        self._actions.submit(session, request, self._now())
        self.flush()

    def refuse(self, session: Session, request: messages.Act, why: ProtocolError) -> None:
        """Answer a request to act that is not looked at, and record it."""
        self._actions.refuse(session, request, why, self._now())
        self.flush()

    def record_unreadable(self, session: Session, message: bytes | str, why: ProtocolError) -> None:
        """Record what a player has sent and nobody can read; it is answered elsewhere."""
        self._actions.record_unreadable(session, message, why, self._now())
        self.flush()

    def say(self, session: Session, text: str) -> None:
        self._write_ahead.check()
        if self.mutes(session):
            raise ProtocolError("seat/muted", "the operator has muted you in this episode", "text")
        self.episode.say(session.name, session.player or "", text, self._now())
        session.recorded_bytes += len(text.encode())
        self.flush()

    def note(self, session: Session, request: messages.Note) -> None:
        """Record what a player notes; nobody is told."""
        self._write_ahead.check()
        player = session.own_seat(request.seat)
        topic, text = request.topic, request.text
        self.episode.note(player, topic, text, self._now(), more=request.more)
        session.recorded_bytes += len(text.encode())
        self.flush()

    def ask_snapshot(self, session: Session) -> None:
        """The whole state, once for each turn of the event loop."""
        self.broadcaster.ask_snapshot(session)

    def _send_snapshot(self, session: Session) -> None:
        """The whole state, once all that led to it is written."""
        send = partial(self.broadcaster.send_snapshot, session)
        self._write_ahead.when_committed(session, send)

    def _substitute(self, player: str, action: GroundAction | None) -> None:
        self.episode.substitute(player, action, self._now())
        self.flush()

    def look_at_round_trips(self) -> bool:
        """Record how long messages take to the players and back, where that has changed, and tell
        everybody where it has changed much; whether there was anything."""
        if not self.episode.running or self._write_ahead.failing:
            return False
        told, recorded = self._round_trips.look(self.members)
        if told:
            self.broadcaster.publish_roster()
        for player, seconds in recorded:
            self.episode.note_round_trip(player, seconds, self._now())
        if recorded:
            self.flush()
        return told or bool(recorded)

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
            self._host.timers.cancel(self._timer)
        self._timer = None if due is None else self._host.timers.call_at(due, self._on_time)

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

    # Publishing

    def flush(self, *, retry: bool = False) -> None:
        """Record what has happened, then publish it; nothing is published that is not written."""
        if not self._open:
            return
        begun = self._now()
        events = self._write_ahead.flush(begun, retry=retry)
        if events:
            self._published(events, begun)
        if not self._open:
            return
        if self._write_ahead.failing:
            self._retry_later()
            return
        self._schedule()
        self._publisher.follow_up()

    def _published(self, events: list[Event], begun: float) -> None:
        if isinstance(events[0], Stepped):
            self._metrics.age.observe(self._now() - begun)
        if self._host.observer is not None:
            self._host.observer.published(self, events)
        if self.episode.phase is Phase.ENDED:
            self._close()
        elif self.journal is not None and self.journal.full:
            self.abort("the recording is as long as one may be")

    def _retry_later(self) -> None:
        if self._retry is None:
            self._retry = self._loop.call_later(RETRY_SECONDS, self._write_again)

    def _write_again(self) -> None:
        self._retry = None
        try:
            self.flush(retry=True)
        except Exception:
            self._fail()

    def _failing_changed(self, failing: bool) -> None:
        """The recording begins to fail, or can be written again."""
        if failing:
            self._metrics.failing.inc()
            self.broadcaster.publish_unwritable()
        else:
            self._metrics.failing.dec()
            self._spectator_rosters.released()

    # The end

    def suspend(self) -> None:
        """Stop here and now; another process goes on with the recording."""
        self._open = False
        self._stop_timers()
        if self.journal is not None:
            self.journal.release()

    def _stop_timers(self) -> None:
        if self._timer is not None:
            self._host.timers.cancel(self._timer)
        if self._retry is not None:
            self._retry.cancel()
        self._publisher.stop()

    def _close(self) -> None:
        self._open = False
        self._stop_timers()
        self._host.closed(self)
        outcome = self.episode.outcome
        get_logger().info(
            "episode over",
            episode=self.id,
            task=self.world.task.name,
            reason=outcome.reason.value if outcome else "",
            steps=self.episode.step,
        )
