"""Server without file descriptors: episodes and log survive."""

from __future__ import annotations

import json
import resource
import socket
import ssl
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import trustme
from structlog.testing import capture_logs
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from robotouille_server import ServerSettings
from robotouille_server.runtime import process_limits as descriptors
from robotouille_server.runtime.logs import configure_logs
from tests.support.server_process import server_process

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
LIMIT = 1024
"""An eighth of it is kept free, more than are accepted before the first is refused."""
SUBPROTOCOL = "robotouille.v1.json"


class Counts:
    log_suppressed = 0


def ask(client: Any, message: dict[str, Any], kind: str) -> dict[str, Any]:
    client.send(json.dumps(message))
    while True:
        answer: dict[str, Any] = json.loads(client.recv(timeout=20))
        if answer["type"] in (kind, "error"):
            return answer


def newcomer(url: str, tls: ssl.SSLContext | None) -> str:
    """Return the answer to a new connection, or an empty string."""
    try:
        with connect(url, subprotocols=[SUBPROTOCOL], open_timeout=5, ssl=tls) as client:  # type: ignore[list-item]
            return str(
                ask(client, {"type": "hello", "protocol": 1, "name": "b"}, "welcome")["type"]
            )
    except (OSError, EOFError, TimeoutError, WebSocketException):
        return ""


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("encrypted", [False, True], ids=["ws", "wss"])
def test_silent_connections_harm_neither_episodes_nor_recordings(
    tmp_path: Path, encrypted: bool
) -> None:
    with ExitStack() as stack:
        command = ["--mode", "realtime", "--step-rate", "20", "--max-steps", "100000"]
        tls = None
        if encrypted:
            authority = trustme.CA()
            certificate = authority.issue_cert("127.0.0.1")
            certificate.private_key_pem.write_to_path(tmp_path / "key.pem")
            certificate.cert_chain_pems[0].write_to_path(tmp_path / "cert.pem")
            command += ["--tls-cert", str(tmp_path / "cert.pem")]
            command += ["--tls-key", str(tmp_path / "key.pem")]
            tls = ssl.create_default_context()
            authority.configure_trust(tls)
        server = stack.enter_context(server_process(tmp_path, *command, "--hello-seconds", "60"))
        resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE, (LIMIT, LIMIT))
        player = stack.enter_context(connect(server.url, subprotocols=[SUBPROTOCOL], ssl=tls))  # type: ignore[list-item]
        assert ask(player, {"type": "hello", "protocol": 1, "name": "a"}, "welcome")
        order = {"type": "create", "task": "synchronous/01", "clock": "realtime", "step_rate": 20}
        code = ask(player, order, "created")["code"]
        assert ask(player, {"type": "join", "episode": code}, "joined")["type"] == "joined"
        held = [
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            for _ in range(2 * LIMIT)
        ]
        step = ask(player, {"type": "resync"}, "snapshot")["step"]
        while ask(player, {"type": "resync"}, "snapshot")["step"] < step + 20:
            time.sleep(0.05)
        taken = len(list(Path(f"/proc/{server.process.pid}/fd").iterdir()))
        # Silent handshakes are aborted while others wait, so encrypted connections take fewer.
        assert LIMIT // 2 < taken < LIMIT - 5, "nothing is kept free for recordings"
        assert ask(player, {"type": "leave"}, "left")["type"] == "left"
        answer = ask(player, order, "created")
        assert answer["type"] == "created", f"no file for a recording: {answer}"
        assert server.log.stat().st_size < 20_000
        for silent in held:
            silent.close()
        end = time.monotonic() + 30
        while newcomer(server.url, tls) != "welcome":
            assert time.monotonic() < end, "nobody is let in when places are free again"


@pytest.mark.parametrize(
    ("host", "proxy", "level"),
    [
        ("0.0.0.0", "", "warning"),
        ("kitchen.example", "", "warning"),
        ("127.0.0.1", "127.0.0.1", "warning"),
        ("127.0.0.1", "", "debug"),
        ("::1", "", "debug"),
    ],
)
def test_small_limit_is_logged_at_startup(
    host: str, proxy: str, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is a warning only where other machines can connect."""
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1024, 2048))
    monkeypatch.setattr(resource, "setrlimit", lambda *_: None)
    configure_logs("debug", "console")
    few = ServerSettings(host=host, trust_proxy=proxy, max_connections=500, max_episodes=100)
    with capture_logs() as lines:
        descriptors.raise_limit(few)
        assert lines == []
        descriptors.raise_limit(few.model_copy(update={"max_connections": 2000}))
    configure_logs("error", "console")
    (received,) = lines
    assert (received["limit"], received["needed"]) == (1024, 2356)
    assert "LimitNOFILE" in received["event"]
    assert received["log_level"] == level


def test_soft_limit_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = [(1024, 524288)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, both: limits.append(both))
    descriptors.raise_limit(ServerSettings())
    assert limits[-1] == (524288, 524288)
