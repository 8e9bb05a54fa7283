"""Requests that any node answers, wherever the episode is: open, close and list episodes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractContextManager, asynccontextmanager, nullcontext

from pydantic import BaseModel, ValidationError

from robotouille.episode import Phase
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille_server.cluster.bus import Bus, BusError, NoAnswererError
from robotouille_server.cluster.keys.secrets import SharedSecrets
from robotouille_server.cluster.node import ClusterNode, other_nodes
from robotouille_server.cluster.spectators.mirrors import Mirrors
from robotouille_server.cluster.spectators.packets import Line, Watch, Watched
from robotouille_server.cluster.spectators.relays import Relays
from robotouille_server.requests import Opening, Services, open_episode, simulate_plan
from robotouille_server.rooms.lobby import MAX_LISTED
from robotouille_server.rooms.participants.session import JoinedRoom, SessionLimits
from robotouille_server.runtime.workers import ElsewhereError
from robotouille_server.transport import LoopTurns

ANSWER_SECONDS = 5.0
"""Seconds that another node has to open or close an episode."""
LIST_SECONDS = 1.0
"""Seconds after which a list is complete without the nodes that do not answer."""
MAX_NODES = 64
PHASES = {Phase.WAITING: 0, Phase.RUNNING: 1, Phase.PAUSED: 1, Phase.ENDED: 2}


class _Listing(BaseModel):
    """Request for a list of episodes, from one node to another."""

    request: messages.ListEpisodes
    only: str
    owner: str
    operator: bool


class _Closing(BaseModel):
    """Request to close an episode, from one node to another."""

    episode: str
    reason: str
    owner: str
    operator: bool


class _Answer(BaseModel):
    """Answer of another node: an error, or one of the others."""

    error: messages.Error | None = None
    created: messages.Created | None = None
    episodes: messages.Episodes | None = None
    closed: str = ""
    watched: Watched | None = None


class ClusterService:
    """Requests that clients may send to any node, and nodes to each other.

    Their work is done in tasks, which the budget of connections does not limit. So each request
    takes a turn of the event loop.
    """

    def __init__(self, node: ClusterNode, services: Services, secrets: SharedSecrets) -> None:
        self.node = node
        self.services = services
        self.secrets = secrets
        self.mirrors = Mirrors(self)
        self.relays = Relays(node, services.lobby)
        self._turns = LoopTurns(services.loop_budget)

    @property
    def _bus(self) -> Bus:
        return self.node.bus

    async def start(self) -> None:
        """Answer the requests of other nodes."""
        self.services.lobby.owned_elsewhere = self._owned_elsewhere
        await self._bus.answer(f"node.{self.node.name}", self._asked)

    async def stop(self) -> None:
        """Let the spectators of other nodes' episodes go, and serve no other node's spectators."""
        self.relays.close()
        await self.mirrors.close()

    @property
    def nodes(self) -> list[str]:
        """Addresses of the other nodes, for clients that lose this one."""
        return other_nodes(self.node.members.alive(), self.node.members.own)[:MAX_NODES]

    @property
    def cut_off(self) -> bool:
        """True while clients must go to another node."""
        return self.node.cut_off

    def _owned_elsewhere(self, owner: str, reserved: bool) -> int:
        return sum(
            record.owner == owner and record.reserved == reserved and not record.ended
            for record in self.node.directory
            if record.node != self.node.name
        )

    @asynccontextmanager
    async def using_token(self, session: str, limits: SessionLimits) -> AsyncIterator[None]:
        """Return a context for a join that uses up a token on all nodes, unless it fails."""
        new = await self.secrets.use(limits.token_id, session, limits.role_expires)
        try:
            yield
        except BaseException:
            if new:
                await self.secrets.release(limits.token_id, session)
            raise

    async def look(self, code: str) -> None:
        """Look again where the episode with a code is."""
        # Wrong codes of programs on this machine are not limited.
        await self._turns.next()
        try:
            await self.node.directory.look(code)
        except BusError as error:
            raise _unavailable(error) from None

    # Opening

    async def create(
        self, opening: Opening, finding: AbstractContextManager[None] | None = None
    ) -> messages.Created:
        """Open an episode on the node with the least load that answers.

        Args:
            opening: The request.
            finding: Context in which the game of a rematch is looked up.
        """
        silent: set[str] = set()
        await self._turns.next()
        # Only this node knows the game of a rematch.
        while opening.request.rematch is None:
            place = self.node.members.place(1, silent)
            if place.name == self.node.name:
                break
            try:
                return await self._create_on(place.name, opening)
            except NoAnswererError:
                # It has just died. After other errors, it may have opened the episode.
                silent.add(place.name)
        return await self._create_here(opening, finding)

    async def _create_on(self, node: str, opening: Opening) -> messages.Created:
        data = opening.model_dump_json().encode()
        try:
            answer = await self._answer_of(node, "create", data, ANSWER_SECONDS)
        except NoAnswererError:
            raise
        except BusError as error:
            raise _unavailable(error) from None
        if answer.created is None:
            raise ProtocolError("server/internal", "another node failed to open the episode")
        return answer.created

    async def _create_here(
        self, opening: Opening, finding: AbstractContextManager[None] | None = None
    ) -> messages.Created:
        await simulate_plan(self.services, opening.request)
        await self._turns.next()
        with finding or nullcontext():
            room, created = open_episode(self.services, opening)
        try:
            await self.node.registered(room.id)
        except BusError as error:
            raise _unavailable(error) from None
        return created

    # Closing and listing

    async def close(self, message: messages.Close, owner: str, *, operator: bool) -> str:
        """Close an episode, wherever it is; return its id."""
        await self._turns.next()
        record = self.node.directory.find(message.episode)
        reason = message.reason or ""
        if record is None or record.node == self.node.name:
            lobby = self.services.lobby
            return lobby.close(message.episode, reason, owner, operator=operator).id
        data = _Closing(episode=record.episode, reason=reason, owner=owner, operator=operator)
        answer = await self._ask(
            record.node, "close", data.model_dump_json().encode(), ANSWER_SECONDS
        )
        return answer.closed

    async def list(
        self, request: messages.ListEpisodes, only: str, owner: str, *, operator: bool
    ) -> messages.Episodes:
        """List the episodes of all nodes, those that wait for players first."""
        # Every node returns its first episodes, up to the end of the page.
        wanted = request.model_copy(update={"skip": 0})
        listing = _Listing(request=wanted, only=only, owner=owner, operator=operator)
        others = [r for r in self.node.members.alive() if r.name != self.node.name]
        data = listing.model_dump_json().encode()
        answers = await asyncio.gather(
            *(self._bus.request(f"node.{other.name}.list", data, LIST_SECONDS) for other in others),
            return_exceptions=True,
        )
        # Reading and sorting long lists takes as long as making them.
        await self._turns.next()
        own = self.services.lobby.infos(wanted, only, owner, operator=operator)
        found, total = list(own.episodes), own.total
        for part in map(_listed, answers):
            found += part.episodes
            total += part.total
        found.sort(key=lambda info: (PHASES.get(Phase(info.phase), 3), info.created))
        page = found[request.skip : request.skip + MAX_LISTED]
        return messages.Episodes(ref=request.ref, episodes=page, total=total)

    # Watching

    def mirror_of(self, session: str, episode: str) -> JoinedRoom | None:
        """Return the mirror to which a spectator may come back."""
        return self.mirrors.of(session, episode)

    async def mirror(self, episode: str) -> JoinedRoom | None:
        """Return a room for spectators of another node's episode; None if that is not possible."""
        return await self.mirrors.open(episode)

    async def watch(self, owner: str, request: Watch, seconds: float) -> Watched:
        """Let the owner of an episode publish its updates for some seconds more."""
        answer = await self._ask(owner, "watch", request.model_dump_json().encode(), seconds)
        if answer.watched is None:
            raise ProtocolError("server/internal", "another node failed to publish its updates")
        return answer.watched

    async def say(self, line: Line) -> None:
        """Post a chat line in an episode of another node."""
        record = self.node.directory.find(line.episode)
        if record is None or self.node.members.find(record.node) is None:
            message = "this episode is being handed over; try again in a moment"
            raise ProtocolError("server/handover", message, "episode")
        await self._ask(record.node, "say", line.model_dump_json().encode(), ANSWER_SECONDS)

    # Between nodes

    async def _ask(self, node: str, what: str, data: bytes, seconds: float) -> _Answer:
        try:
            return await self._answer_of(node, what, data, seconds)
        except BusError as error:
            raise _unavailable(error) from None

    async def _answer_of(self, node: str, what: str, data: bytes, seconds: float) -> _Answer:
        return _read(await self._bus.request(f"node.{node}.{what}", data, seconds))

    async def _asked(self, what: str, data: bytes) -> bytes:
        try:
            answer = await self._answer(what, data)
        except ProtocolError as error:
            refused = messages.Error(code=error.code, message=error.message, field=error.field)
            answer = _Answer(error=refused)
        except ElsewhereError:
            # This node has just handed the episode over, and the other one does not know it yet.
            text = "this episode is being handed over; try again in a moment"
            refused = messages.Error(code="server/handover", message=text, field="episode")
            answer = _Answer(error=refused)
        except ValidationError:
            text = "another node cannot read this request"
            answer = _Answer(error=messages.Error(code="server/internal", message=text))
        return answer.model_dump_json().encode()

    async def _answer(self, what: str, data: bytes) -> _Answer:
        if what == "create":
            return _Answer(created=await self._create_here(Opening.model_validate_json(data)))
        await self._turns.next()
        if what == "close":
            closing = _Closing.model_validate_json(data)
            lobby, operator = self.services.lobby, closing.operator
            room = lobby.close(closing.episode, closing.reason, closing.owner, operator=operator)
            return _Answer(closed=room.id)
        if what == "watch":
            return _Answer(watched=self.relays.watch(Watch.model_validate_json(data)))
        if what == "say":
            self.relays.say(Line.model_validate_json(data))
            return _Answer()
        listing = _Listing.model_validate_json(data)
        infos = self.services.lobby.infos(
            listing.request, listing.only, listing.owner, operator=listing.operator
        )
        return _Answer(episodes=infos)


def _read(answer: bytes) -> _Answer:
    """Return the answer of another node; raise ProtocolError if it is an error or unreadable."""
    try:
        found = _Answer.model_validate_json(answer)
    except ValidationError:
        message = "another node has sent an answer that this one cannot read"
        raise ProtocolError("server/internal", message) from None
    if found.error is not None:
        raise ProtocolError(found.error.code, found.error.message, found.error.field)
    return found


def _listed(answer: bytes | BaseException) -> messages.Episodes:
    """Return the list of a node; an empty one if the node has not answered."""
    nothing = messages.Episodes(episodes=[], total=0)
    if isinstance(answer, BaseException):
        return nothing
    try:
        return _read(answer).episodes or nothing
    except ProtocolError:
        return nothing


def _unavailable(error: BusError) -> ProtocolError:
    return ProtocolError("server/recording", f"the cluster has no answer: {error}; try again later")
