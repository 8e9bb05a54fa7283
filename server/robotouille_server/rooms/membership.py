"""Membership of one room: participants, spectators, absences and moderation."""

from __future__ import annotations

from collections.abc import Mapping, Set
from functools import partial

from robotouille.episode import Controller, Departure, Episode, Moderation, Phase
from robotouille.episode.rules import NO_TREATMENT
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.rooms.participants.limited_sight import check_limited_sight
from robotouille_server.rooms.participants.seat_limits import (
    ChatLimits,
    DisplayNames,
    FirstNames,
    SeatTurnover,
)
from robotouille_server.rooms.participants.session import JoinedRoom, Session
from robotouille_server.rooms.participants.sessions import Sessions
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.publishing.publisher import SpectatorRosters
from robotouille_server.rooms.recording.write_ahead import CommitGate


class Membership:
    """Sessions in a room, and their seats.

    Methods that change the episode take the time last and do not publish anything: the room calls
    them through `EpisodeDriver.apply`.

    Attributes:
        ever_seated: Ids of all sessions and participants who have had a seat in this process.
        first_names: The names that bearers of tokens for the episode keep if chat is limited.
    """

    __slots__ = (
        "_broadcaster",
        "_chat_limits",
        "_episode",
        "_gate",
        "_labels",
        "_names",
        "_rosters",
        "_sessions",
        "_turnover",
        "ever_seated",
        "first_names",
    )

    def __init__(
        self,
        episode: Episode,
        broadcaster: Broadcaster,
        gate: CommitGate,
        rosters: SpectatorRosters,
        sessions: Sessions,
        labels: Mapping[str, str],
        now: float,
    ) -> None:
        self._episode = episode
        self._broadcaster = broadcaster
        self._gate = gate
        self._rosters = rosters
        self._sessions = sessions
        self._labels = labels
        self._names = DisplayNames(partial(_named_seats, episode))
        self._turnover = SeatTurnover(episode.world.players, now)
        self._chat_limits = ChatLimits(episode.world.players, now)
        taken = [seat for seat in episode.seats.values() if seat.taken]
        self.ever_seated = {one for seat in taken for one in (seat.session, seat.participant)}
        self.first_names = FirstNames({seat.participant: seat.name for seat in taken})

    # Coming in

    def join(
        self,
        room: JoinedRoom,
        session: Session,
        request: messages.Join,
        max_spectators: int,
        now: float,
    ) -> None:
        """Take the requested seats, or become a spectator.

        The session does not receive messages yet: `welcome` must be the first one.
        """
        self._gate.check()
        if self.bans(session.id, session.participant):
            raise ProtocolError("episode/banned", "you were removed from this episode", "episode")
        if self._episode.record.sight is not None:
            check_limited_sight(session.role, request)
        chat = self._episode.rules.chat
        if own := self._own_seats(session, request):
            self._take_over(session, own, request, now)
            name = session.name
        elif request.role == "player":
            players = self._turnover.choose(
                self._episode, request, now, idle=self._may_idle(session, request)
            )
            name = self._names.choose(self.first_names.choose(session, chat), players)
            session.players = self._episode.join_several(
                players,
                name,
                session.kind,
                now,
                session=session.id,
                participant=session.participant,
                generation=session.generation,
                ready=request.ready,
                agent=request.agent,
            )
            # Both ids are kept: a participant with a token has the same pseudonym in a new session,
            # but one without a token has only the session's id (see `FinishedGame.check`).
            self.ever_seated |= {session.id, session.participant}
        elif self._broadcaster.spectators_here >= max_spectators:
            raise too_many_spectators(max_spectators)
        else:
            session.players = ()
            name = self._names.choose(self.first_names.choose(session, chat))
            self._names.watch(name)
        # This comes after everything that may raise, so that a refused `join` does not change the
        # session.
        session.name, session.room = name, room
        session.view = request.view
        session.known = set(request.known)

    def _own_seats(self, session: Session, request: messages.Join) -> tuple[str, ...]:
        """Return the requested seats if the participant of a token has them in another session.

        The token must be for this episode, because several programs may share any other token.
        """
        limits = session.limits
        if request.role != "player" or not limits.only_episode:
            return ()
        seats = self._episode.seats.values()
        held = [s for s in seats if s.taken and s.participant == session.participant]
        named = () if request.seats == "all" else request.seats
        wanted = {request.seat} if request.seat else {*named}
        # Absent seats first: their participant has to come back to them.
        for seat in sorted(held, key=lambda one: one.present):
            players = self.players_of(seat.session)
            alone = not limits.only_seat or players == (limits.only_seat,)
            if alone and wanted <= {*players}:
                return players
        return ()

    def _take_over(
        self, session: Session, players: tuple[str, ...], request: messages.Join, now: float
    ) -> None:
        """Give a participant's seats to its new session, and close the older connection."""
        self._turnover.charge(players, now, "has lost and regained its connection")
        self._episode.take_over(
            players,
            session.kind,
            now,
            session=session.id,
            generation=session.generation,
            agent=request.agent,
        )
        old = self._broadcaster.holder(players[0])
        if old is not None:
            self._remove(old)
            self._supersede(old)
        self._episode.set_ready(players, request.ready, now)
        session.players, session.name = players, self._episode.seats[players[0]].name
        self.ever_seated.add(session.id)

    def _supersede(self, old: Session) -> None:
        if old.peer is None:
            # If it comes back, it learns that it is no longer in the episode. Otherwise it would
            # join again and take the seat back.
            self._sessions.sent_out(old)
        else:
            old.peer.close("session/elsewhere", "you joined with the same token elsewhere")

    def _may_idle(self, session: Session, request: messages.Join) -> bool:
        """Return whether the newcomer may stand still for long, as people do before they are ready.

        The answer is False in studies (with tokens, labels or treatments), which assign seats in
        order, so that conditions do not depend on who is quick.
        """
        seats = self._episode.seats.values()
        study = session.token_id or self._labels or any(s.treatment != NO_TREATMENT for s in seats)
        return session.kind == Controller.HUMAN and not request.ready and not study

    def _limit_away(self) -> None:
        """Remove the spectator who has been away longest, if too many spectators are away."""
        away = [s for s in self._broadcaster.members if not s.players and s.peer is None]
        # Absent spectators do not count towards the limit. Without a bound of their own, a client
        # that joins or resumes and disconnects in a loop would fill the room with sessions.
        if len(away) > self._sessions.max_spectators:
            self.vacate(min(away, key=lambda one: one.away_since))

    def welcome(self, session: Session, ref: int | None) -> None:
        """Send a newcomer `joined`, a snapshot and the roster, once the recording is written."""
        # The newcomer is a member before the recording is written, so that a roster about a failing
        # recording reaches them too. `joined` and the snapshot wait for the commit.
        self._broadcaster.enter(session)
        self._gate.when_committed(session, lambda: self._welcome(session, ref))

    def _welcome(self, session: Session, ref: int | None) -> None:
        self._broadcaster.welcome(session, ref, self._sessions.resume_token(session))
        self._broadcaster.send(session, self._broadcaster.roster())
        if not session.players:
            self._rosters.changed()

    def set_ready(self, session: Session, ready: bool, now: float) -> None:
        """Change whether a player is ready. Each change is recorded.

        Raises:
            ProtocolError: `seat/none` for a spectator, `rate/seats` after too many changes.
        """
        session.own_seat(None)
        seats = self._episode.record.seats_of(session.players)
        # Repeating the current value costs nothing and is not recorded. Readiness has no effect
        # after the start (docs/decisions/0037).
        if self._episode.phase is not Phase.WAITING or all(seat.ready == ready for seat in seats):
            return
        # The check comes first, so that a refused change is not charged to the seat.
        self._gate.check_space()
        self._turnover.charge(session.players, now, "has changed its readiness")
        self._episode.set_ready(session.players, ready, now)

    def check_chat(self, session: Session, now: float) -> None:
        """Check whether a participant may post a chat message now, and charge for it.

        Raises:
            ProtocolError: `seat/muted` for a muted participant, `rate/chat` after too many lines.
        """
        if self.mutes(session):
            raise ProtocolError("seat/muted", "the operator has muted you in this episode", "text")
        self._chat_limits.charge(session, now)

    @property
    def banned(self) -> Set[str]:
        """Sessions and participants who were removed."""
        return self._episode.record.banned

    def spectators_changed(self) -> None:
        """Publish a roster, because spectators have come or gone on another node."""
        self._rosters.changed()

    def forget(self, recipient: Session) -> None:
        """Drop what waits for the recording to be written."""
        self._gate.forget(recipient)

    # Leaving

    def leave(self, session: Session, now: float, why: Departure = Departure.LEFT) -> None:
        """Remove a session and free its seats."""
        players = self._remove(session)
        # Spectators are not recorded (docs/decisions/0014), so only a roster shows that they have
        # left.
        if players:
            self._episode.leave(players, now, why)
        else:
            self._rosters.changed()

    def _remove(self, session: Session) -> tuple[str, ...]:
        """Remove a session without freeing its seats, and return them."""
        self._broadcaster.leave(session)
        self._gate.forget(session)
        players, session.room, session.players = session.players, None, ()
        # Only the names of spectators are kept here: the episode has the names of players.
        if not players:
            self._names.release(session.name)
        session.name = session.given_name
        return players

    def vacate(self, session: Session) -> None:
        """Remove a session that is away and has lost its place."""
        self._remove(session)
        self._sessions.forget(session)

    def dismiss(self, episode_id: str) -> None:
        """Remove everybody, because the room is closed."""
        for session in list(self._broadcaster.members):
            self._remove(session)
            left = messages.Left(episode=episode_id, reason="the episode has ended")
            self._broadcaster.send(session, left)

    # Lost connections

    def connection_lost(self, session: Session, now: float) -> None:
        """Mark a participant as absent; spectators just stop receiving messages."""
        session.away_since = now
        if not session.players:
            self._limit_away()
            self._rosters.changed()
        self._episode.set_present(session.players, False, now)

    def check_return(self, session_id: str, now: float) -> None:
        """Check whether a session may come back now.

        Raises:
            ProtocolError: `server/recording` if too much of the recording is unwritten,
                `rate/seats` if the session comes and goes too often.
        """
        self._gate.check_space()
        # Returning to an ended episode changes no seat and adds nothing to the recording.
        if self._episode.phase is not Phase.ENDED:
            players = self.players_of(session_id)
            self._turnover.charge(players, now, "has lost and regained its connection")

    def welcome_back(self, session: Session, seen: messages.Seen | None) -> None:
        """Send a session what it has missed, once the recording is written."""
        resume = self._sessions.resume_token(session)
        self._gate.when_committed(
            session, lambda: self._broadcaster.welcome_back(session, seen, resume)
        )
        if not session.players:
            self._rosters.changed()

    def readmit(self, room: JoinedRoom, session: Session, players: tuple[str, ...]) -> None:
        """Give a session of an earlier process its seats and name back."""
        session.room, session.players = room, players
        session.name = self._episode.seats[players[0]].name
        self._broadcaster.enter(session)

    def players_of(self, session_id: str) -> tuple[str, ...]:
        """Return the seats of a session, whether it joined in this process or an earlier one."""
        seats = self._episode.seats.values()
        return tuple(s.player for s in seats if s.taken and s.session == session_id)

    # Moderation

    def bans(self, session_id: str, participant: str) -> bool:
        """Return whether a participant was removed, in this session or another."""
        # The pseudonym is checked, too: otherwise a banned participant could return with the same
        # token in a new session (docs/security.md, "Returning after a ban").
        return not self._episode.record.banned.isdisjoint((session_id, participant))

    def mutes(self, session: Session) -> bool:
        """Return whether a participant may not chat, in this session or another."""
        return session.participant in self._episode.record.muted

    def moderate(self, what: Moderation, session: Session, now: float) -> None:
        """Ban, mute or unmute a participant."""
        self._episode.moderate(what, session.id, session.participant, session.name, now)

    def send_out(self, session: Session, episode_id: str, reason: str) -> None:
        """Tell a session that it was removed; keep the message for one that is away."""
        # Without this, an absent participant would learn of the removal only when it joins again.
        if session.peer is None:
            self._sessions.sent_out(session)
        # The closed recording of an ended episode does not show the removal.
        if self._episode.phase is Phase.ENDED:
            self._sessions.bar(session)
        self._broadcaster.send(session, messages.Left(episode=episode_id, reason=reason))


def _named_seats(episode: Episode) -> list[tuple[str, str]]:
    return [(seat.player, seat.name if seat.taken else "") for seat in episode.seats.values()]


def too_many_spectators(most: int) -> ProtocolError:
    message = f"the episode has {most} spectators already"
    return ProtocolError("episode/full", message, "role")
