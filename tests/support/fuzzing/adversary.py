"""Seeded source of hostile values, messages, texts and bytes."""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Callable, Sequence
from typing import Any

import msgpack

__all__ = ["Adversary"]

STRINGS = (
    "", " ", "\x00", "\n", "\ufeff", "\u202e", "é", "e\u0301", "\U0001f35f", "\ud800",
    "x" * 41, "x" * 501, "x" * 9000, "hello", "robot1", "table1", "../../etc/passwd", "a.json",
    "synchronous/01", "workshop/02@16", "@", "null", "NaN", "__class__", "{0}", "%s%n", "type",
    "~exists", "move", "-1", "1e999", "<script>", "\x1b[2J", "\\u0000", '"', "'; DROP TABLE",
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 15, 16, 17, 255, 256, 65_535, 65_536, 2**31 - 1, 2**31, -(2**31), 2**32, 2**53,
    2**53 + 1, 2**63 - 1, 2**63, -(2**63), 2**64 - 1, 2**64, 10**30, -(10**30), 10**400,
    0.0, -0.0, 0.5, 1.0, 5e-324, 1e-9, 1e308, float("inf"), float("-inf"), float("nan"),
)  # fmt: skip
PREFIXES = (
    b"\xc1", b"\xc7\x04\x01abcd", b"\xd6\xff\x00\x00\x00\x00", b"\xdd\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\x7f\xff\xff\xff",
    b"\xc9\xff\xff\xff\xff\x01",
    b"\x91" * 40, b"\x81\xa1a" * 40, b"\x82\xa4type\xa4list\xa4type\xa4list", b"\x81\x01\x02",
    b"\x81\xc4\x04type\xa4list", b"\x81\xa4type\xa2\xff\xfe", b"\x80", b"\x90", b"\xc0",
)  # fmt: skip
TEXTS = (
    '{"type":"say","text":"a\\u0000\\nb"}', '{"type":"note","topic":"\\r","text":"\\u0085"}',
    "", " ", "{", "}", "[", '"', "nul", "NaN", "-Infinity", "{}", "[]", "0", '{"type":"list"}x',
    '{"type":"list","type":"list"}', '{"type":"say","text":"\\ud800"}',
    '{"\\ud800":1,"type":"list"}',
    '{"type":"list","ref":1e400}', '{"type":"list","ref":-0}', '{"type":"list","ref":1.0}',
    "\ufeff{}", '{"type":"list"}\x00', "{'type':'list'}", '{"type":"list",}',
    "[" * 300 + "]" * 300,
    '{"type":"act","seq":1,"action":1' + "0" * 4400 + "}", "//", '{"a":' * 39 + "1" + "}" * 39,
)  # fmt: skip


class Adversary:
    """Generator of hostile input; the same seed produces the same input."""

    def __init__(self, seed: int | random.Random) -> None:
        self.random = seed if isinstance(seed, random.Random) else random.Random(seed)

    def value(self, depth: int = 3) -> Any:
        """Return any value of JSON or MessagePack, including invalid ones."""
        pick = self.random.random()
        if pick < 0.25:
            return self.random.choice(STRINGS)
        if pick < 0.5:
            return self.random.choice(NUMBERS)
        if pick < 0.6:
            return self.random.choice((None, True, False))
        if pick < 0.65:
            return self.random.randbytes(self.random.randrange(6))
        if pick < 0.67:
            return self.nested(self.random.choice((5, 15, 16, 17, 39, 41, 300)))
        if pick < 0.7:
            return [0] * self.random.choice((65, 1000))
        if depth == 0:
            return self.random.randrange(-3, 30)
        size = self.random.randrange(4)
        if pick < 0.85:
            return [self.value(depth - 1) for _ in range(size)]
        return {self.random.choice(STRINGS): self.value(depth - 1) for _ in range(size)}

    def nested(self, depth: int) -> Any:
        """Return a value inside `depth` lists or objects."""
        value: Any = 1
        objects = self.random.random() < 0.5
        for _ in range(depth):
            value = {"a": value} if objects else [value]
        return value

    def message(self, examples: Sequence[dict[str, Any]]) -> Any:
        """Return a valid message, mostly with spoilt fields, and sometimes any value."""
        if self.random.random() < 0.1:
            return self.value()
        message = dict(self.random.choice(examples))
        for _ in range(self.random.choice((0, 1, 1, 1, 2))):
            self._spoil(message, examples)
        return message

    def _spoil(self, message: dict[str, Any], examples: Sequence[dict[str, Any]]) -> None:
        pick = self.random.random()
        if not message or pick < 0.15:
            message[self.random.choice(STRINGS)] = self.value()
        elif pick < 0.3:
            message.pop(self.random.choice(list(message)))
        elif pick < 0.5:
            key, value = self.random.choice(list(self.random.choice(examples).items()))
            message[key] = value
        else:
            key = self.random.choice(list(message))
            message[key] = self.inside(message[key]) if self.random.random() < 0.5 else self.value()

    def inside(self, value: Any) -> Any:
        """Return a nested value in which one inner value is replaced."""
        if isinstance(value, dict) and value:
            key = self.random.choice(list(value))
            return {**value, key: self.inside(value[key])}
        if isinstance(value, list) and value:
            place = self.random.randrange(len(value))
            return [*value[:place], self.inside(value[place]), *value[place + 1 :]]
        return self.value(1)

    # Encodings

    def json_text(self, value: Any) -> str:
        """Return a value as JSON text for a WebSocket, sometimes damaged."""
        if self.random.random() < 0.08:
            return self.random.choice(TEXTS)
        text = json.dumps(value, default=repr, separators=(",", ":"))
        if self.random.random() < 0.15:
            text = self.damaged(text.encode()).decode(errors="replace")
        return text

    def packed(self, value: Any) -> bytes:
        """Return a value as MessagePack, sometimes damaged; unsupported types become extensions."""
        if self.random.random() < 0.08:
            return self.random.choice(PREFIXES) * self.random.choice((1, 1, 50))
        content: bytes = msgpack.packb(
            value, default=lambda _: msgpack.ExtType(5, b"?"), unicode_errors="surrogatepass"
        )
        return self.damaged(content) if self.random.random() < 0.15 else content

    # Bytes

    def damaged(self, content: bytes, other: bytes = b"") -> bytes:
        """Return bytes with parts flipped, cut out, doubled, inserted or copied from `other`."""
        data = bytearray(content)
        for _ in range(self.random.choice((1, 1, 2, 5))):
            self.random.choice(self._damages())(data, other or content)
        return bytes(data)

    def _damages(self) -> tuple[Callable[[bytearray, bytes], None], ...]:
        return (self._flip, self._cut, self._insert, self._splice, self._number, self._truncate)

    def _place(self, data: bytearray) -> int:
        return self.random.randrange(len(data) + 1)

    def _flip(self, data: bytearray, _: bytes) -> None:
        if data:
            data[self.random.randrange(len(data))] ^= 1 << self.random.randrange(8)

    def _cut(self, data: bytearray, _: bytes) -> None:
        start = self._place(data)
        del data[start : start + self.random.choice((1, 2, 8, 100))]

    def _insert(self, data: bytearray, _: bytes) -> None:
        start = self._place(data)
        data[start:start] = self.random.randbytes(self.random.choice((1, 2, 4, 30)))

    def _splice(self, data: bytearray, other: bytes) -> None:
        start, source = self._place(data), self.random.randrange(len(other) + 1)
        data[start:start] = other[source : source + self.random.choice((4, 40, 400))]

    def _number(self, data: bytearray, _: bytes) -> None:
        start = self._place(data)
        value = self.random.choice((0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 16 * 1024 * 1024, 0x80000000))
        data[start : start + 4] = struct.pack("<I" if self.random.random() < 0.5 else ">I", value)

    def _truncate(self, data: bytearray, _: bytes) -> None:
        del data[self._place(data) :]
