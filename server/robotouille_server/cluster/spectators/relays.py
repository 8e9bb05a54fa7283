"""Updates of this node's episodes for nodes with spectators of them (docs/decisions/0044).

A relay is one more member of a room's audience. Whatever spectators receive, it publishes once, for
all nodes. Nodes ask for it once a second; it ends when none has asked for `WATCH_SECONDS`.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from pydantic import BaseModel

from robotouille.errors import ProtocolError
from robotouille.protocol.codec import MSGPACK
from robotouille_server.auth import Role
from robotouille_server.cluster.bus import Bus
from robotouille_server.cluster.spectators.packets import Line, Packet, Watch, Watched, subject_of
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.room import Room
from robotouille_server.transport import frame_of

if TYPE_CHECKING:
    from robotouille_server.cluster.node import ClusterNode
    from robotouille_server.rooms.lobby import Lobby
    from robotouille_server.transport import Peer

WATCH_SECONDS = 5.0
"""Seconds after which a node that has not asked again no longer watches an episode."""
TIDY_SECONDS = 1.0
STATE_SECONDS = 0.1
"""Minimum time between two snapshots of a relay."""
MAX_PIECE = 512 * 1024
"""Bytes in one message. NATS refuses messages above 1 MiB, unless it is configured otherwise."""


@dataclass(frozen=True, slots=True)
class _Lease:
    until: float
    spectators: int
    names: tuple[str, ...]
    text: bool


class Relay:
    """Member of an audience that publishes what it receives. It is the `Peer` of its own session.

    Attributes:
        room: The room.
        leases: The nodes that watch, by name.
        number: The number of the last packet.
    """

    codec = MSGPACK
    behind = False

    def __init__(self, room: Room, bus: Bus, claim: int, name: str) -> None:
        self.room = room
        self.leases: dict[str, _Lease] = {}
        self.number = 0
        self.claim, self.name = claim, name
        self._bus = bus
        self._loop = asyncio.get_running_loop()
        self._frames: list[bytes] = []
        self._ended = False
        self._state_timer: asyncio.TimerHandle | None = None
        self._state_at = 0.0
        self._said = 0
        self._session = Session(name, name="", kind="bot", role=Role.SPECTATOR)
        self._session.peer = cast("Peer", self)
        room.begin_relay(self._session)

    def end(self) -> None:
        """Publish what is pending, and nothing afterwards."""
        if self._state_timer is not None:
            self._state_timer.cancel()
        self.room.end_relay(self._session)
        self._publish()
        self._ended = True

    # Nodes that watch

    def renew(self, request: Watch) -> None:
        """Note the spectators of a node."""
        until = self._loop.time() + WATCH_SECONDS
        self.leases[request.node] = _Lease(until, request.spectators, request.names, request.text)
        self._count()

    def tidy(self) -> None:
        """Forget the nodes that have not asked again."""
        now = self._loop.time()
        self.leases = {name: lease for name, lease in self.leases.items() if lease.until > now}
        self._count()

    def _count(self) -> None:
        leases = self.leases.values()
        names = [name for lease in leases for name in lease.names]
        self.room.mirrored_by(sum(lease.spectators for lease in leases), names)
        # Texts are much longer than deltas.
        self._session.view = "both" if any(lease.text for lease in leases) else "state"

    # Snapshots

    def ask_state(self, request: Watch) -> None:
        """Publish what new spectators need. Nodes that ask at the same time share it."""
        if request.task:
            self._session.known.clear()
        if self._state_timer is not None:
            self._said = min(self._said, request.said)
            return
        self._said = request.said
        at = max(self._loop.time(), self._state_at)
        self._state_timer = self._loop.call_at(at, self._send_state)

    def _send_state(self) -> None:
        self._state_timer = None
        self._state_at = self._loop.time() + STATE_SECONDS
        self.room.send_to_relay(self._session, self._said)

    # As a connection

    def send(self, message: BaseModel) -> None:
        self.send_frame(frame_of(MSGPACK.encode(message)))

    def answer_frame(self, frame: bytes) -> None:
        self.send_frame(frame)

    def send_frame(self, frame: bytes, count: int = 1) -> None:
        """Publish frames, together with all others of this turn of the event loop."""
        if not self._frames:
            self._loop.call_soon(self._publish)
        self._frames.append(frame)

    def _publish(self) -> None:
        frames, self._frames = b"".join(self._frames), []
        if self._ended:
            return
        for piece, begin in enumerate(range(0, len(frames), MAX_PIECE)):
            self.number += 1
            end = begin + MAX_PIECE
            more = end < len(frames)
            packet = Packet(self.claim, self.name, self.number, piece, more, frames[begin:end])
            self._bus.publish(subject_of(self.room.id), packet.pack())


class Relays:
    """Relays of this node's episodes."""

    def __init__(self, node: ClusterNode, lobby: Lobby) -> None:
        self._node = node
        self._lobby = lobby
        self._loop = asyncio.get_running_loop()
        self._relays: dict[str, Relay] = {}
        self._count = 0
        self._timer: asyncio.TimerHandle | None = None

    def watch(self, request: Watch) -> Watched:
        """Begin or continue to publish the updates of an episode.

        Raises:
            ProtocolError: `episode/unknown` if this node does not have the episode.
        """
        room, claim = self._room(request.episode)
        relay = self._relays.get(room.id)
        if relay is not None and (relay.room is not room or relay.claim != claim):
            self._end(room.id)
            relay = None
        if relay is None:
            self._count += 1
            name = f"{self._node.name}.{self._count}"
            relay = self._relays[room.id] = Relay(room, self._node.bus, claim, name)
        relay.renew(request)
        room.membership.first_names.learn(request.first_names)
        if request.state:
            relay.ask_state(request)
        if self._timer is None:
            self._timer = self._loop.call_later(TIDY_SECONDS, self._tidy)
        episode = room.episode
        return Watched(
            code=room.code,
            task=room.task,
            digest=room.world.task.digest,
            grace=room.grace,
            said=episode.record.said,
            chat=episode.rules.chat,
            first_names=room.membership.first_names.known,
            banned=tuple(room.membership.banned),
            seated=tuple(seat.session for seat in episode.seats.values() if seat.taken),
            claim=claim,
            relay=relay.name,
            number=relay.number,
        )

    def say(self, line: Line) -> None:
        """Post a chat line of a spectator on another node.

        Raises:
            ProtocolError: As `Room.say` does, or `episode/banned`.
        """
        room, _ = self._room(line.episode)
        if room.bans(line.session, line.participant):
            raise ProtocolError("episode/banned", "you were removed from this episode", "type")
        guest = Session(
            line.session,
            name=line.name,
            kind=line.kind,
            role=Role.SPECTATOR,
            participant=line.participant,
        )
        room.say_for(guest, line.text)

    def _room(self, episode: str) -> tuple[Room, int]:
        """Return a room of this node, and the claim of its episode."""
        room, record = self._lobby.rooms.get(episode), self._node.directory.find(episode)
        if room is None or record is None or record.node != self._node.name:
            raise ProtocolError("episode/unknown", "this node does not have the episode", "episode")
        return room, record.claim

    def _tidy(self) -> None:
        self._timer = None
        for episode, relay in list(self._relays.items()):
            relay.tidy()
            if not relay.leases or self._lobby.rooms.get(episode) is not relay.room:
                self._end(episode)
        if self._relays:
            self._timer = self._loop.call_later(TIDY_SECONDS, self._tidy)

    def _end(self, episode: str) -> None:
        self._relays.pop(episode).end()

    def close(self) -> None:
        """End all relays."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        for episode in list(self._relays):
            self._end(episode)
