"""Floods of `robotouille-mcp` over HTTP, and an honest agent that uses it at the same time."""

from __future__ import annotations

import json
import select
import socket
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from threading import Thread
from typing import Any, Literal

from tests.support.mcp_agent import COMMAND

__all__ = ["HonestAgent", "McpFlood", "McpFloodKind", "McpLines", "mcp_process"]

McpFloodKind = Literal[
    "silence", "abandoned", "values", "calls", "tokens", "streams", "strangers", "newcomers"
]
VERSION = "2025-06-18"
"""Version of MCP whose calls go on when their client closes its connection."""
STATELESS = "2026-07-28"
CLIENT = {"name": "agent", "version": "1"}
VALUES = 20_000
"""Empty lists in a request of just less than 64 KiB."""
TASK = "multi_agent/01"
PAUSE = 0.05
THREADS = 8


@contextmanager
def mcp_process(url: str) -> Iterator[tuple[int, int]]:
    """Run `robotouille-mcp`, and yield its port and its process id."""
    command = [*COMMAND, "--url", url, "--listen", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().split()[1].removesuffix("/mcp")
            yield int(address.rpartition(":")[2]), process.pid
        finally:
            process.kill()


def _request(method: str, params: dict[str, Any]) -> bytes:
    request = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
    return json.dumps(request, separators=(",", ":")).encode()


class _Agent:
    """MCP client with a session that opens a connection for each request."""

    def __init__(self, port: int, token: str = "") -> None:
        self._port = port
        self._headers = {
            "accept": "application/json, text/event-stream",
            "content-type": "application/json",
            **({"authorization": f"Bearer {token}"} if token else {}),
        }
        hello = {"protocolVersion": VERSION, "capabilities": {}, "clientInfo": CLIENT}
        self.ask("initialize", hello)
        self._headers["mcp-protocol-version"] = VERSION

    def ask(self, method: str, params: dict[str, Any]) -> Any:
        """Send a request, and return its result."""
        return self.send(_request(method, params))

    def send(self, body: bytes) -> Any:
        """Send the body of a request, and return its result."""
        connection = HTTPConnection("127.0.0.1", self._port, timeout=20)
        try:
            connection.request("POST", "/mcp", body, self._headers)
            answer = connection.getresponse()
            if session := answer.headers["mcp-session-id"]:
                self._headers["mcp-session-id"] = session
            lines = answer.read().decode().splitlines()
        finally:
            connection.close()
        data = next((line for line in lines if line.startswith("data: {")), "data: {}")
        return json.loads(data.removeprefix("data: ")).get("result")

    def tool(self, name: str, **arguments: Any) -> Any:
        """Call a tool, and return its structured content."""
        return self.ask("tools/call", {"name": name, "arguments": arguments})["structuredContent"]

    def join_new_game(self) -> str:
        """Join a new episode, and return the handle of the game."""
        code = self.tool("create_episode", task=TASK)["code"]
        return str(self.tool("join", episode=code)["game"])

    def packet(self, verb: str, body: bytes = b"", **headers: str) -> bytes:
        """Return the bytes of a request in the agent's session."""
        return self._packet(verb, body, {**self._headers, **headers})

    @staticmethod
    def _packet(verb: str, body: bytes, headers: Mapping[str, str]) -> bytes:
        fields = {"host": "127.0.0.1", "content-length": str(len(body)), **headers}
        head = "\r\n".join(f"{key}: {value}" for key, value in fields.items())
        return f"{verb} /mcp HTTP/1.1\r\n{head}\r\n\r\n".encode() + body

    def stateless(self, method: str) -> bytes:
        """Return the bytes of a request in the version of MCP that has no sessions."""
        client = {"protocolVersion": STATELESS, "clientCapabilities": {}, "clientInfo": CLIENT}
        meta = {f"io.modelcontextprotocol/{name}": value for name, value in client.items()}
        version = {"mcp-protocol-version": STATELESS, "mcp-method": method}
        headers = {**self._headers, **version}
        headers.pop("mcp-session-id")
        return self._packet("POST", _request(method, {"_meta": meta}), headers)

    def abandon(self, name: str, **arguments: Any) -> None:
        """Call a tool, and close the connection as soon as the answer begins."""
        body = _request("tools/call", {"name": name, "arguments": arguments})
        with socket.create_connection(("127.0.0.1", self._port), timeout=20) as connection:
            connection.sendall(self.packet("POST", body))
            connection.recv(1)


class HonestAgent(_Agent):
    """Agent that measures how much the server works while each of its calls waits.

    Args:
        pid: The process of the server.
        token: Token of the agent.
        code: Tokens for the flood.
    """

    def __init__(self, port: int, pid: int, token: str, code: str) -> None:
        super().__init__(port, token)
        self.code = code
        self._worked = Path(f"/proc/{pid}/schedstat")
        self._token = token
        self._game = self.join_new_game()

    def longest_gap(self, seconds: float) -> float:
        """Return the longest CPU time of the server's event loop during a call, in seconds."""
        end, longest = time.monotonic() + seconds, 0.0
        while time.monotonic() < end:
            began = self._cpu_seconds()
            self.tool("list_actions", game=self._game)
            longest = max(longest, self._cpu_seconds() - began)
            time.sleep(PAUSE)
        return longest

    def _cpu_seconds(self) -> float:
        # Unlike the time of a call, it does not depend on what else the machine does.
        return int(self._worked.read_text().split()[0]) / 1e9

    def admitted(self) -> bool:
        """Return whether another agent can open a session within five seconds."""
        began = time.monotonic()
        with suppress(OSError, HTTPException):
            _Agent(self._port, self._token)
            return time.monotonic() - began < 5
        return False

    def close(self) -> None:
        """Do nothing, because the process ends."""


class McpFlood:
    """Agent that floods the server in several threads."""

    def __init__(self, port: int, kind: McpFloodKind) -> None:
        self._agent = _Agent(port)
        self._game = self._agent.join_new_game()
        self._values = _request("ping", {"_meta": {"values": [[]] * VALUES}})
        self._send = {"abandoned": self._abandon, "values": self._send_values}[kind]

    def run(self) -> None:
        """Send until the process is killed."""
        threads = [Thread(target=self._repeat) for _ in range(THREADS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def _repeat(self) -> None:
        while True:
            with suppress(OSError, HTTPException):
                self._send()

    def _abandon(self) -> None:
        self._agent.abandon("wait", game=self._game, until="my_move", timeout_seconds=60)

    def _send_values(self) -> None:
        self._agent.send(self._values)


class McpLines:
    """Connections that each send the next request as soon as the last one is answered.

    Args:
        tokens: Valid tokens with spaces between them, which take turns.
    """

    def __init__(self, port: int, kind: McpFloodKind, tokens: str, connections: int) -> None:
        self._address = ("127.0.0.1", port)
        self._agents = [_Agent(port, token) for token in tokens.split()]
        self._count = connections
        self._kind = kind
        self._sent = 0

    def run(self) -> None:
        """Send until the process is killed."""
        lines: dict[socket.socket, bytes] = {}
        while True:
            while len(lines) < self._count:
                with suppress(OSError):
                    line = socket.create_connection(self._address, timeout=20)
                    lines[line] = b""
                    line.sendall(self._next())
            for line in select.select(list(lines), [], [], 0.05)[0]:
                self._continue(line, lines)

    def _continue(self, line: socket.socket, lines: dict[socket.socket, bytes]) -> None:
        try:
            received = line.recv(65_536)
            lines[line] += received
            whole = _is_whole(lines[line])
            if not received or self._kind == "streams" or (whole and self._kind == "newcomers"):
                raise ConnectionResetError
            if whole:
                lines[line] = b""
                line.sendall(self._next())
        except OSError:
            del lines[line]
            line.close()

    def _next(self) -> bytes:
        self._sent += 1
        agent = self._agents[self._sent % len(self._agents)]
        match self._kind:
            case "streams":
                return agent.packet("GET")
            case "strangers" | "newcomers":
                token = f"Bearer made-up-{self._sent}"
                session = {} if self._sent % 2 else {"mcp-session-id": f"{self._sent}"}
                body = _request("ping", {})
                return agent.packet("POST", body, authorization=token, **session)
            case _:
                return agent.stateless("tools/list")


def _is_whole(answer: bytes) -> bool:
    head, end, body = answer.partition(b"\r\n\r\n")
    if not end:
        return False
    _, named, length = head.lower().partition(b"content-length: ")
    return len(body) >= int(length.split()[0]) if named else body.endswith(b"0\r\n\r\n")
