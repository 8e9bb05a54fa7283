"""The codes of errors, rejections and goodbyes; docs/protocol.md says what each means."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["ErrorCode"]


class ErrorCode(StrEnum):
    """What is wrong, in a word that does not change from one version to the next."""

    MESSAGE_MALFORMED = "message/malformed"
    MESSAGE_FRAME = "message/frame"
    MESSAGE_TOO_LARGE = "message/too-large"
    MESSAGE_UNKNOWN_TYPE = "message/unknown-type"
    MESSAGE_UNKNOWN_FIELD = "message/unknown-field"
    MESSAGE_MISSING_FIELD = "message/missing-field"
    MESSAGE_INVALID_FIELD = "message/invalid-field"
    MESSAGE_UNEXPECTED = "message/unexpected"

    PROTOCOL_HELLO = "protocol/hello"
    PROTOCOL_VERSION = "protocol/version"

    AUTH_REQUIRED = "auth/required"
    AUTH_INVALID = "auth/invalid"
    AUTH_EXPIRED = "auth/expired"
    AUTH_ROLE = "auth/role"
    AUTH_EPISODE = "auth/episode"
    AUTH_SEAT = "auth/seat"
    AUTH_REVOKED = "auth/revoked"
    AUTH_USED = "auth/used"
    AUTH_SILENT = "auth/silent"

    RATE_LIMITED = "rate/limited"
    RATE_WORDS = "rate/words"
    RATE_CODES = "rate/codes"
    RATE_CONNECTIONS = "rate/connections"
    RATE_SEATS = "rate/seats"
    RATE_EPISODES = "rate/episodes"

    SESSION_ELSEWHERE = "session/elsewhere"

    SERVER_FULL = "server/full"
    SERVER_DRAINING = "server/draining"
    SERVER_HANDOVER = "server/handover"
    SERVER_RECORDING = "server/recording"
    SERVER_INTERNAL = "server/internal"
    SERVER_RESTART = "server/restart"
    SERVER_STOPPED = "server/stopped"
    SERVER_BYE = "server/bye"

    TASK_UNKNOWN = "task/unknown"
    TASK_INVALID = "task/invalid"

    EPISODE_UNKNOWN = "episode/unknown"
    EPISODE_FULL = "episode/full"
    EPISODE_JOINED = "episode/joined"
    EPISODE_NONE = "episode/none"
    EPISODE_WAITING = "episode/waiting"
    EPISODE_OVER = "episode/over"
    EPISODE_BANNED = "episode/banned"

    SEAT_TAKEN = "seat/taken"
    SEAT_UNKNOWN = "seat/unknown"
    SEAT_NONE = "seat/none"
    SEAT_MUTED = "seat/muted"
    SEAT_LOST = "seat/lost"

    CHAT_OFF = "chat/off"
    CHAT_PHRASE = "chat/phrase"

    ACTION_INVALID = "action/invalid"
    ACTION_UNKNOWN = "action/unknown"
    ACTION_STALE = "action/stale"

    STATE_MISMATCH = "state/mismatch"
