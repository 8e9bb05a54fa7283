"""Tables of all limits for docs/limits.md, read from the settings and constants of the code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from robotouille.domain.json_files import MAX_NESTING
from robotouille.domain.pictures import MAX_OUTLINES, MAX_PICTURE_BYTES, MAX_SHAPES, MAX_SIDE
from robotouille.episode import quota, rules, submissions
from robotouille.episode.clocks import MAX_CATCH_UP, MAX_LATE_AT_ONCE, MAX_STEPS_AT_ONCE
from robotouille.protocol import codec, messages
from robotouille.protocol.messages import values
from robotouille.replay import container, payloads
from robotouille.web import recording_data, recording_page
from robotouille.web.bounded_requests import MAX_HEAD_BYTES, MAX_HEAD_LINES
from robotouille.world.grounding import ground_objects
from robotouille.world.text import MAX_SENTENCE
from robotouille_server.auth import revocation
from robotouille_server.auth.visitors import (
    PROBATION_FACTOR,
    SITE_FACTOR,
    WRONG_CODES_A_MINUTE,
)
from robotouille_server.mqtt import stream
from robotouille_server.mqtt.client import (
    COMMANDS_READ_A_SECOND,
    MAX_CONTROL_BYTES,
    MAX_UNSENT_PACKETS,
    MAX_WAITING_COMMANDS,
    PACKETS_A_SECOND,
)
from robotouille_server.mqtt.commands import KEPT_REPLIES
from robotouille_server.mqtt.limits import (
    BRIEF_A_SECOND,
    BRIEF_BURST,
    COMMANDS_A_SECOND,
    COMMANDS_BURST,
)
from robotouille_server.mqtt.messages import (
    MAX_PACKET_BYTES,
    MAX_PROPERTY_BYTES,
    MAX_WATCH_SECONDS,
)
from robotouille_server.operator import connections, event_streams, load
from robotouille_server.operator.guard import MAX_BODY, REFUSED_A_MINUTE
from robotouille_server.operator.models import MAX_OPENED
from robotouille_server.operator.recordings import replay_pages, store
from robotouille_server.operator.recordings.archive import MAX_ARCHIVED
from robotouille_server.operator.service import MAX_NOTED_NAME
from robotouille_server.rooms import rematches
from robotouille_server.rooms.episode_driver import TICKS_WHILE_WRITING
from robotouille_server.rooms.lobby import LINGER_SECONDS, MAX_ENDED
from robotouille_server.rooms.participants.seat_limits import (
    CHAT_LINES,
    CHAT_LINES_AT_ONCE,
    SEAT_CHANGES,
    SEAT_CHANGES_AT_ONCE,
    SPECTATOR_SHARE,
)
from robotouille_server.rooms.publishing.audience import DELIVERY_SECONDS, MAX_STEP_BYTES, MAX_STEPS
from robotouille_server.rooms.publishing.broadcaster import MAX_SPECTATOR_NAMES
from robotouille_server.rooms.publishing.publisher import ROSTER_SECONDS, WAITING_SECONDS
from robotouille_server.rooms.recording import archive, folder_lister
from robotouille_server.rooms.recording.journal import (
    MAX_RECORDING_BYTES,
    MAX_RECORDING_CHANGES,
    MAX_RECORDING_FRAMES,
    MAX_RECORDING_NOTES,
    MAX_RECORDING_REASONS,
    MAX_RECORDING_TEXTS,
)
from robotouille_server.rooms.recording.write_ahead import MAX_UNWRITTEN
from robotouille_server.rooms.room_factory import CODE_LENGTH, MAX_CODES
from robotouille_server.runtime.budgets import (
    COSTS,
    MAX_GREETINGS,
    MAX_HELLO_BYTES,
    MAX_REFUSED,
    MISTAKE,
)
from robotouille_server.runtime.logs import KEPT_FILES, MAX_AUDIT_BYTES
from robotouille_server.runtime.process_limits import RESERVED
from robotouille_server.runtime.settings import MAX_CONFIG_BYTES, ServerSettings
from robotouille_server.runtime.task_folder import MAX_FILES
from robotouille_server.transport import admission, connection, loop_budget, peer, tls_records

__all__ = ["LIMITS", "Limit", "limit_tables", "message_costs", "shown_value"]


@dataclass(frozen=True, slots=True)
class Limit:
    """One row: the limited quantity, its maximum, the effect of exceeding it, and the error code.

    `value` is a number with its unit, or the name of a setting in braces: `{hello_seconds} s`.
    """

    what: str
    value: str
    exceeded: str
    code: str = ""

    @property
    def setting(self) -> str:
        """Name of the setting that changes the limit, or an empty string."""
        return self.value[1:].partition("}")[0] if self.value.startswith("{") else ""


def message_costs() -> str:
    """Return the messages that count as several, such as `create` 10, with the highest first."""
    costs = sorted(set(COSTS.values()), reverse=True)
    named = {cost: [_type(model) for model, own in COSTS.items() if own == cost] for cost in costs}
    return ", ".join(f"{' and '.join(names)} {cost:g}" for cost, names in named.items())


def _type(model: type[messages.Message]) -> str:
    return f"`{model.model_fields['type'].default}`"


def _size(count: int) -> str:
    """Return a number of bytes in the largest unit that divides it."""
    for bytes_each, unit in ((1024**2, "MiB"), (1024, "KiB")):
        if count % bytes_each == 0:
            return f"{count // bytes_each:,} {unit}"
    return f"{count:,} B"


def _maximum(model: type[BaseModel], name: str) -> str:
    """Return the largest value, length or number of entries of a message's field."""
    schema: dict[str, Any] = model.model_json_schema()["properties"][name]
    parts = [schema, *schema.get("anyOf", [])]
    keys = ("maxLength", "maxItems", "maxProperties", "maximum")
    return f"{next(part[key] for part in parts for key in keys if key in part):,}"


def _range(name: str) -> tuple[float, float]:
    """Return the smallest and largest value of a field of `create`."""
    number = messages.Create.model_json_schema()["properties"][name]["anyOf"][0]
    return number["minimum"], number["maximum"]


LOWEST_RATE, HIGHEST_RATE = _range("step_rate")
SHORTEST, LONGEST = _range("open_for")
INVALID = "message/invalid-field"
REFUSED = "The message is refused."
CREATE = "`create` is refused."
REFUSED_TOO_LARGE = (
    "The message is refused. At twice the size, the connection is closed with status 1009."
)
CUT = "The server closes the connection."
MQTT_CUT = "The server closes the connection and connects again later."
DROPPED = "The command is dropped."
NO_START = "The server does not start."
NOT_SHOWN = "The client learns only that the episode ended."

LIMITS: dict[str, tuple[Limit, ...]] = {
    "Messages": (
        Limit("Size of a client's message", _size(codec.MAX_CLIENT_BYTES),
              REFUSED_TOO_LARGE, "message/too-large"),
        Limit("Size of a message before `welcome`", _size(MAX_HELLO_BYTES),
              REFUSED_TOO_LARGE, "message/too-large"),
        Limit("Values in a server's message", f"{codec.MAX_SERVER_ITEMS:,}",
              "Clients close the connection.", "message/malformed"),
        Limit("Characters of a name, chat message and notice in a server's message",
              ", ".join((_maximum(messages.Said, "name"), _maximum(messages.Said, "text"),
                         _maximum(messages.Notice, "text"))),
              "Clients close the connection.", INVALID),
        Limit("Characters of a reason or explanation in a server's message, and its reasons",
              f"{values.MAX_REASON:,}, {values.MAX_REASONS}", "Clients cut them."),
        Limit("Facts about objects that play has created", f"{ground_objects.MAX_GROWTH:,}",
              "The episode ends: `aborted`."),
        Limit("Size of a server's message", _size(codec.MAX_SERVER_BYTES),
              "The client library closes the connection."),
        Limit("Nesting of a message", f"{codec.MAX_DEPTH} levels in MessagePack, {MAX_NESTING} in "
              "JSON", "The message is refused (a nested `act` with `message/invalid-field`).",
              "message/malformed"),
        Limit("Values in a message", f"{codec.MAX_ITEMS}", REFUSED, "message/malformed"),
        Limit("Fields of an object in a message", f"{codec.MAX_FIELDS}", REFUSED,
              "message/malformed"),
        Limit("Messages per second and connection", "{messages_per_second}",
              "The message is dropped. Bursts may be twice as large.", "rate/limited"),
        Limit("Message that is answered by an error, or action that does not exist",
              f"counts as {1 + MISTAKE:g} messages",
              "Further messages are dropped as above.", "rate/limited"),
        Limit("Messages of a connection before `welcome`", f"{MAX_GREETINGS}",
              "The server closes the connection.", "rate/limited"),
        Limit("Dropped messages in about a minute", f"{MAX_REFUSED}",
              f"{CUT} Each 8 KiB count as one more message.", "rate/limited"),
        Limit("`create` and `close` per second and connection", "{messages_per_second}",
              "The message is read later."),
        Limit("Cost of a message, if not 1", message_costs(), ""),
        Limit("Cost of each KiB of a message, snapshot or list", "1 message", ""),
        Limit("Control frames and fragments per second and connection",
              f"{connection.FRAMES_A_SECOND:g}, bursts of {connection.FRAMES_BURST:g}",
              "Pings are not answered; a fragmented message ends the connection. Each KiB counts "
              "as one more frame."),
        Limit("Control frames and fragments above that rate", f"{connection.MAX_EXCESS}", CUT),
        Limit("Frames handled between two checks of due steps",
              f"{loop_budget.LOOP_BUDGET:g}, or {loop_budget.TURN_SECONDS * 1000:g} ms of them",
              "The remaining frames wait."),
        Limit("Steps taken for one action, without the wall clock", f"{MAX_STEPS_AT_ONCE}",
              "The remaining steps wait for a turn among the connections."),
        Limit("Late steps taken at once, in real time",
              f"{MAX_LATE_AT_ONCE}, or {TICKS_WHILE_WRITING * MAX_LATE_AT_ONCE} if writing the "
              "last one took time",
              "The remaining steps wait for a turn among the connections. After "
              f"{MAX_CATCH_UP} late steps, the others are skipped."),
        Limit("Frames of one connection handled before the others",
              f"{connection.FRAMES_AT_A_TIME}, or "
              f"{connection.SECONDS_AT_A_TIME * 1000:g} ms of them", "The remaining frames wait."),
        Limit("Text of a note", f"{_maximum(messages.Note, 'text')} characters", REFUSED, INVALID),
        Limit("Chat message", f"{_maximum(messages.Say, 'text')} characters", REFUSED, INVALID),
        Limit("Name", f"{_maximum(messages.Hello, 'name')} characters",
              "The message is refused, as is a name without visible characters.", INVALID),
        Limit("Token", f"{_maximum(messages.Hello, 'token')} characters", REFUSED, INVALID),
        Limit("Action written as text", f"{MAX_SENTENCE:,} characters", REFUSED, INVALID),
        Limit("Reasoning of an action", f"{_maximum(messages.Act, 'reasoning')} characters",
              REFUSED, INVALID),
        Limit("Actions of a seat that wait for its `delay_ms`",
              f"{submissions.MAX_HELD_REQUESTS}", REFUSED, "rate/limited"),
        Limit("Declared thinking time of an action", f"{_maximum(messages.Act, 'think_ms')} ms",
              REFUSED, INVALID),
        Limit("Digests in `known`", _maximum(messages.Join, "known"), REFUSED, INVALID),
        Limit("Seats in a `join`", _maximum(messages.Join, "seats"), REFUSED, INVALID),
    ),
    "Connections": (
        Limit("Connections", "{max_connections}", "The handshake returns HTTP status 503."),
        Limit("Connections per address without a token; an IPv6 /64 network counts as one "
              "address, this machine is not limited", "{max_connections_per_address}",
              "`hello` is answered with `bye` and status 1013.", "rate/connections"),
        Limit("Connections per IPv6 /48 network without a token",
              f"{SITE_FACTOR} times the limit per address",
              "`hello` is answered with `bye` and status 1013.", "rate/connections"),
        Limit("Connections per token subject", "{max_connections_per_address}",
              "`hello` is answered with `bye` and status 1013.", "rate/connections"),
        Limit("Connections per address that have sent no byte",
              f"{admission.SILENT_FACTOR} times the limit per address",
              "The newest connection replaces the oldest."),
        Limit("Connections per address that have sent data but no complete request",
              "{max_connections_per_address}",
              "The newest connection replaces the oldest."),
        Limit("Connections per address that have not sent `hello` after their request",
              f"{PROBATION_FACTOR} times the limit per address",
              "The newest connection replaces the oldest: `bye` and status 1013.",
              "rate/connections"),
        Limit("Time until `hello`", "{hello_seconds} s", "`bye` and status 1008.", "auth/silent"),
        Limit("Handshakes that a full server still answers",
              f"{admission.MAX_SURPLUS_CONNECTIONS:,}", CUT),
        Limit("Size of the HTTP request of a handshake", _size(connection.MAX_REQUEST), CUT),
        Limit("Concurrent TLS handshakes", f"{admission.HANDSHAKES_AT_ONCE}",
              "Other handshakes wait. A handshake of more than a second gives up its place."),
        Limit("TLS records of one connection decrypted before the others get a turn",
              f"{tls_records.RECORDS_AT_A_TIME}, or {_size(tls_records.BYTES_AT_A_TIME)} of them",
              "The remaining records wait."),
        Limit("Size of a client's TLS handshake", _size(tls_records.MAX_HANDSHAKE_BYTES), CUT),
        Limit("File descriptors reserved for recordings",
              f"{RESERVED}, or an eighth of the system's limit", "New connections are closed."),
        Limit("Time to answer a ping; the server pings every 20 s", "20 s", CUT),
        Limit("Unsent bytes for a client before it counts as slow", _size(peer.MAX_UNSENT),
              "The server reads nothing from the client and sends no deltas or pongs until the "
              "client has caught up. Then it sends a snapshot."),
        Limit("Time for which a client may be slow", "{stall_seconds} s", CUT),
        Limit("Unsent bytes for a client", _size(peer.MAX_HELD), CUT),
    ),
    "Access": (
        Limit("Wrong ids and codes per address (IPv6: /64 network), or per token subject",
              f"{WRONG_CODES_A_MINUTE} a minute",
              "`join` and rematches are refused; another try is possible every "
              f"{60 / WRONG_CODES_A_MINUTE:g} s.",
              "rate/codes"),
        Limit("Failed joins with a token that is valid for one session",
              f"{revocation.FAILED_JOINS_A_MINUTE} a minute", "`join` is refused.",
              "rate/limited"),
        Limit("Length of a code", f"{CODE_LENGTH} letters",
              f"There are 23^{CODE_LENGTH} codes, about 4 × 10^13."),
        Limit("Validity of a resume token", "{resume_hours} h", "The token is refused.",
              "auth/expired"),
        Limit("Sessions per token of `mint --once`", "1", "The token is refused.", "auth/used"),
        Limit("Revoked tokens", f"{revocation.MAX_ENTRIES:,}",
              "`robotouille-token revoke` fails."),
        Limit("Time for which a revocation is kept after the token's expiry",
              f"{revocation.KEPT_SECONDS / 86400:g} days", "The token has expired.",
              "auth/expired"),
    ),
    "Episodes": (
        Limit("Episodes that have not ended", "{max_episodes}", CREATE, "server/full"),
        Limit("Free space on the recordings' disk below which no episodes are opened",
              "{min_free_space} MiB", CREATE, "server/full"),
        Limit("Open rematches requested by one participant", f"{rematches.MAX_OPEN}", CREATE,
              "rate/episodes"),
        Limit("Open rematches that players have requested of a game and of its rematches",
              f"{rematches.MAX_OPEN_OF_GAME}",
              f"{CREATE} After a restart, each game and each open rematch counts for itself.",
              "rate/episodes"),
        Limit("Rematches that players request of a game and of its rematches",
              f"{rematches.REMATCHES_A_MINUTE:g} a minute, bursts of "
              f"{rematches.REMATCHES_AT_ONCE:g}",
              f"`create` is refused. Each {_size(rematches.RECORDED_BYTES)} of a rematch's "
              "recording count as one more rematch.",
              "rate/episodes"),
        Limit("Rematches that players request of all games that are read from recordings",
              f"{rematches.ARCHIVED_A_MINUTE:g} a minute, bursts of "
              f"{rematches.ARCHIVED_AT_ONCE:g}",
              "As above. After a restart, all earlier games are read from recordings.",
              "rate/episodes"),
        Limit("Open episodes per token subject", "{max_episodes_per_owner}", CREATE,
              "rate/episodes"),
        Limit("Episodes per token subject kept open by `open_for`", "{max_reserved_per_owner}",
              CREATE, "rate/episodes"),
        Limit("`open_for`", f"{SHORTEST / 60:g} minute to {LONGEST / 86400:g} days", REFUSED,
              INVALID),
        Limit("Labels of an episode", _maximum(messages.Create, "labels"), REFUSED, INVALID),
        Limit("Phrases of an episode", f"{rules.MAX_PHRASES}", REFUSED, INVALID),
        Limit("Delay of a seat's actions", f"{rules.MAX_DELAY_MS / 1000:g} s", REFUSED, INVALID),
        Limit("Seats", _maximum(messages.Create, "seats"), REFUSED, INVALID),
        Limit("Default step limit", "{max_steps}", "The episode ends with `step_limit`."),
        Limit("`max_steps`", _maximum(messages.Create, "max_steps"), REFUSED, INVALID),
        Limit("Steps per second in real time", f"{LOWEST_RATE:g} to {HIGHEST_RATE:g}", REFUSED,
              INVALID),
        Limit("Default time for a move, with several seats", f"{rules.MOVE_BUDGET:g} s",
              "The step is taken without the seat (`--move-budget`; 0 removes the limit)."),
        Limit("Time a step waits before the server reports which seats it waits for",
              f"{WAITING_SECONDS:g} s", "The server sends `roster` with `waits_for`."),
        Limit("Time for which a disconnected player's seat is kept", "{grace} s",
              "The `absence` rule decides."),
        Limit("Time for players to come back after a restart", "{recovery_seconds} s",
              "The `absence` rule decides."),
        Limit("Time for episodes to end after SIGTERM", "{drain_seconds} s",
              "The episodes are handed over to the next process."),
        Limit("Time for which an ended episode stays available",
              f"{LINGER_SECONDS:g} s, or `grace` if that is longer; 0 s if nobody has joined it",
              "`join` is refused.", "episode/unknown"),
        Limit("Ended episodes that stay available", f"{MAX_ENDED}, and all with connected clients",
              "The oldest without connected clients are closed.", "episode/unknown"),
        Limit("Spectators per episode", "{max_spectators}", "`join` and resuming are refused.",
              "episode/full"),
        Limit("Absent spectators per episode, who may come back for `grace`", "{max_spectators}",
              "The one who has been away longest must join again.", "auth/expired"),
        Limit("Spectator names in a roster", f"{MAX_SPECTATOR_NAMES}",
              "Further spectators are only counted."),
        Limit("Interval of rosters for spectator changes", f"{ROSTER_SECONDS:g} s",
              "Changes are sent together."),
        Limit("Joins, returns and `ready` changes per seat",
              f"{SEAT_CHANGES} a minute, bursts of {SEAT_CHANGES_AT_ONCE}",
              "`join` and `ready` are refused; a returning client gets `bye` with `retry`.",
              "rate/seats"),
        Limit("Chat lines of a seat", f"{CHAT_LINES:g} a second, bursts of {CHAT_LINES_AT_ONCE:g}",
              "`say` is refused.", "rate/chat"),
        Limit("Chat lines of all spectators together",
              f"{SPECTATOR_SHARE * CHAT_LINES:g} a second, bursts of "
              f"{SPECTATOR_SHARE * CHAT_LINES_AT_ONCE:g}", "`say` is refused.", "rate/chat"),
        Limit("Interval of deliveries to spectators", f"{DELIVERY_SECONDS:g} s",
              "Messages are sent together; only the last text view is sent."),
        Limit("Interval of text views for players in real time", f"{DELIVERY_SECONDS:g} s",
              "Only the last text view is sent."),
        Limit("Deltas in a delivery to spectators", f"{MAX_STEPS}, {_size(MAX_STEP_BYTES)}",
              "A snapshot replaces them."),
        Limit("Recorded text per seat: reasoning, rejected actions, chat, notes",
              _size(quota.SEAT_QUOTA_BYTES), "Reasoning and chat are refused. Rejected actions "
              "are answered but not recorded.", "rate/words"),
        Limit("Part of that quota reserved for a new player in the seat",
              f"{_size(quota.NEWCOMER_BYTES)}, up to {_size(quota.MAX_SEAT_BYTES)} per seat",
              "As above.", "rate/words"),
        Limit("Recorded chat of all spectators", _size(quota.MAX_AUDIENCE_BYTES),
              "Chat is refused.", "rate/words"),
        Limit("Bytes that wait while a recording cannot be written", _size(MAX_UNWRITTEN),
              "Returning clients get `bye` with `retry`.", "server/recording"),
        Limit("Ended episodes remembered for a rematch", f"{rematches.MAX_FINISHED}",
              "The oldest are forgotten.", "episode/unknown"),
        Limit("Codes remembered of episodes that closed unused", f"{MAX_CODES:,}",
              "The oldest are forgotten.", "episode/unknown"),
        Limit("File of settings, certificate and key for TLS, each", _size(MAX_CONFIG_BYTES),
              NO_START),
        Limit("Files in the `tasks` folder", f"{MAX_FILES:,}", NO_START),
        Limit("Picture in the `tasks` folder", f"{_size(MAX_PICTURE_BYTES)}, {MAX_SIDE:,} pixels "
              f"per side, {MAX_SHAPES:,} SVG elements, {_size(MAX_OUTLINES)} of outlines",
              NO_START),
    ),
    "Recordings": (
        Limit("Recording being written, uncompressed", _size(MAX_RECORDING_BYTES),
              "The episode ends with `aborted`."),
        Limit("Frames of a recording being written", f"{MAX_RECORDING_FRAMES:,}",
              "The episode ends with `aborted`."),
        Limit("Frames of a recording to read", f"{container.MAX_FRAMES:,}",
              "The recording is not read."),
        Limit("Notes of a recording being written", f"{MAX_RECORDING_NOTES:,}",
              "The episode ends with `aborted`."),
        Limit("Notes of a recording to read", f"{container.MAX_NOTES:,}",
              "The recording is not read."),
        Limit("Reasons for rejections in a recording being written",
              f"{MAX_RECORDING_REASONS:,}", "The episode ends with `aborted`."),
        Limit("Reasons for rejections in a recording to read", f"{container.MAX_REASONS:,}",
              "The recording is not read."),
        Limit("Texts of notes in a recording being written; a text that is not ASCII counts four "
              "bytes for each character", _size(MAX_RECORDING_TEXTS),
              "The episode ends with `aborted`."),
        Limit("Texts of notes in a recording to read", _size(container.MAX_TEXTS),
              "The recording is not read."),
        Limit("Changes of facts in a recording being written", f"{MAX_RECORDING_CHANGES:,}",
              "The episode ends with `aborted`."),
        Limit("Changes of facts in a recording to read", f"{container.MAX_CHANGES:,}",
              "The recording is not read."),
        Limit("Recording to read, uncompressed", _size(container.MAX_FILE),
              "The recording is not read."),
        Limit("Frame", _size(container.MAX_FRAME), "The frame is neither written nor read."),
        Limit("Values in a frame", f"{payloads.MAX_ENTRIES:,}",
              "The frame is neither written nor read."),
        Limit("Data of a page that shows recordings, in memory",
              _size(recording_page.MAX_DATA), "The page is not written."),
        Limit("Steps of an ended episode shown to a returning client", f"{archive.MAX_STEPS:,}",
              NOT_SHOWN, "auth/expired"),
        Limit("Uncompressed bytes of such a recording", _size(archive.MAX_BYTES), NOT_SHOWN,
              "auth/expired"),
        Limit("Concurrent searches for ended episodes", f"{archive.MAX_SOUGHT}",
              "The client must join again.", "auth/expired"),
        Limit("Interval of reading the recordings folder for returning clients",
              f"{folder_lister.LIST_SECONDS:g} s", "The search waits."),
    ),
    "Operator port": (
        Limit("Connections", f"{connections.MAX_CONNECTIONS}",
              "A new connection replaces one without a token: silent ones first, then idle ones."),
        Limit("Connections per address (IPv6: /64 network) without a token; this machine is not "
              "limited", f"{connections.MAX_PER_ADDRESS}",
              "A new connection replaces one of the same address."),
        Limit("Connections per token subject", f"{connections.MAX_PER_SUBJECT}",
              "HTTP status 503, `operator/busy`."),
        Limit("Event streams", f"{event_streams.MAX_STREAMS}", "HTTP status 503, `operator/busy`. "
              "A stream with a token replaces the oldest without."),
        Limit("Event streams per token subject", f"{event_streams.MAX_STREAMS_PER_SUBJECT}",
              "HTTP status 503, `operator/busy`."),
        Limit("Requests per token subject; all callers without a token share one limit",
              f"{load.REQUESTS_A_SECOND:g} a second, bursts of {load.REQUESTS_BURST:g}",
              "HTTP status 429, `operator/rate`, with `Retry-After`."),
        Limit("Rows of the overview that count as one more request", f"{load.ROWS_A_TURN}",
              "See requests."),
        Limit("Turns of the event loop for all operators; a request takes one, and one more for "
              f"each {load.ROWS_A_TURN} rows and {load.ROOMS_A_TURN} episodes of the overview",
              f"{load.TURNS_A_SECOND:g} a second, bursts of {load.TURNS_BURST:g}",
              "Answers and event streams become slower."),
        Limit("Refused requests that are answered",
              f"{load.TURNS_A_SECOND:g} a second, bursts of {load.TURNS_BURST:g}",
              "Further refusals are answered later."),
        Limit("Characters of the episode's name in the audit log's line about a refused request",
              f"{MAX_NOTED_NAME}", "The line has the first ones only."),
        Limit("Requests that read recordings at the same time",
              f"{load.HEAVY_JOBS}, and {load.MAX_WAITING_JOBS} that wait",
              "HTTP status 503, `operator/busy`, with `Retry-After`."),
        Limit("Bytes of a download in memory", _size(store.DOWNLOAD_PIECE),
              "The client must read before the server continues."),
        Limit("Recordings in an archive", f"{MAX_ARCHIVED}",
              "HTTP status 400, `request/invalid`."),
        Limit("Episodes that a request opens", f"{MAX_OPENED}",
              "HTTP status 400, `request/invalid`."),
        Limit("Replays that are made at the same time",
              f"{replay_pages.AT_ONCE}, and {replay_pages.MAX_WAITING} that wait",
              "HTTP status 503, `operator/busy`, with `Retry-After`."),
        Limit("Recording of a replay", _size(replay_pages.MAX_REPLAYED),
              "HTTP status 422, `recording/unshown`."),
        Limit("Time to make a replay", f"{replay_pages.SECONDS:g} s",
              "HTTP status 422, `recording/unshown`."),
        Limit("Memory of the process that makes a replay", _size(recording_data.MAX_MEMORY),
              "HTTP status 422, `recording/unshown`."),
        Limit("Recording in a list, to show its outcome", _size(store.MAX_SUMMARISED),
              "The outcome is `unread`."),
        Limit("Time for a TLS handshake, a request head and a request body, each",
              f"{connections.REQUEST_SECONDS:g} s", CUT),
        Limit("Time between two requests", f"{connections.KEEP_ALIVE_SECONDS} s", CUT),
        Limit("Time without progress of an unread response",
              f"{connections.STALL_SECONDS:g} s", CUT),
        Limit("Head of a request, also to `robotouille-mcp`",
              f"{_size(MAX_HEAD_BYTES)}, {MAX_HEAD_LINES} lines",
              "HTTP status 400. A body in chunks (`Transfer-Encoding`) is refused too."),
        Limit("Request body", _size(MAX_BODY), "HTTP status 413, `request/size`."),
        Limit("Refused tokens in the audit log", f"{REFUSED_A_MINUTE} a minute",
              "A later line counts the rest."),
        Limit("Audit log file", _size(MAX_AUDIT_BYTES),
              f"The file is rotated; {KEPT_FILES} old files are kept."),
    ),
    "MQTT": (
        Limit("Size of a command", _size(codec.MAX_CLIENT_BYTES), "The command is refused.",
              "message/too-large"),
        Limit("Command with its topic and properties", _size(MAX_PACKET_BYTES),
              "The broker does not deliver the command. If it does, the server closes the "
              "connection."),
        Limit("Properties of a command", _size(MAX_PROPERTY_BYTES), DROPPED),
        Limit("Commands that the server reads", f"{COMMANDS_READ_A_SECOND:,.0f} a second", DROPPED),
        Limit("Received commands that wait", f"{MAX_WAITING_COMMANDS}", DROPPED + " From half of "
              "this number on, commands without a valid token are dropped."),
        Limit("Packets from the broker, except acknowledgements; each 8 KiB count as a packet",
              f"{PACKETS_A_SECOND:,.0f} a second", MQTT_CUT),
        Limit("Other packets from the broker", _size(MAX_CONTROL_BYTES), MQTT_CUT),
        Limit("Packets that the broker does not read", f"{MAX_UNSENT_PACKETS:,}", MQTT_CUT),
        Limit("Accepted commands of all senders", f"{COMMANDS_A_SECOND:g} a second, bursts of "
              f"{COMMANDS_BURST:g}", "The command is refused.", "rate/limited"),
        Limit("Commands refused with the reason", f"{COMMANDS_A_SECOND:g} a second, bursts of "
              f"{COMMANDS_BURST:g}", "The reason is the limit.", "rate/limited"),
        Limit("Refusals beyond that", f"{BRIEF_A_SECOND:g} a second, bursts of "
              f"{BRIEF_BURST:g}", "The command gets no answer."),
        Limit("Commands recognised when repeated", f"{KEPT_REPLIES}",
              "An older command is carried out again."),
        Limit("Episodes per command", f"{MAX_OPENED}", "The command is refused.", INVALID),
        Limit("Watches", f"{stream.MAX_WATCHES}", "The command is refused.", "rate/limited"),
        Limit("Duration of a watch", f"{MAX_WATCH_SECONDS:,.0f} s", "The command is refused.",
              INVALID),
        Limit("Messages waiting for the broker", f"{stream.MAX_MESSAGES:,}",
              "The oldest are dropped and counted."),
        Limit("Steps waiting for the broker", f"{stream.MAX_STEPS:,}",
              "The oldest are dropped and counted."),
    ),
}  # fmt: skip


def shown_value(limit: Limit) -> str:
    """Return the limit's value, with the default of its setting filled in."""
    if not limit.setting:
        return limit.value
    default = ServerSettings.model_fields[limit.setting].default
    number = f"{default:,}" if isinstance(default, int) else f"{default:g}"
    return limit.value.replace(f"{{{limit.setting}}}", number)


def limit_tables() -> str:
    """Return the Markdown tables."""
    lines: list[str] = []
    for title, limits in LIMITS.items():
        lines += [f"## {title}", ""]
        lines += ["| limit | value | setting | when exceeded | error |", "|" + " --- |" * 5]
        for limit in limits:
            flag = f"`--{limit.setting.replace('_', '-')}`" if limit.setting else ""
            code = f"`{limit.code}`" if limit.code else ""
            lines.append(
                f"| {limit.what} | {shown_value(limit)} | {flag} | {limit.exceeded} | {code} |"
            )
        lines.append("")
    return "\n".join(lines).rstrip()
