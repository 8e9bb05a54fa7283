"""The table of all limits, from the settings and constants that are in force.

docs/limits.md is made of it, so that what is written there is what the code does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from robotouille.domain.files import MAX_NESTING
from robotouille.domain.pictures import MAX_PICTURE_BYTES, MAX_SIDE
from robotouille.domain.pictures.svg import MAX_OUTLINES, MAX_SHAPES
from robotouille.episode.quota import (
    MAX_AUDIENCE_BYTES,
    MAX_SEAT_BYTES,
    NEWCOMER_BYTES,
    SEAT_QUOTA_BYTES,
)
from robotouille.episode.rules import MAX_DELAY_MS, MAX_PHRASES, MOVE_BUDGET
from robotouille.protocol import messages
from robotouille.protocol.codec import (
    MAX_CLIENT_BYTES,
    MAX_DEPTH,
    MAX_FIELDS,
    MAX_ITEMS,
    MAX_SERVER_BYTES,
)
from robotouille.replay.bounded_msgpack import MAX_ENTRIES
from robotouille.replay.container import MAX_FILE, MAX_FRAME
from robotouille.world.sentences import MAX_SENTENCE
from robotouille_server.admin.http.connection_slots import (
    MAX_CONNECTIONS,
    MAX_PER_ADDRESS,
    MAX_PER_SUBJECT,
)
from robotouille_server.admin.http.event_streams import MAX_STREAMS, MAX_STREAMS_PER_SUBJECT
from robotouille_server.admin.http.guard import MAX_BODY
from robotouille_server.admin.http.logins import REFUSED_A_MINUTE
from robotouille_server.admin.http.timeouts import (
    KEEP_ALIVE_SECONDS,
    REQUEST_SECONDS,
    STALL_SECONDS,
)
from robotouille_server.auth.revocation import KEPT_SECONDS
from robotouille_server.auth.revocation import MAX_ENTRIES as MAX_REVOKED
from robotouille_server.auth.visitors import WRONG_CODES_A_MINUTE
from robotouille_server.conversation.message_budget import COSTS, MAX_HELLO_BYTES, MAX_REFUSED
from robotouille_server.mqtt.commands import COMMANDS_A_SECOND, COMMANDS_BURST, KEPT_ANSWERS
from robotouille_server.mqtt.connection import MAX_PACKET_BYTES
from robotouille_server.mqtt.models import MAX_OPENED, MAX_WATCH_SECONDS
from robotouille_server.mqtt.outbox import MAX_MESSAGES, MAX_STEPS
from robotouille_server.mqtt.watches import MAX_WATCHES
from robotouille_server.rooms.broadcast.broadcaster import MAX_SPECTATOR_NAMES
from robotouille_server.rooms.broadcast.spectator_rosters import ROSTER_SECONDS
from robotouille_server.rooms.directory.listing import MAX_CODES
from robotouille_server.rooms.directory.rematches import MAX_FINISHED
from robotouille_server.rooms.lobby import CODE_LENGTH, LINGER_SECONDS
from robotouille_server.rooms.recordings import archive
from robotouille_server.rooms.recordings.journal import MAX_RECORDING_BYTES
from robotouille_server.rooms.seats.seat_turnover import SEAT_CHANGES, SEAT_CHANGES_AT_ONCE
from robotouille_server.rooms.seats.slow_seats import WAITING_SECONDS
from robotouille_server.rooms.write_ahead import MAX_UNWRITTEN
from robotouille_server.runtime.audit_log import KEPT_FILES, MAX_AUDIT_BYTES
from robotouille_server.runtime.descriptors import RESERVED
from robotouille_server.runtime.settings import ServerSettings
from robotouille_server.runtime.task_folder import MAX_FILES
from robotouille_server.transport.admission import (
    HANDSHAKES_AT_ONCE,
    LOOP_BUDGET,
    MAX_SURPLUS_CONNECTIONS,
)
from robotouille_server.transport.connection import (
    FRAMES_A_SECOND,
    FRAMES_AT_A_TIME,
    FRAMES_BURST,
    MAX_EXCESS,
    MAX_REQUEST,
)
from robotouille_server.transport.peer import MAX_HELD, MAX_UNSENT

__all__ = ["LIMITS", "Limit", "limits_page", "shown_value"]


@dataclass(frozen=True, slots=True)
class Limit:
    """One limit: of what, where it is set (a setting's name, or else `value`), what happens
    beyond it, and the code with which that is answered."""

    what: str
    beyond: str
    code: str = ""
    setting: str = ""
    value: str = ""
    unit: str = ""


def _size(count: int) -> str:
    mebi, kibi = divmod(count, 1024 * 1024), divmod(count, 1024)
    return f"{mebi[0]} MiB" if not mebi[1] else f"{kibi[0]} KiB" if not kibi[1] else f"{count} B"


def _longest(model: type[BaseModel], name: str, unit: str = "characters") -> str:
    """What a message's field may hold, from its declaration."""
    schema: dict[str, Any] = model.model_json_schema()["properties"][name]
    parts = [schema, *schema.get("anyOf", [])]
    found = next(
        part[key] for part in parts for key in ("maxLength", "maxItems", "maximum") if key in part
    )
    return f"{found:,} {unit}".rstrip()


def _range(model: type[BaseModel], name: str) -> str:
    """The least and the greatest value of a message's field."""
    number = model.model_json_schema()["properties"][name]["anyOf"][0]
    return f"{number['minimum']:g} to {number['maximum']:g}"


def _cost(model: type[messages.Message]) -> str:
    return f"{COSTS[model]:g} messages"


INVALID = "message/invalid-field"

LIMITS: dict[str, tuple[Limit, ...]] = {
    "Messages": (
        Limit(
            "a client's message",
            "refused; beyond twice that the connection is closed with status 1009",
            "message/too-large",
            value=_size(MAX_CLIENT_BYTES),
        ),
        Limit(
            "nesting of a message",
            "refused; a nested `act` as `message/invalid-field`",
            "message/malformed",
            value=f"{MAX_DEPTH} levels (MessagePack), {MAX_NESTING} (JSON)",
        ),
        Limit(
            "… before `hello` is answered",
            "refused",
            "message/too-large",
            value=_size(MAX_HELLO_BYTES),
        ),
        Limit(
            "values in a message, and fields of one object in it",
            "refused",
            "message/malformed",
            value=f"{MAX_ITEMS}, {MAX_FIELDS}",
        ),
        Limit(
            "messages a second and connection",
            "the message is dropped; bursts of twice as many are taken",
            "rate/limited",
            setting="messages_per_second",
        ),
        Limit(
            "messages beyond that rate, in about a minute; each 8 KiB count as one more",
            "the connection is closed",
            "rate/limited",
            value=f"{MAX_REFUSED}",
        ),
        Limit("… of them `create` and `close`", "read later; nothing is dropped",
              setting="messages_per_second"),
        Limit("cost of `join` and `resync`", "counts as so many", value=_cost(messages.Join)),
        Limit("cost of `list`", "counts as so many", value=_cost(messages.ListEpisodes)),
        Limit("cost of a KiB of a message, a snapshot or a list", "counts as so many",
              value="1 message"),
        Limit(
            "control frames, and parts of messages (each KiB of them counts as one more)",
            "pings are not answered, and a message in parts ends the connection",
            value=f"{FRAMES_A_SECOND:g} a second, {FRAMES_BURST:g} at once",
        ),
        Limit("… beyond that, in all", "disconnected", value=f"{MAX_EXCESS}"),
        Limit(
            "frames of all connections that are dealt with between two looks at what is due",
            "the rest waits its turn, and nothing more is read",
            value=f"{LOOP_BUDGET:g}",
        ),
        Limit(
            "frames of one connection that are dealt with before all others have their turn",
            "the rest waits, and nothing more is read",
            value=f"{FRAMES_AT_A_TIME}",
        ),
        Limit("a piece of a note", "refused", INVALID, value=_longest(messages.Note, "text")),
        Limit("a chat message", "refused", INVALID, value=_longest(messages.Say, "text")),
        Limit(
            "a name", "refused; so is one of which nothing can be seen", INVALID,
            value=_longest(messages.Hello, "name"),
        ),
        Limit("a token", "refused", INVALID, value=_longest(messages.Hello, "token")),
        Limit(
            "an action as a text", "refused", INVALID, value=f"{MAX_SENTENCE:,} characters"
        ),
        Limit(
            "reasoning with an action", "refused", INVALID,
            value=_longest(messages.Act, "reasoning"),
        ),
        Limit(
            "declared thinking of an action", "refused", INVALID,
            value=_longest(messages.Act, "think_ms", "ms"),
        ),
        Limit(
            "digests in `known`", "refused", INVALID, value=_longest(messages.Join, "known", "")
        ),
        Limit("seats of a join", "refused", INVALID, value=_longest(messages.Join, "seats", "")),
        Limit("a server's message", "the client library closes", value=_size(MAX_SERVER_BYTES)),
    ),
    "Connections": (
        Limit("connections", "HTTP status 503", setting="max_connections"),
        Limit(
            "connections from an address (IPv6: a /64 network) without a token, except of this "
            "machine",
            "`bye` in answer to `hello`, status 1013",
            "rate/connections",
            setting="max_connections_per_address",
        ),
        Limit(
            "connections with tokens of one subject, from everywhere",
            "`bye` in answer to `hello`, status 1013",
            "rate/connections",
            setting="max_connections_per_address",
        ),
        Limit(
            "connections from an address that have not said `hello`",
            "the newcomer takes the place of the oldest: `bye`, status 1013",
            "rate/connections",
            setting="max_connections_per_address",
        ),
        Limit(
            "time to say `hello`", "`bye`, status 1008", "auth/silent",
            setting="hello_seconds", unit="s",
        ),
        Limit("connections whose handshake says that the server is full", "disconnected",
              value=f"{MAX_SURPLUS_CONNECTIONS:,} more"),
        Limit("bytes of the handshake, and behind it before it is answered", "disconnected",
              value=_size(MAX_REQUEST)),
        Limit("TLS handshakes at a time",
              "others wait; one that takes more than a second makes room for them",
              value=f"{HANDSHAKES_AT_ONCE}"),
        Limit(
            "file descriptors that connections leave free",
            "newcomers are disconnected until there are more",
            value=f"{RESERVED}, or an eighth of the system's limit",
        ),
        Limit("answer to a ping (every 20 s)", "disconnected", value="20 s"),
        Limit(
            "bytes that wait for a client",
            "no deltas and no pongs until they are read, then a snapshot; nothing it says is read "
            "meanwhile",
            value=_size(MAX_UNSENT),
        ),
        Limit("… for so long", "disconnected", setting="stall_seconds", unit="s"),
        Limit("… and at most", "disconnected", value=_size(MAX_HELD)),
    ),
    "Who may come in": (
        Limit(
            "wrong ids or codes from an address (IPv6: a /64 network), or with tokens of one "
            "subject",
            "`join` is refused; one more may be tried every "
            f"{60 / WRONG_CODES_A_MINUTE:g} s",
            "rate/codes",
            value=f"{WRONG_CODES_A_MINUTE} a minute",
        ),
        Limit(
            "length of a code",
            f"one of 23^{CODE_LENGTH}, about 4 × 10^13",
            value=f"{CODE_LENGTH} letters",
        ),
        Limit("a resume token is good for", "refused", "auth/expired", setting="resume_hours",
              unit="h"),
        Limit("sessions that join with a token of `mint --once`", "refused", "auth/used",
              value="1"),
        Limit("revoked tokens in the list", "`robotouille-token revoke` refuses",
              value=f"{MAX_REVOKED:,}"),
        Limit("time for which a revoked token is remembered after its end, at least",
              "it has expired", "auth/expired", value=f"{KEPT_SECONDS / 86400:g} days"),
    ),
    "Episodes": (
        Limit("episodes that are not over", "`create` is refused", "server/full",
              setting="max_episodes"),
        Limit(
            "… of one owner, the subject of a role token",
            "`create` is refused",
            "rate/episodes",
            setting="max_episodes_per_owner",
        ),
        Limit(
            "… that are kept open for somebody who has not come (`open_for`)",
            "`create` is refused",
            "rate/episodes",
            setting="max_reserved_per_owner",
        ),
        Limit("time for which an episode is kept open", "refused", INVALID,
              value="1 minute to 90 days"),
        Limit("labels, phrases of an episode", "refused", INVALID,
              value=f"16, {MAX_PHRASES}"),
        Limit("delay of a seat's actions", "refused", INVALID, value=f"{MAX_DELAY_MS / 1000:g} s"),
        Limit("games that are over, and a process remembers for a rematch",
              "the oldest are unknown", "episode/unknown", value=f"{MAX_FINISHED}"),
        Limit("codes closed unused that a process remembers", "the oldest are unknown",
              "episode/unknown", value=f"{MAX_CODES:,}"),
        Limit("files in the folder of own tasks", "the server does not start",
              value=f"{MAX_FILES:,}"),
        Limit("a picture of an own task", "the server does not start",
              value=f"{MAX_PICTURE_BYTES // 1024} KiB, {MAX_SIDE:,} pixels a side or "
              f"{MAX_SHAPES:,} elements, with outlines of {MAX_OUTLINES // 1024} KiB"),
        Limit("seats", "refused", INVALID, value=_longest(messages.Create, "seats", "")),
        Limit(
            "times a seat is taken, come back to, or ready or not",
            "`join` and `ready` are refused; coming back, `bye` with `retry`",
            "rate/seats",
            value=f"{SEAT_CHANGES} a minute, {SEAT_CHANGES_AT_ONCE} at once",
        ),
        Limit(
            "words of a seat in a recording: reasoning, rejected actions, chat, notes",
            "reasoning and chat are refused, rejected actions told and not recorded",
            "rate/words",
            value=_size(SEAT_QUOTA_BYTES),
        ),
        Limit(
            "… of which somebody who takes a seat has at least",
            "as before, and so it is from "
            f"{_size(MAX_SEAT_BYTES)} of one seat on",
            "rate/words",
            value=_size(NEWCOMER_BYTES),
        ),
        Limit(
            "… of all spectators of an episode", "chat is refused", "rate/words",
            value=_size(MAX_AUDIENCE_BYTES),
        ),
        Limit(
            "a recording, before it is compressed", "the episode ends: `aborted`",
            value=_size(MAX_RECORDING_BYTES),
        ),
        Limit("spectators of an episode", "`join` is refused, and so is coming back",
              "episode/full",
              setting="max_spectators"),
        Limit("… whose names are sent", "those who came later are only counted",
              value=str(MAX_SPECTATOR_NAMES)),
        Limit("rosters because spectators come, go, or lose or regain the connection",
              "everybody is told of all of them together",
              value=f"one in {ROSTER_SECONDS:g} s"),
        Limit("steps of an episode that asks for nothing else", "it ends: `step_limit`",
              setting="max_steps"),
        Limit("… that asks for more", "refused", INVALID,
              value=_longest(messages.Create, "max_steps", "")),
        Limit("steps a second in real time", "refused", INVALID,
              value=_range(messages.Create, "step_rate")),
        Limit("time for a move, with several seats and where nothing is said",
              "the step is taken, the seat does nothing (`--move-budget`; 0: no limit)",
              value=f"{MOVE_BUDGET:g} s"),
        Limit("time a step waits before everybody is told for whom", "`roster` with `waits_for`",
              value=f"{WAITING_SECONDS:g} s"),
        Limit("time for which an absent player's seat is kept", "as the episode's `absence` says",
              setting="grace", unit="s"),
        Limit("time for which players may come back after a restart",
              "as for those who are absent", setting="recovery_seconds", unit="s"),
        Limit("bytes that wait while a recording cannot be written",
              "`bye` with `retry`: nobody comes back until there is space", "server/recording",
              value=_size(MAX_UNWRITTEN)),
        Limit("time an episode stays after its end", "it can be joined no more",
              "episode/unknown", value=f"{LINGER_SECONDS:g} s"),
        Limit("time for which a server that was sent SIGTERM lets episodes end",
              "they are handed over", setting="drain_seconds", unit="s"),
    ),
    "Recordings": (
        Limit("a recording, uncompressed", "it is not read", value=_size(MAX_FILE)),
        Limit("a frame of it", "it is neither written nor read", value=_size(MAX_FRAME)),
        Limit("values in a frame", "it is neither written nor read", value=f"{MAX_ENTRIES:,}"),
        Limit("steps of an ended episode that is shown to who comes back late",
              "one is told that it is over", "auth/expired", value=f"{archive.MAX_STEPS:,}"),
        Limit("… and bytes of its recording, uncompressed", "one is told that it is over",
              "auth/expired", value=_size(archive.MAX_BYTES)),
        Limit("episodes whose end is looked for at a time", "one is told to come in anew",
              "auth/expired", value=f"{archive.MAX_SOUGHT}"),
        Limit("looks at the recordings folder for those who come back late",
              "they wait for the next one", value=f"one in {archive.LIST_SECONDS:g} s"),
    ),
    "The operator's port": (
        Limit(
            "connections",
            "a newcomer takes the place of one that has shown no token: the one that has been "
            "silent for the longest, else idle, else answered",
            value=f"{MAX_CONNECTIONS}",
        ),
        Limit(
            "… without a token from an address (IPv6: a /64 network), except of this machine",
            "likewise, among those of the address",
            value=f"{MAX_PER_ADDRESS}",
        ),
        Limit("… with tokens of one subject", "HTTP status 503, `operator/busy`",
              value=f"{MAX_PER_SUBJECT}"),
        Limit("time for a TLS handshake, for a request's head, and for its body", "disconnected",
              value=f"{REQUEST_SECONDS:g} s"),
        Limit("time between two requests", "disconnected", value=f"{KEEP_ALIVE_SECONDS} s"),
        Limit("time without any progress of an answer that waits to be read", "disconnected",
              value=f"{STALL_SECONDS:g} s"),
        Limit("a request's body", "HTTP status 413, `request/size`", value=_size(MAX_BODY)),
        Limit(
            "streams",
            "HTTP status 503, `operator/busy`; one with a token takes the place of the oldest "
            "without",
            value=f"{MAX_STREAMS}",
        ),
        Limit("… with tokens of one subject", "HTTP status 503, `operator/busy`",
              value=f"{MAX_STREAMS_PER_SUBJECT}"),
        Limit("lines about refused tokens in the audit log", "counted in a later line",
              value=f"{REFUSED_A_MINUTE} a minute"),
        Limit("a file of the audit log", f"put aside; {KEPT_FILES} of those are kept",
              value=_size(MAX_AUDIT_BYTES)),
    ),
    "MQTT": (
        Limit("a command", "refused, and not read", "message/too-large",
              value=_size(MAX_CLIENT_BYTES)),
        Limit("what a broker may deliver", "it delivers it not", value=_size(MAX_PACKET_BYTES)),
        Limit("commands of all laboratories together", "refused", "rate/limited",
              value=f"{COMMANDS_A_SECOND:g} a second, {COMMANDS_BURST:g} at once"),
        Limit("commands that are known again", "the oldest are carried out again",
              value=f"{KEPT_ANSWERS}"),
        Limit("episodes that one command opens", "refused", INVALID, value=f"{MAX_OPENED}"),
        Limit("watches", "refused", "rate/limited", value=f"{MAX_WATCHES}"),
        Limit("time for which one holds", "refused", INVALID, value=f"{MAX_WATCH_SECONDS:,.0f} s"),
        Limit("messages that wait for the broker", "the oldest are dropped and counted",
              value=f"{MAX_MESSAGES:,}"),
        Limit("steps that wait for it", "the oldest are dropped and counted",
              value=f"{MAX_STEPS:,}"),
    ),
}  # fmt: skip


def shown_value(limit: Limit) -> str:
    """The limit as people read it: a constant, or the default of its setting."""
    if not limit.setting:
        return limit.value
    default = ServerSettings.model_fields[limit.setting].default
    number = f"{default:,}" if isinstance(default, int) else f"{default:g}"
    return f"{number} {limit.unit}".rstrip()


def limits_page() -> str:
    """The tables of docs/limits.md, in Markdown."""
    sections = []
    for title, limits in LIMITS.items():
        rows = [
            f"| {limit.what} | {shown_value(limit)} | {_flag(limit)} | {limit.beyond} "
            f"| {f'`{limit.code}`' if limit.code else ''} |"
            for limit in limits
        ]
        head = "| what | limit | setting | beyond it | code |\n| --- | --- | --- | --- | --- |"
        sections.append("\n".join([f"## {title}\n", head, *rows]))
    return "\n\n".join(sections) + "\n"


def _flag(limit: Limit) -> str:
    return f"`--{limit.setting.replace('_', '-')}`" if limit.setting else ""
