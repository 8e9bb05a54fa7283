"""Floods of `robotouille-mcp` over HTTP, and an honest agent that uses it at the same time."""

from __future__ import annotations

import json
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException
from threading import Thread
from typing import Any, Literal

from tests.support.mcp_agent import COMMAND

__all__ = ["HonestAgent", "McpFlood", "McpFloodKind", "mcp_process"]

McpFloodKind = Literal["silence", "abandoned", "values"]
VERSION = "2025-06-18"
"""Version of MCP whose calls go on when their client closes its connection."""
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

    def __init__(self, port: int) -> None:
        self._port = port
        self._headers = {
            "accept": "application/json, text/event-stream",
            "content-type": "application/json",
        }
        client = {"name": "agent", "version": "1"}
        hello = {"protocolVersion": VERSION, "capabilities": {}, "clientInfo": client}
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

    def abandon(self, name: str, **arguments: Any) -> None:
        """Call a tool, and close the connection as soon as the answer begins."""
        body = _request("tools/call", {"name": name, "arguments": arguments})
        headers = {"host": "127.0.0.1", "content-length": str(len(body)), **self._headers}
        head = "\r\n".join(f"{key}: {value}" for key, value in headers.items())
        with socket.create_connection(("127.0.0.1", self._port), timeout=20) as connection:
            connection.sendall(f"POST /mcp HTTP/1.1\r\n{head}\r\n\r\n".encode() + body)
            connection.recv(1)


class HonestAgent(_Agent):
    """Agent that measures how long its calls take.

    Attributes:
        code: Empty: the floods need no episode of the agent's.
    """

    code = ""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self._game = self.join_new_game()

    def longest_gap(self, seconds: float) -> float:
        """Return the time of the longest call, in seconds."""
        end, longest = time.monotonic() + seconds, 0.0
        while time.monotonic() < end:
            began = time.monotonic()
            self.tool("list_actions", game=self._game)
            longest = max(longest, time.monotonic() - began)
            time.sleep(PAUSE)
        return longest

    def admitted(self) -> bool:
        """Return whether another agent can open a session within five seconds."""
        began = time.monotonic()
        with suppress(OSError, HTTPException):
            _Agent(self._port)
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
