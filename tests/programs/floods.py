"""Message floods and their effect on another episode: `python -m tests.programs.floods`.

Each flood comes from a separate process with 4 or 60 connections that send as fast as the server
reads. At the same time, an ordinary real-time episode runs at 20 steps a second. The program prints
the longest gap between two of its deltas (the median of five runs; 50 ms is normal), the growth of
the server's memory, and whether a new client can still join. The exit status is 0 if all results
are within the limits.
"""

from __future__ import annotations

import argparse
import ipaddress
import json
import os
import resource
import select
import socket
import ssl
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median

import psutil
import trustme
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from robotouille.web import shared_site
from robotouille.web.site import BUNDLE
from robotouille_server.auth import Role, Tokens
from robotouille_server.auth.keys import FileKeyring
from tests.programs.audience_flood import AudienceFlood
from tests.programs.broker_flood import BrokerFlood, flooding_broker
from tests.programs.delay_flood import DelayFlood
from tests.programs.honest_game import HELLO, SUBPROTOCOL, HonestGame
from tests.programs.mcp_flood import (
    HonestAgent,
    McpFlood,
    McpFloodKind,
    McpLines,
    mcp_process,
)
from tests.programs.opening_flood import OpeningFlood
from tests.programs.page_flood import PageFlood
from tests.programs.record_flood import Kind, RecordFlood
from tests.programs.rematch_flood import RematchFlood
from tests.programs.resume_storm import ResumeStorm
from tests.programs.text_flood import TextFlood, TextFloodKind
from tests.support.fuzzing.wire import BINARY, CONTINUATION, PING, PONG, TEXT, frame, request
from tests.support.nats import missing, nats_cluster
from tests.support.server_process import ServerProcess, server_process

__all__ = ["FLOODS", "Flood", "Result", "main", "measure"]

FLAGS = (
    "--mode", "realtime", "--step-rate", "20", "--max-steps", "1000000", "--log-level", "error",
    "--task", "multi_agent/01",
)  # fmt: skip
HERE, EVERYWHERE = "127.0.0.1", "0.0.0.0"
MAX_GAP = 0.150
MAX_CALL = 0.400
"""Longest call of an agent. Without a flood, it takes up to 50 ms."""
MAX_GROWTH = 32 * 1024 * 1024
BLOB = 256 * 1024
HURRY = 0.04
READY = "ready\n"
"""Line that the flooding process prints when it begins."""
OVERVIEW = "/api/overview?limit=200&search=" + "+".join("multi_agent")
ELSEWHERE = "X-Forwarded-For: 203.0.113.9\r\n"
"""Header of a proxy, so that the server treats the connection as a remote one."""


def _get(page: str) -> bytes:
    return f"GET {page} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()


def _message(message: Mapping[str, object]) -> bytes:
    return frame(json.dumps(message).encode(), TEXT)


def _many(piece: bytes) -> bytes:
    """Repeat a piece up to the size of one read."""
    return piece * max(1, BLOB // max(1, len(piece)))


def _fragments(code: str) -> bytes:
    inner = frame(b"", CONTINUATION, fin=False) * 1020
    return frame(b"", TEXT, fin=False) + inner + frame(b"{}", CONTINUATION)


def _unknown_fields(code: str) -> bytes:
    fields = ",".join(f'"{i:x}":0' for i in range(7000))
    return frame(f'{{"type":"hello",{fields}}}'.encode()[:65_000] + b"}", TEXT)


def _in_and_out(code: str) -> bytes:
    join = {"type": "join", "episode": code, "role": "spectator", "view": "both"}
    return _message(join) + _message({"type": "leave"})


@dataclass(frozen=True, slots=True)
class Flood:
    """A message that is repeated, the messages that precede it, and whether replies are read.

    With `silent`, the flood only opens and keeps this many connections. With `vanishes`, each
    connection is reset as soon as its first messages are answered, and opened again. With
    `hurries`, it is closed after 40 ms, answered or not. With `watched`, the flood plays in rooms
    with 200 spectators each, given by their tasks and views; `watched_players` is what their
    players send; with `resyncs`, these spectators ask for snapshots. With `resumes`, the
    connections are spectators that vanish all at once and resume their sessions. With `rematches`,
    players end games and ask for rematches. With `opens`, hosts open and close games. With
    `delayed`, players of delayed seats act. With `texts`, players read the text of all seats in
    games of this kind. With `elsewhere`, its connections are remote; new clients are then remote
    too and have a token.
    `rooms` is the number of other episodes on the server. With `page`, each connection requests
    this page again and again; with `operator`, from the operator port. With `loads`, so many loads
    of the browser client begin each second. With `records`, the server uses TLS with an RSA key,
    and the connections send records of this kind; with `remote`, to another address of this
    machine, so that they are limited as those of strangers. With `broker`, the flood comes from an
    MQTT broker of this kind, during the whole measurement. With `cluster`, the connections flood
    another node of the server's cluster, on a real NATS. With `mcp`, the flood is of this kind and
    attacks `robotouille-mcp`, whose memory and calls are measured.
    `max_growth` is the limit for the memory, and `max_gap` for the longest gap or call.
    """

    what: str
    piece: Callable[[str], bytes] = lambda code: b""
    first: tuple[str, ...] = ()
    reads: bool = True
    silent: int = 0
    vanishes: bool = False
    hurries: bool = False
    watched: tuple[tuple[str, str], ...] = ()
    watched_players: str = "act"
    resyncs: bool = False
    resumes: bool = False
    rematches: bool = False
    opens: bool = False
    delayed: bool = False
    texts: TextFloodKind | None = None
    page: str = ""
    loads: int = 0
    operator: bool = False
    records: Kind | None = None
    remote: bool = False
    broker: BrokerFlood | None = None
    cluster: bool = False
    mcp: McpFloodKind | None = None
    elsewhere: bool = False
    rooms: int = 0
    connections: int = 4
    max_growth: int = MAX_GROWTH
    max_gap: float = MAX_GAP
    subprotocol: str = SUBPROTOCOL


FLOODS = {
    "none": Flood("nothing"),
    "pings": Flood("empty pings before hello", lambda code: frame(b"", PING)),
    "unread-pings": Flood(
        "pings whose pongs are not read", lambda code: frame(b"x" * 125, PING), reads=False
    ),
    "pongs": Flood("empty pongs", lambda code: frame(b"", PONG), ("hello",)),
    "fragments": Flood("messages of 1,022 fragments", _fragments, ("hello",)),
    "silence": Flood("1,200 silent connections", silent=1200),
    "resyncs": Flood(
        "requests for snapshots", lambda code: _message({"type": "resync"}), ("hello", "join")
    ),
    "unread-resyncs": Flood(
        "requests for snapshots that are not read",
        lambda code: _message({"type": "resync"}),
        ("hello", "join"),
        reads=False,
    ),
    "joins": Flood("repeated joining and leaving", _in_and_out, ("hello",)),
    "lists": Flood(
        "lists of 300 episodes", lambda code: _message({"type": "list"}), ("hello",), rooms=300
    ),
    "cluster-lists": Flood(
        "lists of 100 episodes from another node, from 60 connections",
        lambda code: _message({"type": "list"}),
        ("hello",),
        cluster=True,
        rooms=100,
        connections=60,
    ),
    "cluster-codes": Flood(
        "wrong codes at another node, from 60 connections",
        lambda code: _message({"type": "join", "episode": "AAAAA-AAAAA"}),
        ("hello",),
        cluster=True,
        connections=60,
    ),
    "cluster-rematches": Flood(
        "rematches of unknown games at another node, from 60 connections",
        lambda code: _message({"type": "create", "rematch": "AAAAA-AAAAA"}),
        ("hello",),
        cluster=True,
        connections=60,
    ),
    "cluster-closings": Flood(
        "closing of unknown games at another node, from 60 connections",
        lambda code: _message({"type": "close", "episode": "AAAAA-AAAAA"}),
        ("hello",),
        cluster=True,
        connections=60,
    ),
    "cluster-openings": Flood(
        "games that 8 hosts at another node open and close at once",
        opens=True,
        cluster=True,
        connections=8,
    ),
    "cluster-watching": Flood(
        "watching and leaving a game from another node, from 60 connections",
        _in_and_out,
        ("hello",),
        cluster=True,
        connections=60,
    ),
    "fields": Flood("9,900 unknown fields before hello", _unknown_fields),
    "codes": Flood(
        "wrong codes",
        lambda code: _message({"type": "join", "episode": "AAAAA-AAAAA"}),
        ("hello",),
        elsewhere=True,
    ),
    "places": Flood("600 silent connections from one address", silent=600, elsewhere=True),
    "arrays": Flood(
        "nested lists in MessagePack",
        lambda code: frame(b"\xdc\x00\x40" * 1000, BINARY),
        subprotocol="robotouille.v1.msgpack",
    ),
    "crowd": Flood(
        "joining and leaving, from 60 connections", _in_and_out, ("hello",), connections=60
    ),
    "resets": Flood(
        "handshakes that are reset, from 60 connections", vanishes=True, connections=60
    ),
    "vanishing": Flood(
        "hello of clients that vanish, from 60 connections",
        first=("hello",),
        vanishes=True,
        connections=60,
    ),
    "storm": Flood(
        "clients that join and leave within 40 ms, from 250 connections",
        first=("hello", "join"),
        vanishes=True,
        hurries=True,
        connections=250,
    ),
    "resume-storm": Flood(
        "spectators that resume and vanish in bursts, from 200 connections",
        resumes=True,
        connections=200,
    ),
    "rematches": Flood(
        "games that players end at once, and their rematches, from 8 connections",
        rematches=True,
        connections=8,
    ),
    "openings": Flood("games that 4 hosts open and close at once", opens=True, connections=4),
    "delayed": Flood(
        "actions of players of delayed seats, from 16 connections", delayed=True, connections=16
    ),
    "declared": Flood(
        "declared thinking times of a day, in 2 games", texts="declared", connections=2
    ),
    "rematch-sight": Flood(
        "texts of limited sight in the rematches of one game", texts="rematches", connections=1
    ),
    "fast-sight": Flood(
        "actions and limited sight at 60 steps a second, in the rematches of one game",
        texts="fast",
        connections=1,
    ),
    "idle-sight": Flood(
        "limited sight at 60 steps a second, in 12 games in which nobody acts",
        texts="idle",
        connections=12,
    ),
    "metrics": Flood("reads of the metrics, from 60 connections", page="/metrics", connections=60),
    "operator": Flood(
        "searches of the operator page, from 60 connections",
        lambda code: _get(OVERVIEW),
        page=OVERVIEW,
        operator=True,
        rooms=300,
        connections=60,
        # A burst of requests allows 23 answers of 200 rows at the same time, each of 1.8 MiB. The
        # memory does not grow after the first burst.
        max_growth=48 * 1024 * 1024,
    ),
    "page": Flood(
        "loads of the browser client, from 60 connections",
        page=f"/play/{shared_site().version}/{BUNDLE}",
        connections=60,
    ),
    "loads": Flood(
        "1,000 loads of the browser client a second, from one address",
        loads=1000,
        # It has up to 800 connections at once, and each takes some 40 KiB.
        max_growth=2 * MAX_GROWTH,
    ),
    "records": Flood(
        "TLS records of one byte, from 30 connections",
        records="bytes",
        connections=30,
    ),
    "keys": Flood("changes of keys, from 30 connections", records="keys", connections=30),
    "handshakes": Flood(
        "TLS handshakes, from 30 connections", records="handshakes", connections=30
    ),
    "groups": Flood(
        "TLS handshakes with slow groups, from 30 connections", records="groups", connections=30
    ),
    "displaced": Flood(
        "TLS handshakes from one remote address, above its limit",
        records="displaced",
        remote=True,
        connections=320,
    ),
    "broker": Flood("packets of an MQTT broker in shifted TLS records", broker="packets"),
    "broker-keys": Flood("changes of keys by an MQTT broker", broker="keys"),
    "mcp-silence": Flood(
        "700 silent connections to robotouille-mcp", silent=700, mcp="silence", max_gap=MAX_CALL
    ),
    "mcp-abandoned": Flood(
        "calls of robotouille-mcp whose client closes the connection",
        mcp="abandoned",
        max_gap=MAX_CALL,
    ),
    "mcp-values": Flood(
        "requests to robotouille-mcp with 20,000 values", mcp="values", max_gap=MAX_CALL / 2
    ),
    "mcp-calls": Flood(
        "calls of robotouille-mcp with one token, from 64 connections",
        mcp="calls",
        connections=64,
        max_gap=MAX_GAP,
    ),
    "mcp-tokens": Flood(
        "calls of robotouille-mcp with four tokens, from 200 connections",
        mcp="tokens",
        connections=200,
        max_gap=MAX_GAP,
    ),
    "mcp-streams": Flood(
        "event streams of robotouille-mcp that are opened and closed, from 64 connections",
        mcp="streams",
        connections=64,
        max_gap=MAX_GAP,
    ),
    "mcp-strangers": Flood(
        "requests to robotouille-mcp with made-up tokens and sessions, from 400 connections",
        mcp="strangers",
        connections=400,
        max_gap=MAX_GAP,
    ),
    "mcp-newcomers": Flood(
        "such requests, each over a new connection, 64 at a time",
        mcp="newcomers",
        connections=64,
        max_gap=MAX_GAP,
    ),
    "acts": Flood(
        "actions of spectators, from 60 connections",
        lambda code: _message({"type": "act", "seq": 1, "action": "x" * 300}),
        ("hello", "join"),
        connections=60,
    ),
    "tokens": Flood(
        "hello with an invalid token",
        lambda code: _message({**HELLO, "resume": "x" * 800}),
    ),
    "watched": Flood(
        "actions of a player with 200 spectators",
        watched=(("asynchronous/10", "both"),),
    ),
    "watched-rooms": Flood(
        "actions of players in 4 rooms with 800 spectators",
        watched=(("synchronous/01", "state"), ("asynchronous/10", "both")) * 2,
    ),
    "spectator-resyncs": Flood(
        "requests for snapshots from 200 spectators",
        watched=(("synchronous/01", "state"),),
        resyncs=True,
    ),
    "chat": Flood(
        "chat of 4 players with 200 spectators",
        watched=(("multi_agent/10@4", "state"),),
        watched_players="say",
    ),
    "mixed": Flood(
        "actions, chat, requests for snapshots and rematches of 4 players with 800 spectators",
        watched=(
            ("asynchronous/10", "both"),
            ("asynchronous/10", "both"),
            ("training/01_synchronous", "both"),
        ),
        watched_players="mixed",
        rematches=True,
    ),
}


class Attacker:
    """One connection of a flood, which reconnects whenever it is closed."""

    def __init__(self, flood: Flood, port: int, code: str) -> None:
        self.flood = flood
        self._address = ("127.0.0.1", port)
        self._opening = request(flood.subprotocol, more=ELSEWHERE if flood.elsewhere else "")
        join = {"type": "join", "episode": code, "role": "spectator"}
        preludes = {"hello": _message(HELLO), "join": _message(join)}
        self._opening += b"".join(preludes[name] for name in flood.first)
        if flood.page:
            self._opening = _get(flood.page)
        self._blob = _many(flood.piece(code))
        self._socket: socket.socket | None = None
        self._unsent = memoryview(b"")
        self._opened = 0.0

    def push(self) -> bool:
        """Send and read what is possible; return False if neither was."""
        if self._socket is None and not self._open():
            return False
        assert self._socket is not None
        try:
            if self.flood.vanishes and not self._unsent:
                return self._vanish()
            done = self._read() if self.flood.reads else False
            self._unsent = self._unsent or memoryview(self._blob)
            sent = self._socket.send(self._unsent)
            self._unsent = self._unsent[sent:]
            return sent > 0 or done
        except BlockingIOError:
            return False
        except OSError:
            self._socket.close()
            self._socket = None
            return False

    def _vanish(self) -> bool:
        """Reset the connection once the server has answered, or close it after a while."""
        assert self._socket is not None
        if self.flood.hurries:
            if time.monotonic() < self._opened + HURRY:
                raise BlockingIOError
            raise ConnectionResetError
        if not self._socket.recv(BLOB):
            raise ConnectionResetError
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        raise ConnectionResetError

    def _open(self) -> bool:
        try:
            self._socket = socket.create_connection(self._address, timeout=2)
        except OSError:
            return False
        self._socket.setblocking(False)
        self._unsent = memoryview(self._opening)
        self._opened = time.monotonic()
        return True

    def _read(self) -> bool:
        assert self._socket is not None
        with suppress(BlockingIOError):
            if not self._socket.recv(BLOB):
                raise ConnectionResetError
            return True
        return False

    @property
    def sends(self) -> bool:
        """True if there is something to send."""
        return bool(self._unsent or self._blob)

    def fileno(self) -> int:
        return self._socket.fileno() if self._socket is not None else -1


def attack(name: str, port: int, code: str) -> None:
    """Flood a server until the process is killed."""
    os.nice(5)
    flood = FLOODS[name]
    rooms = (
        AudienceFlood(
            port,
            flood.watched,
            players=flood.watched_players,
            resyncs=flood.resyncs,
            rematches=flood.rematches,
        )
        if flood.watched
        else None
    )
    host = _remote_address() if flood.remote else HERE
    records = RecordFlood(host, port, flood.connections, flood.records) if flood.records else None
    delayed = DelayFlood(port, flood.connections) if flood.delayed else None
    texts = TextFlood(port, flood.texts, flood.connections) if flood.texts else None
    print(READY, end="", flush=True)
    if name == "none" or flood.broker:
        time.sleep(3600)
    if flood.mcp in ("abandoned", "values"):
        McpFlood(port, flood.mcp).run()
    if flood.mcp in ("calls", "tokens", "streams", "strangers", "newcomers"):
        McpLines(port, flood.mcp, code, flood.connections).run()
    if flood.loads:
        script = f"/play/{shared_site().version}/{BUNDLE}"
        PageFlood(port, flood.loads, ("/play", script)).run()
    if rooms is not None:
        rooms.run()
    if records is not None:
        records.run()
    if delayed is not None:
        delayed.run()
    if texts is not None:
        texts.run()
    if flood.resumes:
        ResumeStorm(port, code, flood.connections).run()
    if flood.opens:
        OpeningFlood(port, flood.connections).run()
    if flood.rematches:
        RematchFlood(port, flood.connections).run()
    if flood.silent:
        _keep_silent(port, flood.silent, flood.elsewhere)
    attackers = [Attacker(flood, port, code) for _ in range(flood.connections)]
    while True:
        if flood.hurries:
            # All at once: the server accepts sockets faster than it answers them.
            for attacker in attackers:
                attacker.push()
            time.sleep(0.001)
            continue
        if any(attacker.push() for attacker in attackers):
            continue
        waiting = [attacker for attacker in attackers if attacker.fileno() >= 0]
        reading = waiting if flood.reads else []
        writing = [attacker for attacker in waiting if attacker.sends]
        select.select(reading, writing, [], 0.05)


def _keep_silent(port: int, count: int, elsewhere: bool) -> None:
    """Keep silent connections open: remote ones after a handshake, local ones without."""
    handshake = request(SUBPROTOCOL, more=ELSEWHERE) if elsewhere else b""
    held: list[socket.socket] = []
    while True:
        while len(held) < count:
            with suppress(OSError):
                held.append(socket.create_connection(("127.0.0.1", port), timeout=1))
                held[-1].sendall(handshake)
                held[-1].setblocking(False)
                continue
            time.sleep(0.05)
        time.sleep(0.2)
        held = [one for one in held if not _is_closed(one)]


def _is_closed(held: socket.socket) -> bool:
    try:
        over = not held.recv(BLOB)
    except BlockingIOError:
        return False
    except OSError:
        over = True
    if over:
        held.close()
    return over


@dataclass(frozen=True, slots=True)
class Result:
    """Effect of a flood: the longest gap of each run, and the server's growth in bytes.

    `served` is the number of complete loads of the browser client in each second.
    """

    name: str
    gaps: tuple[float, ...]
    growth: int
    log_bytes: int
    admitted: bool
    served: tuple[int, ...] = ()

    @property
    def gap(self) -> float:
        return median(self.gaps)

    @property
    def withstood(self) -> bool:
        within = self.growth < FLOODS[self.name].max_growth
        return self.gap < FLOODS[self.name].max_gap and within and self.admitted


def measure(name: str, runs: int, seconds: float, *, descriptors: int = 0) -> Result:
    """Run one flood against its own server, whose soft limit of descriptors may be set."""
    _limit_descriptors(descriptors)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="robotouille-flood-"))
        flags, tls = _tls(Path(folder)) if FLOODS[name].records else ((), None)
        if kind := FLOODS[name].broker:
            flags = _broker(kind, Path(folder), stack)
        if FLOODS[name].cluster:
            flags += ("--cluster", stack.enter_context(nats_cluster(Path(folder), 1)).url(0))
        operator = _free_port()
        flags += ("--operator-port", str(operator))
        if FLOODS[name].remote:
            flags += ("--host", EVERYWHERE)
        with server_process(Path(folder), *FLAGS, *flags) as server:
            process, game, port = _measured(name, server, operator, tls, stack)
            game.longest_gap(1.0)
            if FLOODS[name].cluster:
                # It joins after the game, which is therefore on the first node.
                port = stack.enter_context(_other_node(Path(folder), flags)).port
            before, gaps, most, admitted = process.memory_info().rss, [], 0, True
            served: list[int] = []
            for _ in range(runs):
                with _flooding(name, port, game.code, served):
                    time.sleep(0.3)
                    gaps.append(game.longest_gap(seconds))
                    most = max(most, process.memory_info().rss)
                    admitted = admitted and (
                        game.admitted()
                        if isinstance(game, HonestAgent)
                        else _admitted(server, FLOODS[name].elsewhere, tls)
                    )
            game.close()
            size = server.log.stat().st_size
            return Result(name, tuple(gaps), most - before, size, admitted, tuple(served))


def _measured(
    name: str,
    server: ServerProcess,
    operator: int,
    tls: ssl.SSLContext | None,
    stack: ExitStack,
) -> tuple[psutil.Process, HonestGame | HonestAgent, int]:
    """Return the process that is flooded, its honest user, and the port for the flood."""
    flood = FLOODS[name]
    if flood.mcp:
        port, pid = stack.enter_context(mcp_process(server.url))
        token = _token(server, Role.HOST, "honest")
        count = 4 if flood.mcp == "tokens" else 1
        others = " ".join(_token(server, Role.HOST, f"flood-{n}") for n in range(count))
        return psutil.Process(pid), HonestAgent(port, pid, token, others), port
    port = operator if flood.operator else server.port
    return psutil.Process(server.process.pid), HonestGame(server, flood.rooms, tls), port


@contextmanager
def _other_node(folder: Path, flags: tuple[str, ...]) -> Iterator[ServerProcess]:
    own = folder / "other"
    own.mkdir()
    with server_process(own, *FLAGS, *flags[:-2], "--no-operator") as node:
        yield node


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def _remote_address() -> str:
    """Return an address of this machine that others can reach, or an empty string."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route, suppress(OSError):
        route.connect(("192.0.2.1", 9))  # This sends nothing.
        own = str(route.getsockname()[0])
        return "" if ipaddress.ip_address(own).is_loopback else own
    return ""


def _is_possible(flood: Flood) -> bool:
    return not (flood.cluster and missing()) and not (flood.remote and not _remote_address())


def _limit_descriptors(soft: int) -> None:
    """Set the soft limit of descriptors for child processes; 0 means the hard limit."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft or hard, hard))


@contextmanager
def _flooding(name: str, port: int, code: str, served: list[int]) -> Iterator[None]:
    _limit_descriptors(0)
    command = [sys.executable, "-m", "tests.programs.floods", "--attack", name, str(port), code]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == READY, "the flood did not begin"
        yield
    finally:
        process.kill()
        served += map(int, process.stdout.read().split())
        process.wait()


def _tls(folder: Path) -> tuple[tuple[str, ...], ssl.SSLContext]:
    """Write a certificate; return the server's flags and a context that trusts it."""
    # Signatures with such a key are the slowest that servers use.
    key = rsa.generate_private_key(public_exponent=65537, key_size=4096)
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "flooded server")])
    now = datetime.now(UTC)
    here = x509.IPAddress(ipaddress.ip_address("127.0.0.1"))
    certificate = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([here]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    pem = folder / "chain.pem"
    pem.touch(mode=0o600)
    chain = certificate.public_bytes(serialization.Encoding.PEM)
    pem.write_bytes(
        chain
        + key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
    )
    trusting = ssl.create_default_context(cadata=chain.decode())
    return ("--tls-cert", str(pem), "--tls-key", str(pem)), trusting


def _broker(kind: BrokerFlood, folder: Path, stack: ExitStack) -> tuple[str, ...]:
    """Start the flooding broker; return the server's flags."""
    authority, pem, ca = trustme.CA(), folder / "broker.pem", folder / "ca.pem"
    authority.cert_pem.write_to_path(ca)
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(pem)
    url = stack.enter_context(flooding_broker(kind, pem))
    return ("--mqtt", url, "--mqtt-ca", str(ca), "--mqtt-name", "flood")


def _token(server: ServerProcess, role: Role, subject: str) -> str:
    keys = FileKeyring(server.recordings.with_name("recordings.state") / "keys.json")
    return Tokens(keys, time.time).mint_role(role, subject, seconds=600)


def _admitted(server: ServerProcess, elsewhere: bool, tls: ssl.SSLContext | None) -> bool:
    """Return whether a new client is admitted within five seconds."""
    end, hello = time.monotonic() + 5, {**HELLO, "name": "newcomer"}
    headers: dict[str, str] = {}
    if elsewhere:
        hello["token"] = _token(server, Role.PLAYER, "p-1")
        name, _, value = ELSEWHERE.strip().partition(": ")
        headers[name] = value
    while time.monotonic() < end:
        with suppress(OSError, TimeoutError, EOFError, WebSocketException):
            with connect(
                server.url,
                subprotocols=[SUBPROTOCOL],
                open_timeout=3,
                additional_headers=headers,
                ssl=tls,
            ) as newcomer:
                newcomer.send(json.dumps(hello))
                return bool(json.loads(newcomer.recv(timeout=3))["type"] == "welcome")
        time.sleep(0.1)
    return False


def _rows(names: list[str], runs: int, seconds: float) -> Iterator[Result]:
    heads = ("flood", "gap", "of all runs", "memory", "log", "new client")
    print("{:16} {:>8}   {:30} {:>10} {:>9}  {}".format(*heads))
    for name in names:
        result = measure(name, runs, seconds, descriptors=1024 if FLOODS[name].silent else 0)
        each = " ".join(f"{gap * 1000:.0f}" for gap in result.gaps)
        print(
            f"{name:16} {result.gap * 1000:5.0f} ms   {each:30} {result.growth / 2**20:+6.1f} MiB"
            f" {result.log_bytes / 1024:5.0f} KiB  {'admitted' if result.admitted else 'REFUSED'}"
            f"{f', {median(result.served):.0f} loads a second' if result.served else ''}"
            f"{'' if result.withstood else '   <-- exceeds the limits'}",
            flush=True,
        )
        yield result


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a flood exceeded the limits."""
    parser = argparse.ArgumentParser(prog="python -m tests.programs.floods", description=__doc__)
    parser.add_argument("floods", nargs="*", help=f"some of: {', '.join(FLOODS)}")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4.0, help="length of a run")
    parser.add_argument("--attack", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.attack:
        name, port, code = given.attack
        attack(name, int(port), code)
    possible = [name for name, flood in FLOODS.items() if _is_possible(flood)]
    results = list(_rows(given.floods or possible, given.runs, given.seconds))
    return 0 if all(result.withstood for result in results) else 1


if __name__ == "__main__":
    sys.exit(main())
