"""Sessions of a server: new ones, and those that come back with a resume token."""

from __future__ import annotations

import asyncio
import random

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.participant_names import proper_name
from robotouille_server.auth import (
    Credentials,
    ResumeGrant,
    Role,
    RoleGrant,
    Visitor,
    check_scope,
)
from robotouille_server.auth.replaced_tokens import ALL
from robotouille_server.rooms.participants.limited_sight import NOT_WATCHED, may_watch
from robotouille_server.rooms.participants.session import (
    NO_LIMITS,
    JoinedRoom,
    Session,
    SessionLimits,
)
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.settings import ServerSettings

SENT_OUT_SECONDS = 600.0
"""Seconds for which the removal of an absent participant is remembered, to explain it later."""
REVOKED_LOOK_SECONDS = 1.0
"""Seconds between two checks of the list of revoked tokens."""


class Sessions:
    """Sessions by id.

    A session without a connection is kept for the grace of its room. A session accepts its last
    used resume token and the next one, because the answer to the last one may have been lost.
    Earlier tokens are invalid. Tokens of a session without a seat are invalid once it is forgotten.

    Attributes:
        max_spectators: The limit of connected spectators of an episode, and of absent ones.
    """

    def __init__(
        self,
        settings: ServerSettings,
        metrics: Metrics,
        credentials: Credentials,
        randomness: random.Random,
    ) -> None:
        self.by_id: dict[str, Session] = {}
        self._metrics = metrics
        self._tokens = credentials.tokens
        self._used = credentials.used
        self._replaced = credentials.replaced
        self._revoked = credentials.revoked
        self._random = randomness
        self._strict = settings.require_token
        self.max_spectators = settings.max_spectators
        self._token_seconds = settings.resume_hours * 3600
        self._checked: frozenset[str] = frozenset()
        self._token_watch: asyncio.TimerHandle | None = None
        self._expiries: dict[Session, asyncio.TimerHandle] = {}
        self._stopped = False

    # New sessions

    def role_of(self, hello: messages.Hello, visitor: Visitor) -> tuple[Role, RoleGrant | None]:
        """Return the role of a new participant, and the grant of its role token."""
        if hello.token is None:
            return self._role_without_token(visitor, "token"), None
        grant = self._tokens.check_role(hello.token)
        # The token is only checked here, and used up by the first join. A client that loses its
        # connection before it has joined can therefore try again.
        if grant.once:
            self._used.check(grant.token_id)
        return grant.role, grant

    def _role_without_token(self, visitor: Visitor, field: str) -> Role:
        """Return `host` for programs on this machine, `player` for all others."""
        # This applies to local programs, too: on a shared machine, every user is local
        # (docs/security.md).
        self._check_strict(field)
        return Role.HOST if visitor.local else Role.PLAYER

    def _check_strict(self, field: str) -> None:
        if self._strict:
            raise ProtocolError("auth/required", "this server requires a token", field)

    def open(self, hello: messages.Hello, role: Role, grant: RoleGrant | None) -> Session:
        """Open a session. The name in a token takes precedence over the client's."""
        name = proper_name(grant.name if grant is not None else "") or proper_name(hello.name)
        if not name:
            message = "the name has no visible character"
            raise ProtocolError("message/invalid-field", message, "name")
        session = Session(
            # Ids appear in recordings and are no secret. Only the signature of a resume token gives
            # access to a session.
            f"{self._random.getrandbits(64):016x}",
            name=name,
            kind=hello.kind,
            role=role,
            participant=grant.subject if grant is not None else "",
            limits=_limits(grant),
        )
        self.by_id[session.id] = session
        return session

    # Returning sessions

    def check_may_return(self, grant: ResumeGrant) -> None:
        """Raise ProtocolError `auth/required` if a session without a token may not come back."""
        if grant.anonymous:
            self._check_strict("resume")

    def judge(self, grant: ResumeGrant, room: JoinedRoom | None, visitor: Visitor) -> Role:
        """Return the role with which a session may come back under the current rules.

        Nothing is changed.

        Args:
            grant: The content of the resume token.
            room: The room that the token leads to.
            visitor: Where the connection comes from.

        Raises:
            ProtocolError: `auth/expired` if the session, its place or the token has expired,
                `auth/required` if the server now requires a role token.
        """
        session = self.by_id.get(grant.session)
        home, players = _place(session, grant, room)
        # Older tokens are refused, because a copied token must become worthless once its owner has
        # returned. For a session that this process does not know, only the recorded seats show
        # which tokens are older (docs/decisions/0014).
        if session is not None:
            used = session.generation
        elif home is not None:
            used = home.seat(players[0]).generation
            if home.ended:
                used = max(used, self._replaced.last_used(grant.session))
        else:
            raise _expired("this connection cannot be resumed any more")
        if grant.generation < used:
            raise _expired("this token was used before and has been replaced")
        role = self._current_role(grant, visitor, seated=bool(players))
        # Everything that `join` would check is checked again: bans, the scope and the limits may
        # have changed since the token was signed.
        if home is not None:
            self._check_place(session, grant, home, role)
        return role

    def _current_role(self, grant: ResumeGrant, visitor: Visitor, *, seated: bool) -> Role:
        """Return the role of a returning session.

        `require_token` or a proxy may have been set up since its token was signed, and the client
        may now come from elsewhere.
        """
        if grant.anonymous:
            return self._role_without_token(visitor, "resume")
        if not self._tokens.past(grant.role_expires):
            return grant.role
        if not seated and self._strict:
            raise _expired("the role token of this connection has expired")
        # The session keeps its seats after its token has expired, but no other privileges.
        return Role.PLAYER if grant.role.includes(Role.PLAYER) else grant.role

    def _check_place(
        self, session: Session | None, grant: ResumeGrant, room: JoinedRoom, role: Role
    ) -> None:
        if room.bans(grant.session, grant.participant):
            raise _expired("you were removed from this episode")
        check_scope(grant.only_episode, room.id, room.code, "resume")
        if session is None:
            # Another node of a cluster may have replaced the token after the end. It may show the
            # end again, but grants no role that a stranger could misuse.
            if room.ended and not grant.anonymous and role.includes(Role.HOST):
                raise _expired("the episode of this connection has ended")
        elif not session.players:
            if room.limits_sight and not may_watch(role):
                raise _expired(NOT_WATCHED)
            # A second connection that takes over a watching session does not add a spectator.
            if session.peer is None and room.spectators_here >= self.max_spectators:
                raise _expired(f"the episode has {self.max_spectators} spectators already")

    def resume(self, grant: ResumeGrant, room: JoinedRoom | None, role: Role) -> Session:
        """Return the session of a resume token that `judge` has accepted."""
        session = self.by_id.get(grant.session)
        if session is None:
            if room is None:
                raise _expired("this connection cannot be resumed any more")
            session = self._from_before(grant, room)
        ended = session.room is not None and session.room.ended
        if ended and session.players and grant.generation > session.generation:
            self._replaced.note(session.id, grant.generation)
        # The client has proved that it received this token, so earlier ones are obsolete.
        session.generation = grant.generation
        session.role = role
        return session

    def _from_before(self, grant: ResumeGrant, room: JoinedRoom) -> Session:
        """Restore a session of an earlier process, from its token and the recorded seats."""
        players = room.players_of(grant.session)
        session = Session(
            grant.session,
            name=grant.name,
            kind=grant.kind,
            role=grant.role,
            # The recording has the pseudonym that the episode was played under.
            participant=room.seat(players[0]).participant,
            limits=SessionLimits(
                grant.only_episode, grant.only_seat, grant.role_expires, grant.token_id
            ),
        )
        session.view = grant.view
        room.readmit(session, players)
        self.by_id[session.id] = session
        return session

    def resume_token(self, session: Session) -> str:
        """Return the token with which the client can resume the session next time."""
        limits = session.limits
        grant = ResumeGrant(
            session=session.id,
            # This token has the next generation. The current one stays valid until the client has
            # used this token, because the message with it may be lost.
            generation=session.generation + 1,
            name=session.given_name if session.players else session.name,
            kind=session.kind,
            role=session.role,
            episode=session.room.id if session.room is not None else "",
            seat=session.player or "",
            only_episode=limits.only_episode,
            only_seat=limits.only_seat,
            view=session.view,
            role_expires=limits.role_expires,
            token_id=limits.token_id,
            # Every `joined` and `welcome` has a token, so the pseudonym is left out if it equals
            # the session id.
            participant=session.participant if session.participant != session.id else "",
        )
        return self._tokens.mint_resume(grant, self._token_seconds)

    # Connections

    def connected(self, session: Session) -> None:
        """Keep a session, because it has a connection (again)."""
        self._keep(session)
        # The watch runs only while a connection has a token. Without tokens, the server sets no
        # timer.
        if session.token_id and self._token_watch is None and not self._stopped:
            self._watch_tokens()

    def disconnected(self, session: Session) -> None:
        """Let a session without a connection expire after the grace of its room.

        A player's session does not expire while the episode runs: the episode frees its seats.
        """
        room = session.room
        if room is not None:
            room.connection_lost(session)
        # The sessions of players whose grace has passed are dropped by `Membership.vacate`, so that
        # seat and session end in the same step.
        if not session.players or room is None or room.ended:
            self._expire_in(room.grace if room is not None else 0.0, session)

    def sent_out(self, session: Session) -> None:
        """Keep the session of a removed participant for a while, to tell it when it returns."""
        self._keep(session)
        self._expire_in(SENT_OUT_SECONDS, session)

    def bar(self, session: Session) -> None:
        """Refuse all resume tokens of a session, also in later processes."""
        self._replaced.note(session.id, ALL)

    def stop(self) -> None:
        """Cancel all timers."""
        self._stopped = True
        for expiry in self._expiries.values():
            expiry.cancel()
        if self._token_watch is not None:
            self._token_watch.cancel()
            self._token_watch = None

    def forget(self, session: Session) -> None:
        """Forget a session that has lost its place, unless it has a connection."""
        if session.peer is None:
            self.drop(session)

    def drop(self, session: Session) -> None:
        """Forget a session that another node has, even if it has a connection."""
        self.by_id.pop(session.id, None)
        # The timer would keep the session in memory for the grace, which may be a day.
        self._keep(session)

    def _keep(self, session: Session) -> None:
        """Cancel the expiry of a session."""
        expiry = self._expiries.pop(session, None)
        if expiry is not None:
            expiry.cancel()

    def _expire_in(self, seconds: float, session: Session) -> None:
        later = asyncio.get_running_loop().call_later
        self._expiries[session] = later(seconds, self._expire, session)

    def _expire(self, session: Session) -> None:
        self._expiries.pop(session, None)
        if session.peer is None:
            if session.room is not None:
                session.room.leave(session)
            self.forget(session)

    # Revoked tokens

    def _watch_tokens(self) -> None:
        later = asyncio.get_running_loop().call_later
        self._token_watch = later(REVOKED_LOOK_SECONDS, self._check_tokens)

    def _check_tokens(self) -> None:
        self._token_watch = None
        if self._cut_revoked(self._revoked.ids):
            self._watch_tokens()

    def _cut_revoked(self, revoked: frozenset[str]) -> bool:
        """Close connections with newly revoked tokens; return whether others have tokens."""
        bearers = (s for s in self.by_id.values() if s.token_id and s.peer is not None)
        # `Revocations` returns the same object until the file changes, so the usual check compares
        # two references instead of going through all sessions.
        if revoked is self._checked:
            return any(bearers)
        self._checked = revoked
        left = 0
        for session in list(bearers):
            left += session.token_id not in revoked
            if session.token_id in revoked and session.peer is not None:
                self._metrics.dropped.labels("revoked").inc()
                session.peer.close("auth/revoked", "the operator has revoked your token")
        return left > 0


def _limits(grant: RoleGrant | None) -> SessionLimits:
    if grant is None:
        return NO_LIMITS
    return SessionLimits(grant.episode, grant.seat, grant.expires, grant.token_id, grant.once)


def _place(
    session: Session | None, grant: ResumeGrant, room: JoinedRoom | None
) -> tuple[JoinedRoom | None, tuple[str, ...]]:
    """Return the room and seats to which a session comes back; no room if its place is gone."""
    if session is not None:
        return session.room, session.players
    players = room.players_of(grant.session) if room is not None else ()
    return (room if players else None), players


def _expired(why: str) -> ProtocolError:
    """Return an error that tells the client to start a new session."""
    return ProtocolError("auth/expired", f"{why}; send hello without 'resume'", "resume")
