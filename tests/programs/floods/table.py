"""All floods: what each does, what it attacks, and what the server may lose by it."""

from __future__ import annotations

import ipaddress
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Protocol

from robotouille.web import shared_site
from robotouille.web.site import BUNDLE
from tests.programs.floods.audience import AudienceFlood
from tests.programs.floods.broker import BrokerFlood
from tests.programs.floods.client import message
from tests.programs.floods.closings import ClosingFlood
from tests.programs.floods.delays import DelayFlood
from tests.programs.floods.honest_game import HELLO
from tests.programs.floods.mcp import McpFlood, McpFloodKind, McpLines
from tests.programs.floods.openings import OpeningFlood
from tests.programs.floods.pages import PageFlood
from tests.programs.floods.records import Kind, RecordFlood
from tests.programs.floods.rematches import RematchFlood
from tests.programs.floods.repeated import Repeated, Silence, get, handshake, watching
from tests.programs.floods.resumes import ResumeStorm
from tests.programs.floods.texts import TextFlood, TextFloodKind
from tests.support.fuzzing.wire import BINARY, CONTINUATION, PING, PONG, TEXT, frame

__all__ = ["FLOODS", "Flood", "Target", "remote_address"]

MAX_GAP = 0.150
MAX_CALL = 0.400
"""Longest call of an agent. Without a flood, it takes up to 50 ms."""
MAX_GROWTH = 32 * 1024 * 1024
OVERVIEW = "/api/overview?limit=200&search=" + "+".join("multi_agent")
UNKNOWN = "AAAAA-AAAAA"
MIXED_ROOMS = (
    ("asynchronous/10", "both"),
    ("asynchronous/10", "both"),
    ("training/01_synchronous", "both"),
)


class Target(NamedTuple):
    """The port for a flood, and the code of the honest game or the tokens for robotouille-mcp."""

    port: int
    code: str


class Attackers(Protocol):
    """Attackers that are ready."""

    def run(self) -> None:
        """Flood the server until the process is killed."""


class Nobody:
    """No attackers."""

    def run(self) -> None:
        time.sleep(3600)


@dataclass(frozen=True, slots=True)
class Flood:
    """A flood from a process of its own, and its limits.

    Attributes:
        description: One line about the attackers.
        prepare: Returns the attackers when they are ready to begin.
        at: Target of the attackers: the server, its operator port, another node of its cluster on
            a real NATS, or `robotouille-mcp`, whose memory and calls are then measured.
        tls: True if the server uses TLS with a slow RSA key.
        remote: True if they connect to another address of this machine, so that the server limits
            them as strangers.
        elsewhere: True if new clients are remote, too, and have a token.
        broker: The kind of an MQTT broker that floods the server during the whole measurement.
        tokens: The number of tokens for `robotouille-mcp`.
        rooms: The number of other episodes on the server.
        descriptors: The soft limit of the server's descriptors; 0 for the hard limit.
        max_growth: The limit for the growth of memory in bytes.
        max_gap: The limit for the longest gap or call in seconds.
    """

    description: str
    prepare: Callable[[Target], Attackers] = lambda _: Nobody()
    at: Literal["server", "operator", "node", "mcp"] = "server"
    tls: bool = False
    remote: bool = False
    elsewhere: bool = False
    broker: BrokerFlood | None = None
    tokens: int = 1
    rooms: int = 0
    descriptors: int = 0
    max_growth: int = MAX_GROWTH
    max_gap: float = MAX_GAP


def remote_address() -> str:
    """Return an address of this machine that others can reach, or an empty string."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route, suppress(OSError):
        route.connect(("192.0.2.1", 9))  # This sends nothing.
        own = str(route.getsockname()[0])
        return "" if ipaddress.ip_address(own).is_loopback else own
    return ""


def _requests(what: str, request: dict[str, object], connections: int) -> Flood:
    """Return a flood of one message at another node, after hello."""
    return Flood(
        f"{what}, from {connections} connections",
        lambda t: Repeated(t.port, handshake(HELLO), message(**request), connections=connections),
        at="node",
    )


def _resyncs(what: str, *, reads: bool = True) -> Flood:
    return Flood(
        what,
        lambda t: Repeated(
            t.port, handshake(*watching(t.code)), message(type="resync"), reads=reads
        ),
    )


def _in_and_out(port: int, code: str, connections: int) -> Repeated:
    join = message(type="join", episode=code, role="spectator", view="both")
    piece = join + message(type="leave")
    return Repeated(port, handshake(HELLO), piece, connections=connections)


def _fragments() -> bytes:
    inner = frame(b"", CONTINUATION, fin=False) * 1020
    return frame(b"", TEXT, fin=False) + inner + frame(b"{}", CONTINUATION)


def _unknown_fields() -> bytes:
    fields = ",".join(f'"{i:x}":0' for i in range(7000))
    return frame(f'{{"type":"hello",{fields}}}'.encode()[:65_000] + b"}", TEXT)


def _page(what: str, page: str) -> Flood:
    return Flood(
        f"{what}, from 60 connections", lambda t: Repeated(t.port, get(page), connections=60)
    )


def _records(what: str, kind: Kind, connections: int = 30) -> Flood:
    return Flood(
        f"{what}, from {connections} connections",
        lambda t: RecordFlood("127.0.0.1", t.port, connections, kind),
        tls=True,
    )


def _watched(what: str, players: str, *rooms: tuple[str, str], resyncs: bool = False) -> Flood:
    return Flood(what, lambda t: AudienceFlood(t.port, rooms, players=players, resyncs=resyncs))


def _texts(what: str, kind: TextFloodKind, games: int) -> Flood:
    return Flood(what, lambda t: TextFlood(t.port, kind, games))


def _mcp(what: str, kind: McpFloodKind, connections: int, *, tokens: int = 1) -> Flood:
    return Flood(
        f"{what}, from {connections} connections",
        lambda t: McpLines(t.port, kind, t.code, connections),
        at="mcp",
        tokens=tokens,
    )


def _join(code: str) -> dict[str, object]:
    return {"type": "join", "episode": code}


FLOODS = {
    "none": Flood("nothing"),
    "pings": Flood(
        "empty pings before hello", lambda t: Repeated(t.port, handshake(), frame(b"", PING))
    ),
    "unread-pings": Flood(
        "pings whose pongs are not read",
        lambda t: Repeated(t.port, handshake(), frame(b"x" * 125, PING), reads=False),
    ),
    "pongs": Flood("empty pongs", lambda t: Repeated(t.port, handshake(HELLO), frame(b"", PONG))),
    "fragments": Flood(
        "messages of 1,022 fragments", lambda t: Repeated(t.port, handshake(HELLO), _fragments())
    ),
    "silence": Flood(
        "1,200 silent connections", lambda t: Silence(t.port, 1_200), descriptors=1_024
    ),
    "resyncs": _resyncs("requests for snapshots"),
    "unread-resyncs": _resyncs("requests for snapshots that are not read", reads=False),
    "joins": Flood("repeated joining and leaving", lambda t: _in_and_out(t.port, t.code, 4)),
    "lists": Flood(
        "lists of 300 episodes",
        lambda t: Repeated(t.port, handshake(HELLO), message(type="list")),
        rooms=300,
    ),
    "cluster-lists": replace(
        _requests("lists of 100 episodes from another node", {"type": "list"}, 60), rooms=100
    ),
    "cluster-codes": _requests("wrong codes at another node", _join(UNKNOWN), 60),
    "cluster-rematches": _requests(
        "rematches of unknown games at another node", {"type": "create", "rematch": UNKNOWN}, 60
    ),
    "cluster-closings": _requests(
        "closing of unknown games at another node", {"type": "close", "episode": UNKNOWN}, 60
    ),
    "cluster-openings": Flood(
        "games that 8 hosts at another node open and close at once",
        lambda t: OpeningFlood(t.port, 8),
        at="node",
    ),
    "cluster-watching": Flood(
        "watching and leaving a game from another node, from 60 connections",
        lambda t: _in_and_out(t.port, t.code, 60),
        at="node",
    ),
    "fields": Flood(
        "9,900 unknown fields before hello",
        lambda t: Repeated(t.port, handshake(), _unknown_fields()),
    ),
    "codes": Flood(
        "wrong codes",
        lambda t: Repeated(t.port, handshake(HELLO, elsewhere=True), message(**_join(UNKNOWN))),
        elsewhere=True,
    ),
    "places": Flood(
        "600 silent connections from one address",
        lambda t: Silence(t.port, 600, handshake(elsewhere=True)),
        elsewhere=True,
        descriptors=1_024,
    ),
    "arrays": Flood(
        "nested lists in MessagePack",
        lambda t: Repeated(
            t.port,
            handshake(subprotocol="robotouille.v1.msgpack"),
            frame(b"\xdc\x00\x40" * 1000, BINARY),
        ),
    ),
    "crowd": Flood(
        "joining and leaving, from 60 connections", lambda t: _in_and_out(t.port, t.code, 60)
    ),
    "resets": Flood(
        "handshakes that are reset, from 60 connections",
        lambda t: Repeated(t.port, handshake(), connections=60, ends="answered"),
    ),
    "vanishing": Flood(
        "hello of clients that vanish, from 60 connections",
        lambda t: Repeated(t.port, handshake(HELLO), connections=60, ends="answered"),
    ),
    "storm": Flood(
        "clients that join and leave within 40 ms, from 250 connections",
        lambda t: Repeated(t.port, handshake(*watching(t.code)), connections=250, ends="hurried"),
    ),
    "resume-storm": Flood(
        "spectators that resume and vanish in bursts, from 200 connections",
        lambda t: ResumeStorm(t.port, t.code, 200),
    ),
    "rematches": Flood(
        "games that players end at once, and their rematches, from 8 connections",
        lambda t: RematchFlood(t.port, 8),
    ),
    "openings": Flood(
        "games that 4 hosts open and close at once", lambda t: OpeningFlood(t.port, 4)
    ),
    "endings": Flood(
        "four rematches with long recordings that end at once",
        lambda t: ClosingFlood(t.port, 4),
    ),
    "delayed": Flood(
        "actions of players of delayed seats, from 16 connections",
        lambda t: DelayFlood(t.port, 16),
    ),
    "declared": _texts("declared thinking times of a day, in 2 games", "declared", 2),
    "rematch-sight": _texts("texts of limited sight in the rematches of one game", "rematches", 1),
    "fast-sight": _texts(
        "actions and limited sight at 60 steps a second, in the rematches of one game", "fast", 1
    ),
    "idle-sight": _texts(
        "limited sight at 60 steps a second, in 12 games in which nobody acts", "idle", 12
    ),
    "metrics": _page("reads of the metrics", "/metrics"),
    "operator": Flood(
        "searches of the operator page, from 60 connections",
        lambda t: Repeated(t.port, get(OVERVIEW), get(OVERVIEW), connections=60),
        at="operator",
        rooms=300,
        # A burst of requests allows 23 answers of 200 rows at the same time, each of 1.8 MiB. The
        # memory does not grow after the first burst.
        max_growth=48 * 1024 * 1024,
    ),
    "page": _page("loads of the browser client", f"/play/{shared_site().version}/{BUNDLE}"),
    "loads": Flood(
        "1,000 loads of the browser client a second, from one address",
        lambda t: PageFlood(t.port, 1_000, ("/play", f"/play/{shared_site().version}/{BUNDLE}")),
        # It has up to 800 connections at once, and each takes some 40 KiB.
        max_growth=2 * MAX_GROWTH,
    ),
    "records": _records("TLS records of one byte", "bytes"),
    "keys": _records("changes of keys", "keys"),
    "handshakes": _records("TLS handshakes", "handshakes"),
    "groups": _records("TLS handshakes with slow groups", "groups"),
    "displaced": Flood(
        "TLS handshakes from one remote address, above its limit",
        lambda t: RecordFlood(remote_address(), t.port, 320, "displaced"),
        tls=True,
        remote=True,
    ),
    "broker": Flood("packets of an MQTT broker in shifted TLS records", broker="packets"),
    "broker-keys": Flood("changes of keys by an MQTT broker", broker="keys"),
    "mcp-silence": Flood(
        "700 silent connections to robotouille-mcp",
        lambda t: Silence(t.port, 700),
        at="mcp",
        descriptors=1_024,
        max_gap=MAX_CALL,
    ),
    "mcp-abandoned": Flood(
        "calls of robotouille-mcp whose client closes the connection",
        lambda t: McpFlood(t.port, "abandoned"),
        at="mcp",
        max_gap=MAX_CALL,
    ),
    "mcp-values": Flood(
        "requests to robotouille-mcp with 20,000 values",
        lambda t: McpFlood(t.port, "values"),
        at="mcp",
        max_gap=MAX_CALL / 2,
    ),
    "mcp-calls": _mcp("calls of robotouille-mcp with one token", "calls", 64),
    "mcp-tokens": _mcp("calls of robotouille-mcp with four tokens", "tokens", 200, tokens=4),
    "mcp-streams": _mcp(
        "event streams of robotouille-mcp that are opened and closed", "streams", 64
    ),
    "mcp-strangers": _mcp(
        "requests to robotouille-mcp with made-up tokens and sessions", "strangers", 400
    ),
    "mcp-newcomers": _mcp("such requests, each over a new connection", "newcomers", 64),
    "acts": Flood(
        "actions of spectators, from 60 connections",
        lambda t: Repeated(
            t.port,
            handshake(*watching(t.code)),
            message(type="act", seq=1, action="x" * 300),
            connections=60,
        ),
    ),
    "tokens": Flood(
        "hello with an invalid token",
        lambda t: Repeated(t.port, handshake(), message(**{**HELLO, "resume": "x" * 800})),
    ),
    "watched": _watched(
        "actions of a player with 200 spectators", "act", ("asynchronous/10", "both")
    ),
    "watched-rooms": _watched(
        "actions of players in 4 rooms with 800 spectators",
        "act",
        *(("synchronous/01", "state"), ("asynchronous/10", "both")) * 2,
    ),
    "spectator-resyncs": _watched(
        "requests for snapshots from 200 spectators",
        "act",
        ("synchronous/01", "state"),
        resyncs=True,
    ),
    "chat": _watched("chat of 4 players with 200 spectators", "say", ("multi_agent/10@4", "state")),
    "mixed": Flood(
        "actions, chat, requests for snapshots and rematches of 4 players with 800 spectators",
        lambda t: AudienceFlood(t.port, MIXED_ROOMS, players="mixed", rematches=True),
    ),
}
