"""Blocking connections of floods, before they flood."""

from __future__ import annotations

import json
import socket

from tests.support.fuzzing.wire import TEXT, frame, request

__all__ = [
    "CHUNK",
    "ELSEWHERE",
    "code_of_new_game",
    "connect",
    "join_all_seats",
    "message",
    "read_until",
    "text_after",
]

SUBPROTOCOL = "robotouille.v1.json"
CHUNK = 1024 * 1024
ELSEWHERE = "X-Forwarded-For: 203.0.113.9\r\n"
"""Header of a proxy, so that the server treats a connection as a remote player's, not a host's."""


def message(**fields: object) -> bytes:
    """Return the frame of a message."""
    return frame(json.dumps(fields).encode(), TEXT)


def connect(port: int, name: str, headers: str = "") -> socket.socket:
    """Return a connection that the server has welcomed."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=20)
    hello = message(type="hello", protocol=1, name=name, kind="bot")
    connection.sendall(request(SUBPROTOCOL, more=headers) + hello)
    read_until(connection, b'"welcome"')
    return connection


def read_until(connection: socket.socket, mark: bytes) -> bytes:
    """Return everything received up to some bytes, and what came with them."""
    data = b""
    while mark not in data:
        received = connection.recv(CHUNK)
        if not received:
            raise ConnectionError(f"the server closed the connection without {mark!r}")
        data += received
    return data


def text_after(data: bytes, field: str) -> str:
    """Return the first value of a field."""
    return data.split(f'"{field}":"'.encode())[1].split(b'"')[0].decode()


def code_of_new_game(port: int, rules: dict[str, object]) -> str:
    """Open a game as its host, and return its code."""
    host = connect(port, "host")
    host.sendall(message(**{"type": "create", **rules}))
    code = text_after(read_until(host, b'"created"'), "code")
    host.close()
    return code


def join_all_seats(connection: socket.socket, code: str) -> None:
    """Join a game as the player of all its seats, who reads everything."""
    connection.sendall(message(type="join", episode=code, seats="all", view="both", partial=True))
    read_until(connection, b'"joined"')
