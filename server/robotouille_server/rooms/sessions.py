"""All sessions of a server: new ones, and those that come back with a resume token."""

from __future__ import annotations

import asyncio
import random

from robotouille.episode import Phase
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.participant_names import proper_name
from robotouille_server.auth import (
    ResumeGrant,
    Revocations,
    Role,
    RoleGrant,
    Tokens,
    UsedTokens,
    Visitor,
    check_scope,
)
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import JoinedRoom, Session
from robotouille_server.runtime.metrics import Metrics

__all__ = ["Sessions"]

SENT_OUT_SECONDS = 600.0
"""For which somebody who was sent out while away is told so at the return."""
REVOKED_LOOK_SECONDS = 1.0
"""Between two looks at the list of revoked tokens."""


class Sessions:
    """Sessions by id, until they expire: one without a connection is kept for its room's grace.

    Of a session's resume tokens the one that was used last is still good, since what it was
    answered may have been lost on the way, and so is the next; those before are worth nothing.
    """

    def __init__(
        self,
        tokens: Tokens,
        used: UsedTokens,
        revoked: Revocations,
        randomness: random.Random,
        token_seconds: float,
        metrics: Metrics,
        *,
        strict: bool = False,
        max_spectators: int = 200,
    ) -> None:
        self.by_id: dict[str, Session] = {}
        self._tokens = tokens
        self._used = used
        self._revoked = revoked
        self._judged: frozenset[str] = frozenset()
        self._token_watch: asyncio.TimerHandle | None = None
        self._expiries: dict[Session, asyncio.TimerHandle] = {}
        self._stopped = False
        self._random = randomness
        self._token_seconds = token_seconds
        self._metrics = metrics
        self._strict = strict
        self._max_spectators = max_spectators

    # Newcomers

    def role_of(self, hello: messages.Hello, visitor: Visitor) -> tuple[Role, RoleGrant | None]:
        """What a newcomer may do, and the token that says so, if one does."""
        if hello.token is None:
            return self._role_without_token(visitor, "token"), None
        grant = self._tokens.check_role(hello.token)
        if grant.once:
            self._used.check(grant.token_id)
        return grant.role, grant

    def _role_without_token(self, visitor: Visitor, field: str) -> Role:
        """A program on this machine may do what a host may, anybody else play; where the server
        is `strict`, nobody may do anything."""
        self._check_strict(field)
        return Role.HOST if visitor.local else Role.PLAYER

    def _check_strict(self, field: str) -> None:
        if self._strict:
            raise ProtocolError("auth/required", "this server asks for a token", field)

    def open(self, hello: messages.Hello, role: Role, grant: RoleGrant | None) -> Session:
        """A newcomer's session; a token's name is binding."""
        name = proper_name(grant.name if grant is not None else "") or proper_name(hello.name)
        if not name:
            message = "nothing of this name can be seen"
            raise ProtocolError("message/invalid-field", message, "name")
        session = Session(
            f"{self._random.getrandbits(64):016x}",
            name=name,
            kind=hello.kind,
            role=role,
            participant=grant.subject if grant is not None else "",
            only_episode=grant.episode if grant is not None else "",
            only_seat=grant.seat if grant is not None else "",
            role_expires=grant.expires if grant is not None else 0.0,
            token_id=grant.token_id if grant is not None else "",
            once=grant.once if grant is not None else False,
        )
        self.by_id[session.id] = session
        return session

    # Those who come back

    def check_may_return(self, grant: ResumeGrant) -> None:
        """What can be said of a resume token before anything is looked for: ProtocolError
        `auth/required` where only those with a token may come in by now."""
        if grant.anonymous:
            self._check_strict("resume")

    def judge(self, grant: ResumeGrant, room: Room | None, visitor: Visitor) -> Role:
        """Whether the session of a resume token may come back, and as what: by the rules that
        hold now. `room` is the one that the token leads to.

        ProtocolError `auth/expired` where the session, its place or the token has had its day,
        `auth/required` where only those with a token may come in by now. Nothing is changed.
        """
        session = self.by_id.get(grant.session)
        home, players = _place(session, grant, room)
        if session is None and home is None:
            raise _gone("this connection cannot be resumed any more")
        if grant.generation < _generation(session, home, players):
            raise _gone("this token was used before, and replaced")
        if home is not None:
            self._check_place(session, grant, home, watches=not players)
        if grant.anonymous:
            return self._role_without_token(visitor, "resume")
        if not self._tokens.past(grant.role_expires):
            return grant.role
        if not players and self._strict:
            raise _gone("the role token of this connection has expired")
        # It keeps its seats, not what else the token allowed.
        return Role.PLAYER if grant.role.includes(Role.PLAYER) else grant.role

    def _check_place(
        self, session: Session | None, grant: ResumeGrant, room: JoinedRoom, *, watches: bool
    ) -> None:
        """Whether there is still a place for somebody who was here."""
        if room.bans(grant.session, grant.participant):
            raise _gone("you were sent out of this episode")
        check_scope(grant.only_episode, room.id, room.code, "resume")
        watching = session is not None and session.peer is not None
        if watches and not watching and room.spectators >= self._max_spectators:
            raise _gone(f"{self._max_spectators} spectators watch already")

    def resume(self, grant: ResumeGrant, room: Room | None, role: Role) -> Session:
        """The session of a resume token that was judged to be good for this role: from memory,
        or from the seats that are recorded as its."""
        session = self.by_id.get(grant.session)
        if session is None:
            session = self._from_before(grant, room)
        session.generation = grant.generation
        session.role = role
        return session

    def _from_before(self, grant: ResumeGrant, room: Room | None) -> Session:
        """A session of a process before this one: whoever has seats, or watched."""
        _, players = _place(None, grant, room)
        seat = room.episode.seats[players[0]] if room is not None and players else None
        session = Session(
            grant.session,
            name=grant.name,
            kind=grant.kind,
            role=grant.role,
            participant=seat.participant if seat is not None else grant.participant,
            only_episode=grant.only_episode,
            only_seat=grant.only_seat,
            role_expires=grant.role_expires,
            token_id=grant.token_id,
        )
        session.view = grant.view
        if room is not None:
            room.seat_again(session, players)
        self.by_id[session.id] = session
        return session

    def resume_token(self, session: Session) -> str:
        """The token that brings a session back, the next time."""
        return self._tokens.mint_resume(
            session=session.id,
            generation=session.generation + 1,
            name=session.given_name if session.players else session.name,
            kind=session.kind,
            role=session.role,
            seconds=self._token_seconds,
            episode=session.room.id if session.room is not None else "",
            seat=session.player or "",
            only_episode=session.only_episode,
            only_seat=session.only_seat,
            view=session.view,
            role_expires=session.role_expires,
            token_id=session.token_id,
            participant=session.participant if session.participant != session.id else "",
        )

    # Connections that come and go

    def connected(self, session: Session) -> None:
        """A session has a connection (again): it does not expire."""
        self._keep(session)
        if session.token_id and self._token_watch is None and not self._stopped:
            self._watch_tokens()

    def disconnected(self, session: Session) -> None:
        """A session has lost its connection: it is kept for a while, as a player's seats are."""
        room = session.room
        if room is not None:
            room.connection_lost(session)
        if not session.players or room is None or room.episode.phase is Phase.ENDED:
            self._expire_in(room.episode.rules.grace if room is not None else 0.0, session)

    def sent_out(self, session: Session) -> None:
        """Somebody who is away is told of it at the return, if that is soon."""
        self._keep(session)
        self._expire_in(SENT_OUT_SECONDS, session)

    def stop(self) -> None:
        """Nobody expires any more, and no tokens are looked at."""
        self._stopped = True
        for expiry in self._expiries.values():
            expiry.cancel()
        if self._token_watch is not None:
            self._token_watch.cancel()
            self._token_watch = None

    def forget(self, session: Session) -> None:
        """A session that has no place any more, and nobody connected to it."""
        if session.peer is None:
            self.by_id.pop(session.id, None)

    def _keep(self, session: Session) -> None:
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

    # Tokens that are revoked

    def _watch_tokens(self) -> None:
        """Look once a second whether a token was revoked, while anybody is here with one."""
        later = asyncio.get_running_loop().call_later
        self._token_watch = later(REVOKED_LOOK_SECONDS, self._look_at_tokens)

    def _look_at_tokens(self) -> None:
        self._token_watch = None
        if self._cut_revoked(self._revoked.ids):
            self._watch_tokens()

    def _cut_revoked(self, revoked: frozenset[str]) -> bool:
        """Close the connections of those whose tokens were revoked since this was last called;
        whether anybody is connected with a token."""
        bearers = (s for s in self.by_id.values() if s.token_id and s.peer is not None)
        if revoked is self._judged:
            return any(bearers)
        self._judged = revoked
        left = 0
        for session in list(bearers):
            left += session.token_id not in revoked
            if session.token_id in revoked and session.peer is not None:
                self._metrics.dropped.labels("revoked").inc()
                session.peer.close("auth/revoked", "the operator has revoked your token")
        return left > 0


def _place(
    session: Session | None, grant: ResumeGrant, room: Room | None
) -> tuple[JoinedRoom | None, tuple[str, ...]]:
    """The room that a session comes back to, and its seats there; no room if it has no place."""
    if session is not None:
        return session.room, session.players
    if room is None:
        return None, ()
    players = room.players_of(grant.session)
    if not players and (grant.seat or grant.episode != room.id):
        return None, ()
    return room, players


def _generation(session: Session | None, room: JoinedRoom | None, players: tuple[str, ...]) -> int:
    """That of the resume token which was used last, as far as it is known."""
    if session is not None:
        return session.generation
    return room.episode.seats[players[0]].generation if room is not None and players else 0


def _gone(why: str) -> ProtocolError:
    """To be answered by a `hello` without 'resume', which is judged like anybody's."""
    return ProtocolError("auth/expired", f"{why}; say hello without 'resume'", "resume")
