"""The life of a client: its states, and the one table of what leads from one to another."""

from __future__ import annotations

from enum import Enum

from robotouille.errors import ProtocolError
from robotouille.protocol.error_codes import ErrorCode

__all__ = ["TRANSITIONS", "ClientState", "Trigger", "next_state"]


class ClientState(Enum):
    """Where a client stands with its server."""

    OFFLINE = "there is no connection"
    MOVING = "on the way to another process of the server"
    GREETING = "hello has no answer yet"
    LOBBY = "welcome, and in no episode"
    RESUMING = "welcomed back; if we are in an episode, joined follows"
    REJOINING = "welcome, but forgotten; our seat is asked for anew"
    SYNCING = "joined; the first snapshot or observation is on its way"
    PLAYING = "in an episode"
    CLOSED = "for good"

    @property
    def connected(self) -> bool:
        """Whether there is a connection."""
        return self not in (ClientState.OFFLINE, ClientState.MOVING, ClientState.CLOSED)

    @property
    def online(self) -> bool:
        """Whether there is a connection on which the server has welcomed us."""
        return self.connected and self is not ClientState.GREETING


class Trigger(Enum):
    """What changes the state."""

    CONNECTED = "a connection was made"
    FAILED = "a connection could not be made, or led to no welcome"
    UNKNOWN = "the resume token is worth nothing"
    WELCOMED = "welcome, as somebody new"
    RESUMED = "welcome back"
    FORGOTTEN = "welcome, although we were in an episode"
    ENTERED = "joined, and nothing seen of the episode so far"
    RETURNED = "joined, in an episode of which we have a copy"
    SYNCED = "the first snapshot or observation"
    REFUSED = "our seat is not given back"
    LEFT = "out of the episode"
    MOVED = "another process has what we want"
    LOST = "the connection was lost"
    CLOSE = "the end"


TRANSITIONS: dict[ClientState, dict[Trigger, ClientState]] = {
    ClientState.OFFLINE: {
        Trigger.CONNECTED: ClientState.GREETING,
        Trigger.FAILED: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.MOVING: {
        Trigger.CONNECTED: ClientState.GREETING,
        Trigger.FAILED: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.GREETING: {
        Trigger.UNKNOWN: ClientState.GREETING,
        Trigger.WELCOMED: ClientState.LOBBY,
        Trigger.RESUMED: ClientState.RESUMING,
        Trigger.FORGOTTEN: ClientState.REJOINING,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.FAILED: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.LOBBY: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.LEFT: ClientState.LOBBY,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.LOST: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.RESUMING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.RETURNED: ClientState.PLAYING,
        Trigger.LEFT: ClientState.LOBBY,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.LOST: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.REJOINING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.RETURNED: ClientState.PLAYING,
        Trigger.REFUSED: ClientState.LOBBY,
        Trigger.LEFT: ClientState.LOBBY,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.LOST: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.SYNCING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.SYNCED: ClientState.PLAYING,
        Trigger.LEFT: ClientState.LOBBY,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.LOST: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.PLAYING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.RETURNED: ClientState.PLAYING,
        Trigger.LEFT: ClientState.LOBBY,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.LOST: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.CLOSED: {},
}
"""What may happen in each state, and where it leads; nothing else is legal."""


def next_state(state: ClientState, trigger: Trigger) -> ClientState:
    """Where a trigger leads; ProtocolError where it is illegal."""
    try:
        return TRANSITIONS[state][trigger]
    except KeyError:
        detail = f"{trigger.value}, while {state.value}"
        raise ProtocolError(ErrorCode.MESSAGE_UNEXPECTED, detail) from None
