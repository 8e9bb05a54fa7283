"""Messages between the node that has an episode and nodes with spectators of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import msgpack
from pydantic import BaseModel

from robotouille.episode import Chat
from robotouille.protocol.codec import MAX_SERVER_BYTES
from robotouille.protocol.frames import FrameReader

MAX_PACKET = 4 * MAX_SERVER_BYTES
"""Bytes of the frames in one packet. A relay joins the few messages of one step."""


class Watch(BaseModel):
    """Request of a node with spectators of an episode.

    Attributes:
        episode: The episode's id.
        node: The name of the node.
        spectators: The number of its spectators.
        names: The names of those who have watched longest.
        text: True if some of them read texts.
        state: True if the node needs a snapshot.
        task: True if the snapshot must contain the task.
        said: The number of the last chat message that the node has.
        first_names: The first names that participants must keep; see `FirstNames`.
    """

    episode: str
    node: str
    spectators: int = 0
    names: tuple[str, ...] = ()
    text: bool = False
    state: bool = False
    task: bool = False
    said: int = 0
    first_names: dict[str, str] = {}


class Watched(BaseModel):
    """Answer to `Watch`: facts that are not in the updates.

    Attributes:
        code: The code with which participants join.
        task: The name of the task.
        digest: The digest of the task.
        grace: The seconds for which an absent spectator keeps the place.
        said: The number of chat messages.
        chat: The rule for chat.
        first_names: The first names that participants must keep; see `FirstNames`.
        banned: The sessions and participants who were removed.
        seated: The sessions that have seats.
        claim: The journal's sequence number with which the owner took the episode over.
        relay: The name of the relay.
        number: The number of the last packet that it has published.
    """

    code: str
    task: str
    digest: str
    grace: float
    said: int
    chat: Chat
    first_names: dict[str, str]
    banned: tuple[str, ...]
    seated: tuple[str, ...]
    claim: int
    relay: str
    number: int


class Line(BaseModel):
    """Chat line of a spectator on another node."""

    episode: str
    session: str
    participant: str
    name: str
    kind: str
    text: str


class Packet(NamedTuple):
    """Message of a relay: frames of the MessagePack subprotocol, or a piece of them.

    Attributes:
        claim: The journal's sequence number with which the owner took the episode over.
        relay: The name of the relay.
        number: The number of the packet, without gaps.
        piece: The number of the piece, from 0.
        more: True if another piece follows.
        frames: The frames.
    """

    claim: int
    relay: str
    number: int
    piece: int
    more: bool
    frames: bytes

    def pack(self) -> bytes:
        packed: bytes = msgpack.packb(self)
        return packed

    @classmethod
    def unpack(cls, data: bytes) -> Packet:
        """Read a packet; raise ValueError or TypeError if it is not one."""
        return cls(*msgpack.unpackb(data))


def subject_of(episode: str) -> str:
    """Return the subject on which the updates of an episode are published."""
    return f"updates.{episode}"


class PacketReader:
    """Puts the packets of an episode's relays together, and notices missing ones.

    A relay of an earlier owner is ignored: its node may have been suspended, and continue.
    """

    def __init__(self) -> None:
        self._source = (0, "")
        self._number = 0
        self._pieces: list[bytes] = []
        self._announced = self._source, 0

    def owned(self, claim: int) -> bool:
        """Note the owner's claim; return True if it is a new owner, so that packets are missing."""
        new = claim > self._source[0]
        if new:
            self._begin((claim, ""))
        return new

    def announce(self, claim: int, relay: str, number: int) -> None:
        """Note the last packet of the relay, according to its owner."""
        self._announced = (claim, relay), number

    @property
    def behind(self) -> bool:
        """True if packets are missing that were announced; ask some time after `announce`."""
        source, number = self._announced
        if source[0] < self._source[0]:
            return False
        return source != self._source or number > self._number

    def read(self, data: bytes) -> tuple[bool, bytes]:
        """Read a packet; return True if packets before it are missing, and the frames.

        Raises:
            ValueError, TypeError: It is not a packet.
        """
        packet = Packet.unpack(data)
        source, missing = (packet.claim, packet.relay), False
        if packet.claim < self._source[0]:
            return False, b""
        if source != self._source:
            self._begin(source)
            missing = True
        elif packet.number <= self._number:
            return False, b""
        elif packet.number > self._number + 1:
            self._pieces.clear()
            missing = True
        self._number = packet.number
        if packet.piece != len(self._pieces):
            self._pieces.clear()
            return True, b""
        self._pieces.append(packet.frames)
        if sum(map(len, self._pieces)) > MAX_PACKET:
            self._pieces.clear()
            raise ValueError(f"a packet of more than {MAX_PACKET:,} bytes")
        if packet.more:
            return missing, b""
        frames = b"".join(self._pieces)
        self._pieces.clear()
        return missing, frames

    def _begin(self, source: tuple[int, str]) -> None:
        self._source, self._number = source, 0
        self._pieces.clear()


def split(frames: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Return each frame and its payload."""
    reader = FrameReader(masked=False, max_size=MAX_SERVER_BYTES)
    reader.receive(frames)
    while reader.next_frame():
        yield reader.raw, reader.content
