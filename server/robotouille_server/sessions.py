"""All sessions of a server: new ones, and those that come back with a resume token."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from robotouille.episode.names import proper_name
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.access import Visitor
from robotouille_server.roles import Role
from robotouille_server.session import Session
from robotouille_server.tokens import ResumeGrant, RoleGrant, Tokens

if TYPE_CHECKING:
    from robotouille_server.room import Room

__all__ = ["Sessions"]


class Sessions:
    """Sessions by id.

    Of a session's resume tokens the one that was used last is still good, since what it was
    answered may have been lost on the way, and so is the next; those before are worth nothing.
    """

    def __init__(self, tokens: Tokens, randomness: random.Random, token_seconds: float) -> None:
        self.by_id: dict[str, Session] = {}
        self._tokens = tokens
        self._random = randomness
        self._token_seconds = token_seconds

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
        )
        self.by_id[session.id] = session
        return session

    def resume(self, grant: ResumeGrant, room: Room | None) -> Session:
        """The session of a resume token, from memory or from the seat that is recorded as its.

        ProtocolError `auth/expired` where the session or the token has had its day.
        """
        session = self.by_id.get(grant.session) or self._from_before(grant, room)
        if session is None:
            message = "this connection cannot be resumed any more; say hello without 'resume'"
            raise ProtocolError("auth/expired", message, "resume")
        if grant.generation < session.generation:
            message = "this token was used before, and replaced; say hello without 'resume'"
            raise ProtocolError("auth/expired", message, "resume")
        session.generation = grant.generation
        if self._tokens.past(session.role_expires) and session.role.includes(Role.PLAYER):
            session.role = Role.PLAYER  # It keeps its seat, not what else the token allowed.
        return session

    def _from_before(self, grant: ResumeGrant, room: Room | None) -> Session | None:
        """A session of a process before this one: whoever has a seat, or watched."""
        if room is None or grant.session in room.banned:
            return None
        player = room.holds_seat(grant.session)
        if player is None and (grant.seat or grant.episode != room.id):
            return None
        seat = room.episode.seats[player] if player is not None else None
        session = Session(
            grant.session,
            name=grant.name,
            kind=grant.kind,
            role=grant.role,
            participant=seat.participant if seat is not None else grant.participant,
            only_episode=grant.only_episode,
            only_seat=grant.only_seat,
            role_expires=grant.role_expires,
        )
        session.generation = seat.generation if seat is not None else grant.generation
        if grant.generation < session.generation:
            return session  # A dead token: it opens nothing, and takes no place.
        session.view = grant.view
        room.seat_again(session, player)
        self.by_id[session.id] = session
        return session

    def resume_token(self, session: Session) -> str:
        """The token that brings a session back, the next time."""
        return self._tokens.mint_resume(
            session=session.id,
            generation=session.generation + 1,
            name=session.name if session.player is None else session.given_name,
            kind=session.kind,
            role=session.role,
            seconds=self._token_seconds,
            episode=session.room.id if session.room is not None else "",
            seat=session.player or "",
            only_episode=session.only_episode,
            only_seat=session.only_seat,
            view=session.view,
            role_expires=session.role_expires,
            participant=session.participant if session.participant != session.id else "",
        )

    def forget(self, session: Session) -> None:
        """A session that has no place any more, and nobody connected to it."""
        if session.peer is None:
            self.by_id.pop(session.id, None)

    def role_of(
        self, hello: messages.Hello, visitor: Visitor, *, strict: bool
    ) -> tuple[Role, RoleGrant | None]:
        """What a newcomer may do. Without a token a program on this machine may do what a host
        may, anybody else play; where `strict`, nobody may do anything."""
        if hello.token is not None:
            grant = self._tokens.check_role(hello.token)
            return grant.role, grant
        if strict:
            raise ProtocolError("auth/required", "this server asks for a token", "token")
        return (Role.HOST if visitor.local else Role.PLAYER), None
