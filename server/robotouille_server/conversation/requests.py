"""What a participant asks for once `hello` is answered: each request, and its answer."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.auth import Role, Visitor, check_join, check_opening, check_permission
from robotouille_server.conversation.services import Services
from robotouille_server.rooms.room import Room
from robotouille_server.rooms.session import JoinedRoom, Session
from robotouille_server.runtime.task_folder import Look
from robotouille_server.runtime.workers import ElsewhereError
from robotouille_server.transport import Peer

__all__ = ["Requests", "unheard"]


class Requests:
    """Answers what one session asks for over one connection, `counted` as whose it is."""

    __slots__ = ("_counted", "_peer", "_services", "_session")

    def __init__(self, services: Services, peer: Peer, session: Session, counted: Visitor) -> None:
        self._services = services
        self._peer = peer
        self._session = session
        self._counted = counted

    def handle(self, message: messages.ClientMessage) -> None:
        """Do what a message asks for, and answer it; ProtocolError if it cannot be done."""
        check_permission(self._session.role, message)
        HANDLERS[type(message)](self, message)

    def _hello(self, message: messages.Hello) -> None:
        raise ProtocolError("protocol/hello", "you have said hello already", "type")

    # Episodes

    def _list(self, message: messages.ListEpisodes) -> None:
        only, operator = self._session.only_episode, self._session.role is Role.OPERATOR
        lobby = self._services.lobby
        self._peer.answer(lobby.infos(message, only, self._owner, operator=operator))

    def _create(self, message: messages.Create) -> None:
        session, services = self._session, self._services
        check_opening(session.only_episode)
        asker = (session.id, session.participant)
        try:
            room = services.lobby.create(message, owner=self._owner, asker=asker)
        except ElsewhereError as error:
            self._peer.send(error.moved(message.ref))
            return
        tokens = (
            services.seat_tokens(room, message.participants, self._owner) if message.tokens else {}
        )
        created = messages.Created(ref=message.ref, episode=room.id, code=room.code, tokens=tokens)
        self._peer.send(created)

    def _close(self, message: messages.Close) -> None:
        role = self._session.role
        check_opening(self._session.only_episode)
        reason = message.reason or f"closed by the {role}"
        lobby, operator = self._services.lobby, role is Role.OPERATOR
        try:
            room = lobby.close(message.episode, reason, self._owner, operator=operator)
        except ElsewhereError as error:
            self._peer.send(error.moved(message.ref))
            return
        self._peer.send(messages.Closed(ref=message.ref, episode=room.id))

    @property
    def _owner(self) -> str:
        """The pseudonym under which somebody opens episodes; empty without a token."""
        participant = self._session.participant
        return participant if participant != self._session.id else ""

    # Coming and going

    def _join(self, message: messages.Join) -> None:
        session = self._session
        if session.room is not None:
            where = session.room.code
            raise ProtocolError("episode/joined", f"you are in {where}; leave it first", "type")
        try:
            room = self._find(message.episode)
        except ElsewhereError as error:
            self._peer.send(error.moved(message.ref))
            return
        request = message.model_copy(update={"seat": self._seat_for(message, room)})
        with self._using_token():
            room.enter(session, request, self._services.settings.max_spectators)

    def _using_token(self) -> AbstractContextManager[None]:
        """Around a join: who came with a token that is good for one session uses it up."""
        session = self._session
        if not session.once:
            return nullcontext()
        used = self._services.used_tokens
        return used.used_by(session.id, session.token_id, session.role_expires)

    def _seat_for(self, message: messages.Join, room: Room) -> str | None:
        """The seat to ask for. A code outside of what the token is for is a wrong one."""
        only, seat = self._session.only_episode, self._session.only_seat
        try:
            return check_join(message, only=only, seat=seat, episode=room.id, code=room.code)
        except ProtocolError as error:
            if error.code == "auth/episode":
                self._services.code_guesses.wrong(self._counted, self._now())
            raise

    def _find(self, name: str) -> Room:
        """The room of a code; whoever guesses codes has to wait soon."""
        now, codes = self._now(), self._services.code_guesses
        codes.check(self._counted, now)
        try:
            return self._services.lobby.find(name)
        except ProtocolError as error:
            if error.code == "episode/unknown":
                codes.wrong(self._counted, now)
            raise

    def _now(self) -> float:
        return self._peer.socket.loop.time()

    def _ready(self, message: messages.Ready) -> None:
        self._room.set_ready(self._session, message.ready)

    def _leave(self, message: messages.Leave) -> None:
        room = self._room
        room.leave(self._session)
        self._peer.send(messages.Left(ref=message.ref, episode=room.id))

    # In an episode

    def _act(self, message: messages.Act) -> None:
        session = self._session
        if session.room is not None:
            session.room.act(session, message)
        else:
            self._peer.send(unheard(message, session, 0, "episode/none", "join an episode first"))

    def _say(self, message: messages.Say) -> None:
        self._room.say(self._session, message.text)

    def _note(self, message: messages.Note) -> None:
        self._room.note(self._session, message)

    def _resync(self, message: messages.Resync) -> None:
        self._room.ask_snapshot(self._session)

    def _get_rendering(self, message: messages.GetRendering) -> None:
        look = self._look
        if look is None:
            self._peer.answer(messages.Rendering(ref=message.ref))
            return
        self._peer.answer(
            messages.Rendering(
                ref=message.ref,
                rendering=dict(look.rendering),
                bindings=dict(look.bindings),
                pictures=dict(look.pictures),
            )
        )

    def _get_picture(self, message: messages.GetPicture) -> None:
        look = self._look
        if look is None or message.digest not in look.pictures.values():
            text = "this episode has no such picture"
            raise ProtocolError("message/invalid-field", text, "digest")
        data = b64encode(self._services.lobby.tasks.picture(message.digest)).decode()
        self._peer.answer(messages.Picture(ref=message.ref, digest=message.digest, data=data))

    @property
    def _look(self) -> Look | None:
        """What the task looks like that a session plays or watches; None for a shipped one."""
        return self._services.lobby.tasks.look(self._room.episode.world.task.name)

    @property
    def _room(self) -> JoinedRoom:
        """The room that the session is in; ProtocolError `episode/none` if there is none."""
        room = self._session.room
        if room is None:
            raise ProtocolError("episode/none", "join an episode first", "type")
        return room


def unheard(
    act: messages.Act, session: Session | None, step: int, code: str, reason: str
) -> messages.Rejected:
    """The answer to an action of which no room hears."""
    seat = session.seat_shown(act.seat) if session is not None else ""
    return messages.Rejected(
        seq=act.seq, step=step, action="", reasons=[reason], code=code, seat=seat
    )


HANDLERS: dict[type[messages.Message], Callable[[Requests, Any], None]] = {
    messages.ListEpisodes: Requests._list,
    messages.Create: Requests._create,
    messages.Close: Requests._close,
    messages.Join: Requests._join,
    messages.Ready: Requests._ready,
    messages.Leave: Requests._leave,
    messages.Act: Requests._act,
    messages.Say: Requests._say,
    messages.Note: Requests._note,
    messages.GetRendering: Requests._get_rendering,
    messages.GetPicture: Requests._get_picture,
    messages.Resync: Requests._resync,
    messages.Hello: Requests._hello,
}
