"""Slots on the operator's port: how many connections there may be, and who makes room for whom.

The port is small, and whoever opens connections faster than others must not lock the operator
out. So it is never full for a newcomer as long as somebody has shown no token: of those, the one
goes that has said nothing for the longest, then the one that has been between two requests for
the longest, then the one that has been answered for the longest. Whose last request came with a
valid token goes for nobody.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from http import HTTPStatus
from itertools import count

from websockets.datastructures import Headers

from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.auth import visitor

__all__ = [
    "MAX_CONNECTIONS",
    "MAX_PER_ADDRESS",
    "MAX_PER_SUBJECT",
    "ConnectionSlot",
    "ConnectionSlots",
    "Standing",
]

MAX_CONNECTIONS = 128
MAX_PER_ADDRESS = 32
"""Connections from an address that have shown no token; this machine's may be as many as all."""
MAX_PER_SUBJECT = 32
"""Connections with tokens of one subject: one operator's pages leave room for another's."""


class Standing(IntEnum):
    """What is known of a connection, in the order in which they make room."""

    SILENT = 0
    """It has not made a request yet."""
    IDLE = 1
    """It is between two requests."""
    BUSY = 2
    """It is being answered, and has shown no token."""
    KNOWN = 3
    """Its last request came with a valid token."""


class ConnectionSlot:
    """One connection. `cut` ends it at once; `group` is what its address counts as, empty for
    this machine's; `since` orders those of equal standing."""

    __slots__ = ("_slots", "address", "cut", "group", "since", "standing", "subject")

    def __init__(
        self, slots: ConnectionSlots, address: str, group: str, since: int, cut: Callable[[], None]
    ) -> None:
        self._slots = slots
        self.address = address
        self.group = group
        self.since = since
        self.cut = cut
        self.standing = Standing.SILENT
        self.subject = ""

    def stand(self, standing: Standing) -> None:
        """What is known of it changes now."""
        self.standing = standing
        self.since = self._slots.moment()

    def answered(self) -> None:
        """A request is over."""
        if self.standing is not Standing.KNOWN:
            self.stand(Standing.IDLE)

    def know(self, subject: str) -> None:
        """Its request came with a valid token of this subject; RequestRefusedError if
        that has too many connections already."""
        others = self._slots.known(subject, other_than=self)
        if others >= MAX_PER_SUBJECT:
            message = f"{MAX_PER_SUBJECT} connections have your token already; close one"
            raise RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "operator/busy", message)
        self.subject = subject
        self.stand(Standing.KNOWN)

    def leave(self) -> None:
        """The connection is over."""
        self._slots.forget(self)


class ConnectionSlots:
    """All connections of the port."""

    def __init__(self) -> None:
        self._taken: set[ConnectionSlot] = set()
        self._moments = count()

    def __len__(self) -> int:
        return len(self._taken)

    def take(self, peer: object, cut: Callable[[], None]) -> ConnectionSlot | None:
        """A slot for a newcomer with this socket address; None if nobody makes room."""
        who = visitor(peer, Headers())
        group = "" if who.local else who.group
        if group:
            same = [slot for slot in self._unknown() if slot.group == group]
            if len(same) >= MAX_PER_ADDRESS:
                self._displace(same)
        if len(self._taken) >= MAX_CONNECTIONS:
            unknown = self._unknown()
            if not unknown:
                return None
            self._displace(unknown)
        slot = ConnectionSlot(self, who.address, group, self.moment(), cut)
        self._taken.add(slot)
        return slot

    def known(self, subject: str, other_than: ConnectionSlot) -> int:
        """How many other connections have tokens of a subject."""
        return sum(
            slot.subject == subject and slot.standing is Standing.KNOWN
            for slot in self._taken
            if slot is not other_than
        )

    def moment(self) -> int:
        """A number that grows each time."""
        return next(self._moments)

    def forget(self, slot: ConnectionSlot) -> None:
        """A connection is over."""
        self._taken.discard(slot)

    def clear(self) -> None:
        """End all connections."""
        for slot in list(self._taken):
            slot.cut()
        self._taken.clear()

    def _unknown(self) -> list[ConnectionSlot]:
        return [slot for slot in self._taken if slot.standing is not Standing.KNOWN]

    def _displace(self, some: list[ConnectionSlot]) -> None:
        last = min(some, key=lambda slot: (slot.standing, slot.since))
        self.forget(last)
        last.cut()
