"""Commands from laboratory software, checked like WebSocket messages and noted in the audit log."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any
from urllib.parse import quote

from robotouille.errors import ProtocolError
from robotouille.protocol.codec import MAX_CLIENT_BYTES, read_object, validated
from robotouille.protocol.messages import Close, ListEpisodes
from robotouille_server.app import Server
from robotouille_server.auth import Role, RoleGrant, check_opening, check_scope
from robotouille_server.mqtt import messages as mqtt
from robotouille_server.mqtt.limits import CommandLimits
from robotouille_server.mqtt.messages import Command, CommandReply
from robotouille_server.mqtt.stream import Watch, Watches
from robotouille_server.operator.models import Done, OpenedEpisode, Problem
from robotouille_server.operator.other_nodes import EpisodeElsewhereError
from robotouille_server.operator.principal import Principal, RequestRefusedError
from robotouille_server.operator.service import OperatorService
from robotouille_server.requests import Opening, open_episode, simulate_plan
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.workers import ElsewhereError

EpisodeCommand = mqtt.AnnounceCommand | mqtt.PauseCommand | mqtt.ResumeCommand

LIST_COST = 3.0
"""Commands that a `list` counts as, because its reply describes up to 500 episodes."""
KEPT_REPLIES = 200
"""Replies kept for repeated commands."""


class Commands:
    """Executes commands on a server, one after another. `now` returns the event loop's time."""

    def __init__(self, server: Server, watches: Watches, now: Callable[[], float]) -> None:
        self._server = server
        self._watches = watches
        self._now = now
        self._service = OperatorService(server, now)
        self._limits = CommandLimits(server.tokens, now)
        self._replies: dict[tuple[RoleGrant, str], CommandReply] = {}

    async def execute(self, payload: bytes) -> CommandReply | None:
        """Execute a command, unless it was executed before.

        Returns:
            The reply, or None if too many commands were refused to answer this one.
        """
        ref = subject = ""
        try:
            try:
                self._limits.check_size(payload)
                plain = _read(payload)
                ref = _printable_ref(plain)
                command = validated(plain, mqtt.command_adapter)
                grant = self._server.tokens.check_role(command.token)
            except ProtocolError as error:
                refused = self._limits.refuse(len(payload), error)
                return _refusal(ref, refused) if refused is not None else None
            subject = grant.subject
            reply = await self._execute_limited(command, grant, len(payload))
        except Exception:
            get_logger().exception("MQTT: a command failed")
            text = "internal error; see the server's log"
            reply = _refusal(ref, ProtocolError("server/internal", text))
        return reply and reply.model_copy(update={"subject": subject})

    async def _execute_limited(
        self, command: Command, grant: RoleGrant, size: int
    ) -> CommandReply | None:
        if not grant.role.includes(command.least_role):
            text = f"the command needs a token with the role {command.least_role}"
            reason = ProtocolError("auth/role", text, "token")
            refused = self._limits.refuse(size, reason)
            if refused is reason:  # A flood must not fill the audit log.
                self._note_refused(command, grant, reason.code)
            return _refusal(command.ref, refused) if refused is not None else None
        try:
            self._limits.accept(LIST_COST if isinstance(command, mqtt.ListCommand) else 1)
        except ProtocolError as error:
            return _refusal(command.ref, error)
        return await self._execute_once(command, grant)

    async def _execute_once(self, command: Command, grant: RoleGrant) -> CommandReply:
        # Replies contain codes and seat tokens: only the same token may receive them again.
        key = grant, command.ref
        if key in self._replies:
            return self._replies[key]
        reply = await self._execute_checked(command, grant)
        if reply.error is None or reply.opened:  # Clients may repeat commands that were refused.
            self._replies[key] = reply
            if len(self._replies) > KEPT_REPLIES:
                del self._replies[next(iter(self._replies))]
        return reply

    async def _execute_checked(self, command: Command, grant: RoleGrant) -> CommandReply:
        refused: ProtocolError | RequestRefusedError
        try:
            return await self._dispatch(command, grant)
        except (ProtocolError, RequestRefusedError) as error:
            refused = error
        except ElsewhereError as error:
            where = f"{error.episode} runs on {error.url}" if error.url else str(error)
            text = f"{where}: send the command to that process"
            refused = ProtocolError("episode/unknown", text, "episode")
        self._note_refused(command, grant, refused.code)
        return _refusal(command.ref, refused)

    def _note_refused(self, command: Command, grant: RoleGrant, code: str) -> None:
        episode = getattr(command, "episode", None) or ""
        self._serving(grant).refused(f"mqtt {command.type}", episode, code)

    async def _dispatch(self, command: Command, grant: RoleGrant) -> CommandReply:
        done = ""
        match command:
            case mqtt.OpenCommand():
                return await self._open(command, grant)
            case mqtt.ListCommand():
                return await self._list(command, grant)
            case mqtt.WatchCommand():
                done = self._watch(command, grant)
            case mqtt.UnwatchCommand():
                done = self._unwatch(command, grant)
            case mqtt.CloseCommand():
                done = await self._close(command, grant)
            case mqtt.AnnounceCommand(episode=None, text=text):
                done = (await self._serving(grant).announce_to_all(text)).done
            case mqtt.AnnounceCommand(episode=str(episode), text=text):
                work = partial(self._serving(grant).announce, episode, text)
                done = await self._anywhere(work, grant, command, text=text)
            case mqtt.PauseCommand(episode=episode):
                work = partial(self._serving(grant).pause, episode)
                done = await self._anywhere(work, grant, command)
            case mqtt.ResumeCommand(episode=episode):
                work = partial(self._serving(grant).resume, episode)
                done = await self._anywhere(work, grant, command)
        return CommandReply(ref=command.ref, ok=True, done=done)

    async def _anywhere(
        self, work: Callable[[], Done], grant: RoleGrant, command: EpisodeCommand, **body: str
    ) -> str:
        """Do something with an episode here, or let the node do it that has the episode."""
        try:
            return work().done
        except EpisodeElsewhereError as elsewhere:
            path = f"/api/episodes/{quote(str(command.episode), safe='')}/{command.type}"
            others = self._service.others
            if others is None:
                raise
            return (await others.change(elsewhere.node, Principal(grant), path, body)).done

    def _serving(self, grant: RoleGrant) -> OperatorService:
        return self._service.for_principal(Principal(grant))

    def _note(
        self, command: Command, grant: RoleGrant, episode: str = "", **details: str | int
    ) -> None:
        self._server.audit.note(
            f"mqtt {command.type}",
            by=grant.subject,
            token=grant.token_id,
            episode=episode,
            details=details,
        )

    def _watch(self, command: mqtt.WatchCommand, grant: RoleGrant) -> str:
        owner = None if grant.role is Role.OPERATOR else grant.subject
        episode = ""
        if command.episode is not None:
            room = self._server.lobby.find(command.episode)
            check_scope(grant.episode, room.id, room.code)
            if owner not in (None, room.owner):
                text = "another subject opened this episode; only its host and operators watch it"
                raise ProtocolError("auth/episode", text, "episode")
            episode = room.id
        elif grant.episode:
            raise ProtocolError("auth/episode", "your token is for one episode; name it", "episode")
        watch = Watch(grant.subject, owner, episode, command.labels, grant.token_id)
        seconds = min(command.seconds, grant.expires - self._server.wall())
        self._watches.add(watch, self._now() + seconds)
        self._note(command, grant, episode, labels=_text(command.labels))
        return f"watching for {seconds:g} s"

    def _unwatch(self, command: mqtt.UnwatchCommand, grant: RoleGrant) -> str:
        episode = command.episode or ""
        if episode:
            with suppress(ProtocolError):  # The lobby forgets episodes after their end.
                episode = self._server.lobby.find(episode).id
        ended = self._watches.remove(Watch(grant.subject, None, episode, command.labels))
        return f"{ended} watches ended"

    async def _list(self, command: mqtt.ListCommand, grant: RoleGrant) -> CommandReply:
        request = ListEpisodes(labels=command.labels, skip=command.skip)
        operator = grant.role is Role.OPERATOR
        only, owner, cluster = grant.episode, grant.subject, self._server.services.cluster
        if cluster is not None:
            found = await cluster.list(request, only, owner, operator=operator)
        else:
            found = self._server.lobby.infos(request, only, owner, operator=operator)
        return CommandReply(ref=command.ref, ok=True, episodes=found.episodes, total=found.total)

    async def _open(self, command: mqtt.OpenCommand, grant: RoleGrant) -> CommandReply:
        check_opening(grant.episode)
        opened: list[OpenedEpisode] = []
        opening = Opening(request=command.create, owner=grant.subject)
        services, error = self._server.services, None
        for _ in range(command.count):
            try:
                if services.cluster is not None:
                    created = await services.cluster.create(opening)
                else:
                    await simulate_plan(services, opening.request)
                    _, created = open_episode(services, opening)
            except ProtocolError as refused:
                error = _refusal("", refused).error
                break
            opened.append(OpenedEpisode.of(created))
            await asyncio.sleep(0)  # Opening creates a file; let other episodes run in between.
        self._note(command, grant, count=len(opened), labels=_text(command.create.labels))
        return CommandReply(ref=command.ref, ok=error is None, opened=opened, error=error)

    async def _close(self, command: mqtt.CloseCommand, grant: RoleGrant) -> str:
        check_opening(grant.episode)
        reason = command.reason or f"closed by the {grant.role}"
        operator, owner = grant.role is Role.OPERATOR, grant.subject
        if (cluster := self._server.services.cluster) is not None:
            closing = Close(episode=command.episode, reason=reason)
            episode = await cluster.close(closing, owner, operator=operator)
        else:
            lobby = self._server.lobby
            episode = lobby.close(command.episode, reason, owner, operator=operator).id
        self._note(command, grant, episode, reason=reason)
        return f"{episode} has ended"


def too_large(reply: CommandReply, size: int) -> CommandReply:
    """Return the reply in place of one whose JSON of `size` bytes the broker does not accept."""
    text = (
        f"the server handled the command, but its answer of {size:,} bytes exceeds the broker's "
        "maximum packet size"
    )
    error = Problem(code="message/too-large", message=text)
    return CommandReply(ref=reply.ref, subject=reply.subject, ok=False, error=error)


def _read(payload: bytes) -> dict[str, Any]:
    if len(payload) > MAX_CLIENT_BYTES:
        text = f"{len(payload):,} bytes; the limit is {MAX_CLIENT_BYTES:,}"
        raise ProtocolError("message/too-large", text)
    try:
        return read_object(payload.decode())
    except UnicodeDecodeError:
        raise ProtocolError("message/malformed", "not UTF-8") from None


def _printable_ref(plain: Mapping[str, Any]) -> str:
    ref = plain.get("ref")
    return ref if isinstance(ref, str) and 0 < len(ref) <= 64 and ref.isprintable() else ""


def _text(labels: Mapping[str, str]) -> str:
    return " ".join(f"{name}={value}" for name, value in labels.items())


def _refusal(ref: str, refused: ProtocolError | RequestRefusedError) -> CommandReply:
    error = Problem(code=refused.code, message=refused.message[:1000], field=refused.field)
    return CommandReply(ref=ref, ok=False, error=error)
