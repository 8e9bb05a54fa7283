"""Measurements of the effect of floods on an honest game."""

from __future__ import annotations

import ipaddress
import json
import os
import resource
import socket
import ssl
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
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

from robotouille_server.auth import Role, Tokens
from robotouille_server.auth.keys import FileKeyring
from tests.programs.floods.broker import BrokerFlood, flooding_broker
from tests.programs.floods.client import ELSEWHERE
from tests.programs.floods.honest_game import HELLO, SUBPROTOCOL, HonestGame
from tests.programs.floods.mcp import HonestAgent, mcp_process
from tests.programs.floods.table import FLOODS, Flood, Target, remote_address
from tests.support.nats import missing, nats_cluster
from tests.support.server_process import ServerProcess, server_process

__all__ = ["Result", "attack", "measure", "possible_floods"]

FLAGS = (
    "--mode", "realtime", "--step-rate", "20", "--max-steps", "1000000", "--log-level", "error",
    "--task", "multi_agent/01",
)  # fmt: skip
EVERYWHERE = "0.0.0.0"
READY = "ready\n"
"""Line that the flooding process prints when it begins."""


def attack(name: str, target: Target) -> None:
    """Flood a server until the process is killed."""
    os.nice(5)
    attackers = FLOODS[name].prepare(target)
    print(READY, end="", flush=True)
    attackers.run()


def possible_floods() -> list[str]:
    """Return the floods that this machine can run."""
    return [
        name
        for name, flood in FLOODS.items()
        if not (flood.at == "node" and missing()) and not (flood.remote and not remote_address())
    ]


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


def measure(name: str, runs: int, seconds: float) -> Result:
    """Run one flood against its own server."""
    flood = FLOODS[name]
    _limit_descriptors(flood.descriptors)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="robotouille-flood-")))
        flags, tls = _tls(folder) if flood.tls else ((), None)
        if flood.broker is not None:
            flags = _broker(flood.broker, folder, stack)
        if flood.at == "node":
            flags += ("--cluster", stack.enter_context(nats_cluster(folder, 1)).url(0))
        operator = _free_port()
        flags += ("--operator-port", str(operator))
        if flood.remote:
            flags += ("--host", EVERYWHERE)
        with server_process(folder, *FLAGS, *flags) as server:
            process, game, port = _measured(flood, server, operator, tls, stack)
            game.longest_gap(1.0)
            if flood.at == "node":
                # It joins after the game, which is therefore on the first node.
                port = stack.enter_context(_other_node(folder, flags)).port
            before, gaps, most, admitted = process.memory_info().rss, [], 0, True
            served: list[int] = []
            for _ in range(runs):
                with _flooding(name, Target(port, game.code), served):
                    time.sleep(0.3)
                    gaps.append(game.longest_gap(seconds))
                    most = max(most, process.memory_info().rss)
                    admitted = admitted and (
                        game.admitted()
                        if isinstance(game, HonestAgent)
                        else _admitted(server, flood.elsewhere, tls)
                    )
            game.close()
            size = server.log.stat().st_size
            return Result(name, tuple(gaps), most - before, size, admitted, tuple(served))


def _measured(
    flood: Flood,
    server: ServerProcess,
    operator: int,
    tls: ssl.SSLContext | None,
    stack: ExitStack,
) -> tuple[psutil.Process, HonestGame | HonestAgent, int]:
    """Return the process that is flooded, its honest user, and the port for the flood."""
    if flood.at == "mcp":
        port, pid = stack.enter_context(mcp_process(server.url))
        token = _token(server, Role.HOST, "honest")
        tokens = [_token(server, Role.HOST, f"flood-{n}") for n in range(flood.tokens)]
        return psutil.Process(pid), HonestAgent(port, pid, token, " ".join(tokens)), port
    port = operator if flood.at == "operator" else server.port
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


def _limit_descriptors(soft: int) -> None:
    """Set the soft limit of descriptors for child processes; 0 means the hard limit."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft or hard, hard))


@contextmanager
def _flooding(name: str, target: Target, served: list[int]) -> Iterator[None]:
    _limit_descriptors(0)
    command = [sys.executable, "-m", "tests.programs.floods", "--attack", name, *map(str, target)]
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
