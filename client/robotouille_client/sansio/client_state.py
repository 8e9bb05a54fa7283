"""The life of a client: its states, and the one table of what leads from one to another."""

from __future__ import annotations

from enum import Enum

from robotouille.errors import ProtocolError
from robotouille.protocol.error_codes import ErrorCode

__all__ = ["TRANSITIONS", "State", "Trigger", "next_state"]


class State(Enum):
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
        return self not in (State.OFFLINE, State.MOVING, State.CLOSED)

    @property
    def online(self) -> bool:
        """Whether there is a connection on which the server has welcomed us."""
        return self.connected and self is not State.GREETING


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


TRANSITIONS: dict[State, dict[Trigger, State]] = {
    State.OFFLINE: {
        Trigger.CONNECTED: State.GREETING,
        Trigger.FAILED: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.MOVING: {
        Trigger.CONNECTED: State.GREETING,
        Trigger.FAILED: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.GREETING: {
        Trigger.UNKNOWN: State.GREETING,
        Trigger.WELCOMED: State.LOBBY,
        Trigger.RESUMED: State.RESUMING,
        Trigger.FORGOTTEN: State.REJOINING,
        Trigger.MOVED: State.MOVING,
        Trigger.FAILED: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.LOBBY: {
        Trigger.ENTERED: State.SYNCING,
        Trigger.LEFT: State.LOBBY,
        Trigger.MOVED: State.MOVING,
        Trigger.LOST: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.RESUMING: {
        Trigger.ENTERED: State.SYNCING,
        Trigger.RETURNED: State.PLAYING,
        Trigger.LEFT: State.LOBBY,
        Trigger.MOVED: State.MOVING,
        Trigger.LOST: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.REJOINING: {
        Trigger.ENTERED: State.SYNCING,
        Trigger.RETURNED: State.PLAYING,
        Trigger.REFUSED: State.LOBBY,
        Trigger.LEFT: State.LOBBY,
        Trigger.MOVED: State.MOVING,
        Trigger.LOST: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.SYNCING: {
        Trigger.ENTERED: State.SYNCING,
        Trigger.SYNCED: State.PLAYING,
        Trigger.LEFT: State.LOBBY,
        Trigger.MOVED: State.MOVING,
        Trigger.LOST: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.PLAYING: {
        Trigger.ENTERED: State.SYNCING,
        Trigger.RETURNED: State.PLAYING,
        Trigger.LEFT: State.LOBBY,
        Trigger.MOVED: State.MOVING,
        Trigger.LOST: State.OFFLINE,
        Trigger.CLOSE: State.CLOSED,
    },
    State.CLOSED: {},
}
"""What may happen in each state, and where it leads; nothing else is legal."""


def next_state(state: State, trigger: Trigger) -> State:
    """Where a trigger leads; ProtocolError where it is illegal."""
    try:
        return TRANSITIONS[state][trigger]
    except KeyError:
        detail = f"{trigger.value}, while {state.value}"
        raise ProtocolError(ErrorCode.MESSAGE_UNEXPECTED, detail) from None
