"""Stable codes of errors, rejections and closed connections.

The docstring below a code is its meaning in docs/protocol.md.
"""

from __future__ import annotations

from enum import StrEnum


# The part before the slash names the subject, so a client can classify a code that a later version
# adds.
class ErrorCode(StrEnum):
    """Code of an `error`, `rejected` or `bye`. Its value never changes between versions."""

    MESSAGE_MALFORMED = "message/malformed"
    """The frame is not JSON or MessagePack, is not an object, is nested too deeply, or has too
    many values."""
    MESSAGE_FRAME = "message/frame"
    """Binary frame with the JSON subprotocol, or text frame with MessagePack."""
    MESSAGE_TOO_LARGE = "message/too-large"
    """The message has too many bytes."""
    MESSAGE_UNKNOWN_TYPE = "message/unknown-type"
    """No message has this `type`."""
    MESSAGE_UNKNOWN_FIELD = "message/unknown-field"
    """The message has no such field."""
    MESSAGE_MISSING_FIELD = "message/missing-field"
    """A required field is missing."""
    MESSAGE_INVALID_FIELD = "message/invalid-field"
    """A field has the wrong type or an invalid value."""
    MESSAGE_UNEXPECTED = "message/unexpected"
    """Client library only: the server did not send the expected answer."""

    PROTOCOL_HELLO = "protocol/hello"
    """`hello` must be the first message, and only the first."""
    PROTOCOL_VERSION = "protocol/version"
    """The server speaks another protocol version."""

    AUTH_REQUIRED = "auth/required"
    """The server requires a role token."""
    AUTH_INVALID = "auth/invalid"
    """The token is not from this server, was changed, has the wrong kind, or is not valid yet."""
    AUTH_EXPIRED = "auth/expired"
    """The token has expired. A resume token also expires when its seat is lost or a later token
    replaces it."""
    AUTH_ROLE = "auth/role"
    """The client's role does not permit this request."""
    AUTH_EPISODE = "auth/episode"
    """The role token is for another episode, or it is limited to one episode and cannot create
    others. For a rematch: the client had no seat in the old episode."""
    AUTH_SEAT = "auth/seat"
    """The role token is for another seat."""
    AUTH_REVOKED = "auth/revoked"
    """The operator revoked the role token."""
    AUTH_USED = "auth/used"
    """The role token is valid for one session, and another session has used it."""
    AUTH_SILENT = "auth/silent"
    """`bye` only: the client did not send `hello` in time."""

    RATE_LIMITED = "rate/limited"
    """Too many messages per second; the server dropped this one. In `bye`: far too many."""
    RATE_WORDS = "rate/words"
    """The seat (or all spectators together) used up its quota of recorded text. Send the action
    again without `reasoning`, with the same `seq`."""
    RATE_CHAT = "rate/chat"
    """Too many chat lines from the seat, or from all spectators together. Wait a second."""
    RATE_CODES = "rate/codes"
    """Too many wrong episode codes from this address or token subject. Wait."""
    RATE_CONNECTIONS = "rate/connections"
    """`bye` only: too many connections from this address or token subject, or the connection had
    not sent `hello` and a newer one from the address needed its place."""
    RATE_SEATS = "rate/seats"
    """The seat was taken, resumed or made ready too often. Wait."""
    RATE_EPISODES = "rate/episodes"
    """The token's owner has too many episodes, or a player has asked for too many rematches."""

    SESSION_ELSEWHERE = "session/elsewhere"
    """`bye` only: another connection used the resume or role token of the seat."""

    SERVER_FULL = "server/full"
    """The server has too many episodes, or its disk is nearly full."""
    SERVER_DRAINING = "server/draining"
    """The server is about to restart and creates no episodes. Try again soon."""
    SERVER_HANDOVER = "server/handover"
    """The episode is moving to another process. Try again soon."""
    SERVER_RECORDING = "server/recording"
    """The server cannot write the episode's recording, so the episode cannot start or clients
    cannot join. A `bye` with `retry` leaves the resume token valid."""
    SERVER_INTERNAL = "server/internal"
    """The server failed to handle the message. The operator's log has the details."""
    SERVER_RESTART = "server/restart"
    """`bye` only: the server is restarting. Reconnect."""
    SERVER_STOPPED = "server/stopped"
    """`bye` only: the server was stopped."""
    SERVER_BYE = "server/bye"
    """`bye` for a reason without a code of its own."""

    TASK_UNKNOWN = "task/unknown"
    """No task has this name."""
    TASK_INVALID = "task/invalid"
    """The task does not support these options, such as the number of seats, or its name is
    ambiguous."""

    EPISODE_UNKNOWN = "episode/unknown"
    """No episode has this id or code."""
    EPISODE_FULL = "episode/full"
    """All seats are taken, or the episode has too many spectators."""
    EPISODE_JOINED = "episode/joined"
    """The client is already in an episode and must leave it first."""
    EPISODE_NONE = "episode/none"
    """The client is not in an episode."""
    EPISODE_WAITING = "episode/waiting"
    """The episode has not started: seats are free, or a participant is not ready."""
    EPISODE_ENDED = "episode/ended"
    """The episode has ended."""
    EPISODE_BANNED = "episode/banned"
    """The operator removed the participant from this episode."""

    SEAT_TAKEN = "seat/taken"
    """Another participant has this seat."""
    SEAT_UNKNOWN = "seat/unknown"
    """The episode has no such seat, or the client does not have it."""
    SEAT_NONE = "seat/none"
    """Spectators cannot act."""
    SEAT_PARTIAL = "seat/partial"
    """Players of this episode see a part of the kitchen, and the client does not support this
    (`partial`)."""
    SEAT_MUTED = "seat/muted"
    """The operator muted the participant. The message was neither delivered nor recorded."""
    SEAT_LOST = "seat/lost"
    """Client library only: it had to join the seat again, so the action's result is unknown."""

    CHAT_OFF = "chat/off"
    """Chat is off in this episode."""
    CHAT_PHRASE = "chat/phrase"
    """Only signals, or only the phrases in the rules, may be sent in this episode."""
    CHAT_TARGET = "chat/target"
    """The signal has no target, or cannot point at it."""

    ACTION_INVALID = "action/invalid"
    """The action's preconditions do not hold, it is another player's turn, or the action moves
    another seat's player."""
    ACTION_UNKNOWN = "action/unknown"
    """The text, index, name or arguments match no action, or the text matches several. `reasons`
    lists the nearest valid sentences."""
    ACTION_STALE = "action/stale"
    """The sequence number or `basis` is outdated. The current state follows."""

    STATE_MISMATCH = "state/mismatch"
    """Client library only: a snapshot does not fit the client's world."""
