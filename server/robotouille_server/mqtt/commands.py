"""What laboratories ask for over the broker: checked as on a WebSocket, and carried out by the same
functions."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from typing import Any

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import MAX_CLIENT_BYTES, read_object, validated
from robotouille_server.admin.admin_service import AdminService
from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.principal import Principal
from robotouille_server.app import Server
from robotouille_server.auth import Role, RoleGrant, check_opening, check_scope
from robotouille_server.mqtt import models
from robotouille_server.mqtt.connection import Received
from robotouille_server.mqtt.models import Answer, AnswerError
from robotouille_server.mqtt.outbox import Outgoing
from robotouille_server.mqtt.topics import Topics
from robotouille_server.mqtt.watches import Watched, Watches
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.token_bucket import TokenBucket
from robotouille_server.runtime.workers import ElsewhereError

__all__ = ["COMMANDS_A_SECOND", "KEPT_ANSWERS", "ROLES", "Commands"]

COMMANDS_A_SECOND, COMMANDS_BURST = 10.0, 50.0
KEPT_ANSWERS = 200
"""To commands that may come once more."""

ROLES: dict[type[models.Command], Role] = {
    models.Watch: Role.HOST,
    models.Unwatch: Role.HOST,
    models.List: Role.HOST,
    models.Open: Role.HOST,
    models.Close: Role.HOST,
    models.Announce: Role.OPERATOR,
    models.Pause: Role.OPERATOR,
    models.Resume: Role.OPERATOR,
}
"""The least role that each takes. Hosts watch, list and close what they have opened."""
COSTS: dict[type[models.Command], float] = {models.List: 3}
"""What a command takes of the budget, where that is not one."""


class Commands:
    """Carries out commands on a server. `now` is the loop's time."""

    def __init__(
        self, server: Server, watches: Watches, topics: Topics, now: Callable[[], float]
    ) -> None:
        self._server = server
        self._watches = watches
        self._topics = topics
        self._now = now
        self._service = AdminService(server, now)
        self._budget = TokenBucket(COMMANDS_A_SECOND, now(), COMMANDS_BURST)
        self._answered: OrderedDict[tuple[RoleGrant, str], Answer] = OrderedDict()
        self._one_at_a_time = asyncio.Lock()

    async def answer(self, received: Received) -> Outgoing:
        """Carry out a command, unless it came before; what to answer, and where."""
        topic = self._topics.response_topic(received.response_topic)
        return Outgoing(topic, await self._answer(received.payload), received.correlation)

    async def _answer(self, payload: bytes) -> Answer:
        ref = ""
        try:
            if not self._budget.take(self._now()):
                text = f"more than {COMMANDS_A_SECOND:g} commands a second"
                raise ProtocolError("rate/limited", text)
            plain = _plain(payload)
            ref = _ref(plain)
            command = validated(plain, models.commands)
            self._budget.owe(self._now(), COSTS.get(type(command), 1) - 1)
            grant = self._server.tokens.check_role(command.token)
            # One that comes again over another connection waits for what became of the first.
            async with self._one_at_a_time:
                return await self._once(command, grant)
        except ProtocolError as error:
            return _refusal(ref, error.code, error.message, error.field)
        except Exception:
            get_logger().exception("a command failed")
            return _refusal(ref, "server/internal", "the server failed to handle this")

    async def _once(self, command: models.Command, grant: RoleGrant) -> Answer:
        # Answers have codes and tokens in them: they are for whoever has this very token.
        key = grant, command.ref
        if key in self._answered:
            return self._answered[key]
        answer = await self._carried_out(command, grant)
        if answer.error is None or answer.opened:  # What was refused may be tried again.
            while len(self._answered) >= KEPT_ANSWERS:
                self._answered.popitem(last=False)
            self._answered[key] = answer
        return answer

    async def _carried_out(self, command: models.Command, grant: RoleGrant) -> Answer:
        kind = type(command)
        what = f"mqtt {kind.__name__.lower()}"
        episode = getattr(command, "episode", None) or ""
        try:
            least = ROLES[kind]
            if not grant.role.includes(least):
                text = f"a {grant.role} may not do this; it takes a token with the role {least}"
                raise ProtocolError("auth/role", text, "token")
            return await HANDLERS[kind](self, command, grant)
        except (ProtocolError, RequestRefusedError) as error:
            refused = error
        except ElsewhereError as error:
            refused = ProtocolError("episode/unknown", f"{error}: ask that process", "episode")
        self._serving(grant).refused(what, episode, refused.code)
        return _refusal(command.ref, refused.code, refused.message, getattr(refused, "field", ""))

    def _serving(self, grant: RoleGrant) -> AdminService:
        return self._service.serving(Principal(grant))

    def _note(self, what: str, grant: RoleGrant, episode: str = "", **details: str | int) -> None:
        self._server.audit.note(
            f"mqtt {what}", by=grant.subject, token=grant.token_id, episode=episode, details=details
        )

    # Watching

    def _watched(self, command: models.Watch, grant: RoleGrant) -> Watched:
        _check_either(command)
        owner = None if grant.role is Role.OPERATOR else grant.subject
        if command.episode is None:
            if grant.episode:
                text = "your token is for one episode; name it"
                raise ProtocolError("auth/episode", text, "episode")
            return Watched(grant.subject, owner, labels=command.labels, token=grant.token_id)
        room = self._server.lobby.find(command.episode)
        check_scope(grant.episode, room.id, room.code)
        if owner not in (None, room.owner):
            text = "you have not opened this episode; its host or an operator can watch it"
            raise ProtocolError("auth/episode", text, "episode")
        return Watched(grant.subject, owner, episode=room.id, token=grant.token_id)

    async def _watch(self, command: models.Watch, grant: RoleGrant) -> Answer:
        watched = self._watched(command, grant)
        left = grant.expires - self._server.wall()
        self._watches.add(watched, self._now() + min(command.seconds, left))
        self._note("watch", grant, watched.episode, **_labels(watched.labels))
        return Answer(ref=command.ref, ok=True, done=f"watched for {command.seconds:g} s")

    async def _unwatch(self, command: models.Unwatch, grant: RoleGrant) -> Answer:
        _check_either(command)
        episode = command.episode or ""
        if episode:
            with suppress(ProtocolError):  # It may be over, and forgotten.
                episode = self._server.lobby.find(episode).id
        ended = self._watches.remove(
            Watched(grant.subject, None, episode=episode, labels=command.labels)
        )
        return Answer(ref=command.ref, ok=True, done=f"{ended} watches ended")

    async def _list(self, command: models.List, grant: RoleGrant) -> Answer:
        request = messages.ListEpisodes(labels=command.labels, skip=command.skip)
        operator = grant.role is Role.OPERATOR
        found = self._server.lobby.infos(request, grant.episode, grant.subject, operator=operator)
        return Answer(ref=command.ref, ok=True, episodes=found.episodes, total=found.total)

    # Opening and closing

    async def _open(self, command: models.Open, grant: RoleGrant) -> Answer:
        check_opening(grant.episode)
        opened: list[models.OpenedEpisode] = []
        services = self._server.services
        error = None
        for _ in range(command.count):
            try:
                room = services.lobby.create(command.create, owner=grant.subject)
            except ProtocolError as refused:
                error = AnswerError(code=refused.code, message=refused.message, field=refused.field)
                break
            tokens = (
                services.seat_tokens(room, command.create.participants, grant.subject)
                if command.create.tokens
                else {}
            )
            opened.append(models.OpenedEpisode(episode=room.id, code=room.code, tokens=tokens))
            await asyncio.sleep(0)  # Each is a file: the games have their turn in between.
        self._note("open", grant, count=len(opened), **_labels(command.create.labels))
        return Answer(ref=command.ref, ok=error is None, opened=opened, error=error)

    async def _close(self, command: models.Close, grant: RoleGrant) -> Answer:
        check_opening(grant.episode)
        reason = command.reason or f"closed by the {grant.role}"
        operator = grant.role is Role.OPERATOR
        room = self._server.lobby.close(command.episode, reason, grant.subject, operator=operator)
        self._note("close", grant, room.id, reason=reason)
        return Answer(ref=command.ref, ok=True, done=f"{room.id} is over")

    # What operators do

    async def _announce(self, command: models.Announce, grant: RoleGrant) -> Answer:
        service = self._serving(grant)
        if command.episode is None:
            done = service.announce_to_all(command.text)
        else:
            done = service.announce(command.episode, command.text)
        return Answer(ref=command.ref, ok=True, done=done.done)

    async def _pause(self, command: models.Pause, grant: RoleGrant) -> Answer:
        done = self._serving(grant).pause(command.episode)
        return Answer(ref=command.ref, ok=True, done=done.done)

    async def _resume(self, command: models.Resume, grant: RoleGrant) -> Answer:
        done = self._serving(grant).resume(command.episode)
        return Answer(ref=command.ref, ok=True, done=done.done)


def _plain(payload: bytes) -> dict[str, Any]:
    """A command's fields. What is too large is not looked at."""
    if len(payload) > MAX_CLIENT_BYTES:
        text = f"{len(payload):,} bytes; at most {MAX_CLIENT_BYTES:,} are read"
        raise ProtocolError("message/too-large", text)
    try:
        return read_object(payload.decode())
    except UnicodeDecodeError:
        raise ProtocolError("message/malformed", "is not UTF-8") from None


def _check_either(command: models.Watch | models.Unwatch) -> None:
    if command.episode is not None and command.labels:
        text = "name an episode or labels, not both"
        raise ProtocolError("message/invalid-field", text, "labels")


def _ref(plain: Mapping[str, Any]) -> str:
    """The command's own name for itself, if it is one that can be repeated."""
    ref = plain.get("ref")
    return ref if isinstance(ref, str) and 0 < len(ref) <= 64 and ref.isprintable() else ""


def _labels(labels: Mapping[str, str]) -> dict[str, str]:
    return {"labels": " ".join(f"{name}={value}" for name, value in labels.items())}


def _refusal(ref: str, code: str, message: str, field: str = "") -> Answer:
    error = AnswerError(code=code, message=message[:1000], field=field)
    return Answer(ref=ref, ok=False, error=error)


HANDLERS: dict[type[models.Command], Callable[[Commands, Any, RoleGrant], Awaitable[Answer]]] = {
    models.Watch: Commands._watch,
    models.Unwatch: Commands._unwatch,
    models.List: Commands._list,
    models.Open: Commands._open,
    models.Close: Commands._close,
    models.Announce: Commands._announce,
    models.Pause: Commands._pause,
    models.Resume: Commands._resume,
}
