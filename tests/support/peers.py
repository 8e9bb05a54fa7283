"""Connections that keep what they are sent, for tests without sockets."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import msgpack
from pydantic import BaseModel

from robotouille.protocol.codec import JSON, MSGPACK, Codec

__all__ = ["SilentPeer"]


class SilentPeer:
    """A peer that reads all it is sent, unless it is `slow`; `got` are the messages."""

    def __init__(self, codec: Codec = MSGPACK) -> None:
        self.codec = codec
        self.slow = False
        self.got: list[dict[str, Any]] = []
        self.catch_up: Callable[[], None] | None = None
        self.received_bytes = 0

    @property
    def behind(self) -> bool:
        return self.slow

    def keeps_up(self, catch_up: Callable[[], None]) -> bool:
        self.catch_up = catch_up
        return not self.slow

    def send(self, message: BaseModel) -> None:
        self.got.append(message.model_dump(mode="json"))

    def send_frame(self, frame: bytes) -> None:
        start = {126: 4, 127: 10}.get(frame[1], 2)
        unpack = json.loads if self.codec is JSON else msgpack.unpackb
        self.got.append(unpack(frame[start:]))

    answer = send
    answer_frame = send_frame

    def kinds(self) -> list[str]:
        """The types of what came, in order."""
        return [message["type"] for message in self.got]
