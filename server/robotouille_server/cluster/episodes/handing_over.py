"""Handing the episodes of a node that leaves over to other nodes, while they are played.

The other node first reads and restores an episode, while the game goes on here. Then the game waits
while the other node takes the journal over. It needs only what was written in between, and that
comes with the request.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, Self

from robotouille.episode import Event, Stepped
from robotouille_server.cluster.bus import Bus, BusError
from robotouille_server.cluster.episodes.journal import ReplicatedJournal, Tail
from robotouille_server.cluster.members import Members, NodeReport
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.logs import get_logger

AT_A_TIME = 8
"""Episodes at a time that other nodes prepare, or whose next step this node awaits."""
PAUSED_AT_A_TIME = 3
"""Episodes that are paused at a time. With more, each pause would be longer."""
ADOPT_SECONDS = 5.0
"""Seconds that another node has to take an episode over."""
STEP_SECONDS = 2.0
"""Longest time to wait for the next step of an episode. Most games have a step a second or more."""


@dataclass(frozen=True, slots=True)
class Offer:
    """Request to take an episode over.

    Attributes:
        node: The name of the node that hands it over.
        tail: The end of its journal. None if the other node must read the journal.
    """

    node: str
    tail: Tail | None = None

    def encode(self) -> bytes:
        name = self.node.encode()
        tail = self.tail
        return name if tail is None else b"%b\n%d %d\n%b" % (
            name, tail.sequence, tail.start, tail.data,
        )  # fmt: skip

    @classmethod
    def decode(cls, message: bytes) -> Self:
        """Return the offer in a message; an invalid one has no tail."""
        name, _, rest = message.partition(b"\n")
        numbers, _, data = rest.partition(b"\n")
        try:
            sequence, start = map(int, numbers.split())
        except ValueError:
            return cls(name.decode(errors="replace"))
        return cls(name.decode(errors="replace"), Tail(sequence, start, data))


class LeavingNode(Protocol):
    """Node that hands its episodes over; see `ClusterNode`."""

    @property
    def bus(self) -> Bus: ...

    @property
    def name(self) -> str: ...

    @property
    def members(self) -> Members: ...

    def has(self, room: Room) -> bool:
        """Return whether a room is still one of the node's rooms."""

    def give_up(self, episode: str, target: NodeReport | None = None) -> None:
        """Send the participants of an episode to the node that has it."""


class HandingOver:
    """Hands episodes over, a few at a time."""

    def __init__(self, node: LeavingNode) -> None:
        self._node = node
        self._limit = asyncio.Semaphore(AT_A_TIME)
        self._pausing = asyncio.Semaphore(PAUSED_AT_A_TIME)
        # Events and not futures: a step may come when the wait for it has just ended.
        self._stepping: dict[str, asyncio.Event] = {}

    def published(self, room: Room, events: Iterable[Event]) -> None:
        """Notice that an episode has taken a step."""
        taken = self._stepping.get(room.id)
        if taken is not None and any(isinstance(event, Stepped) for event in events):
            taken.set()

    async def hand_over(self, rooms: Iterable[Room]) -> None:
        """Hand episodes over to the least loaded nodes."""
        await asyncio.gather(*map(self._in_turn, rooms))

    async def _in_turn(self, room: Room) -> None:
        async with self._limit:
            journal, target = room.journal, self._node.members.other(room.id)
            if target is None or not isinstance(journal, ReplicatedJournal):
                return
            journal.keep_tail()
            # Most of the work of the other node, while the game goes on.
            with suppress(BusError):
                subject = f"prepare.{target.name}.{room.id}"
                await self._node.bus.request(subject, b"", ADOPT_SECONDS)
            await self._step(room)
            async with self._pausing:
                await self._hand_over(room, journal, target)

    async def _hand_over(self, room: Room, journal: ReplicatedJournal, target: NodeReport) -> None:
        try:
            await journal.stored()
            # While this node was suspended, another node may have taken the episode over. Only a
            # write shows whether this is so.
            if not journal.check_ownership():
                await journal.stored()
            if room.episode.ended or not self._node.has(room):
                return
            offer = Offer(self._node.name, journal.tail)
            room.suspend()
            subject = f"adopt.{target.name}.{room.id}"
            answer = await self._node.bus.request(subject, offer.encode(), ADOPT_SECONDS)
            refusal = answer.decode()
        except BusError as error:
            refusal = str(error)
        if refusal:
            get_logger().warning("episode not handed over", episode=room.id, reason=refusal)
        # If it failed, another node claims the episode when this one is gone.
        self._node.give_up(room.id, target)

    async def _step(self, room: Room) -> None:
        """Wait until an episode in real time takes its next step.

        After a pause, a whole period passes before the next step. If the pause begins just after a
        step, that step is late by no more than the pause.
        """
        if not (room.episode.running and room.episode.rules.scheduled):
            return
        taken = self._stepping[room.id] = asyncio.Event()
        try:
            with suppress(TimeoutError):
                async with asyncio.timeout(STEP_SECONDS):
                    await taken.wait()
        finally:
            del self._stepping[room.id]
