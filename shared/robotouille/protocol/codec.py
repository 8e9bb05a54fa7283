"""Codecs of the two subprotocols: messages to bytes and back.

Decoding limits sizes and nesting before it builds values. Every fault becomes a ProtocolError with
a stable code and the name of the field.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import msgpack
from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, SchemaValidator

from robotouille.domain.fast_failing import fast_failing, has_more_values
from robotouille.errors import FileError, ProtocolError
from robotouille.protocol.messages import (
    Act,
    ClientMessage,
    ServerMessage,
    client_messages,
    server_messages,
)

MAX_CLIENT_BYTES = 64 * 1024
MAX_SERVER_BYTES = 8 * 1024 * 1024
MAX_SERVER_ITEMS = 1_000_000
"""Values in a server's message. The largest snapshot has about 200,000."""
MAX_DEPTH = 16
MAX_FIELDS = 32
"""Fields of a client's message, and of each object in it."""
MAX_ITEMS = 256
"""Values in a client's message at any depth."""
MAX_LIST = 128
"""Values that a list in it may announce. The decoder reserves memory before it reads them."""


T = TypeVar("T")

_pack = msgpack.Packer(autoreset=True).pack
_validate_act = TypeAdapter(Act).validator.validate_python


@dataclass(frozen=True, slots=True)
class Fields:
    """Some encoded fields of a message, without the enclosing object; `count` is their number."""

    packed: bytes | str
    count: int


class Codec:
    """Encoding of the protocol's messages. `text`: messages are sent in text frames."""

    def __init__(self, name: str, text: bool) -> None:
        self.name = name
        self.text = text

    def __repr__(self) -> str:
        return f"<Codec {self.name}>"

    def encode(self, message: BaseModel) -> bytes | str:
        """Encode a message as a frame's payload. Fields at their defaults are omitted."""
        # Most fields are at their defaults. Omitting them keeps a usual delta at about a hundred
        # bytes.
        plain = message.model_dump(mode="json", exclude_defaults=True)
        plain = {"type": message.type, **plain}  # type: ignore[attr-defined]
        return self.pack(plain)

    def pack(self, plain: dict[str, Any]) -> bytes | str:
        """Encode plain values as a frame's payload.

        Raises:
            ValueError: JSON cannot encode a value that is NaN or infinite.
        """
        if self.text:
            return json.dumps(plain, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        packed: bytes = _pack(plain)
        return packed

    def pack_fields(self, plain: dict[str, Any]) -> Fields:
        """Encode at least one field of a message, to be joined with others."""
        packed = self.pack(plain)
        if isinstance(packed, str):
            return Fields(packed[1:-1], len(plain))
        return Fields(packed[1 if len(plain) < 16 else 3 :], len(plain))

    def join(self, parts: Sequence[Fields]) -> bytes | str:
        """Join encoded fields to the payload that `pack` would make of all of them.

        Parts that are the same for all recipients of a message are then encoded once.
        """
        if self.text:
            return "{" + ",".join(str(part.packed) for part in parts) + "}"
        count = sum(part.count for part in parts)
        head = bytes([0x80 | count]) if count < 16 else b"\xde" + count.to_bytes(2, "big")
        return head + b"".join([bytes(part.packed) for part in parts])  # type: ignore[arg-type]

    def decode_client(self, payload: bytes | str) -> ClientMessage:
        """Decode a client's message.

        Raises:
            ProtocolError: `message/...`: wrong frame type, more than `MAX_CLIENT_BYTES`, unknown
                type or field, or invalid value.
        """
        plain = self._unpack(payload, MAX_CLIENT_BYTES)
        # Nearly all messages are actions in MessagePack, whose decoder limits the values.
        if not self.text and isinstance(plain, dict) and plain.get("type") == "act":
            try:
                act: Act = _validate_act(plain)
                return act
            except ValidationError:
                pass  # The whole validation below finds the error that is reported.
        _check_items(plain)
        message: ClientMessage = self._validate(plain, client_messages)
        return message

    def decode_server(self, payload: bytes | str) -> ServerMessage:
        """Decode a server's message. Unknown fields, from a newer server, are ignored.

        Raises:
            ProtocolError: `message/...`, as for a client's message; at most `MAX_SERVER_BYTES`.
        """
        plain = self.unpack_server(payload)
        if self.text and len(payload) > MAX_CLIENT_BYTES:
            # MessagePack limits the names of objects while it decodes.
            try:
                has_more_values(plain, MAX_SERVER_ITEMS)
            except ValueError as error:
                raise ProtocolError("message/malformed", str(error)) from None
        message: ServerMessage = self._validate(plain, _quick_server_messages())
        return message

    def unpack_server(self, payload: bytes | str) -> Any:
        """Decode a server's message to plain values within its limits, without checking them.

        Raises:
            ProtocolError: `message/...`.
        """
        return self._unpack(payload, MAX_SERVER_BYTES)

    def _validate(self, plain: Any, adapter: TypeAdapter[Any] | SchemaValidator) -> Any:
        if not isinstance(plain, dict):
            found = type(plain).__name__
            raise ProtocolError("message/malformed", f"expected an object, found {found}")
        # `parse_json` has checked the depth of JSON already.
        if not self.text:
            _check_depth(plain)
        return validated(plain, adapter)

    def _unpack(self, payload: bytes | str, limit: int) -> Any:
        if isinstance(payload, str) != self.text:
            expected, found = ("text", "binary") if self.text else ("binary", "text")
            message = f"{self.name} uses {expected} frames, found a {found} frame"
            raise ProtocolError("message/frame", message)
        # In bytes for both codecs, so that the limits and the quotas are the same for both.
        size = len(payload.encode()) if isinstance(payload, str) else len(payload)
        if size > limit:
            message = f"{size:,} bytes; the limit is {limit:,}"
            raise ProtocolError("message/too-large", message)
        if isinstance(payload, str):
            # Each value but the first needs a comma or a bracket of its own.
            if sum(map(payload.count, ",[{")) > MAX_SERVER_ITEMS:
                raise _too_many(MAX_SERVER_ITEMS)
            return _unpack_json(payload)
        return _unpack_msgpack(payload, limit)


def read_object(payload: str) -> dict[str, Any]:
    """Decode a JSON object from outside, within the limits of a client's message.

    Raises:
        ProtocolError: `message/malformed`.
    """
    plain = _unpack_json(payload)
    if not isinstance(plain, dict):
        found = type(plain).__name__
        raise ProtocolError("message/malformed", f"expected an object, found {found}")
    _check_items(plain)
    return plain


@cache
def _quick_server_messages() -> SchemaValidator:
    # Built late, because servers do not need it.
    return fast_failing(server_messages.core_schema)


def validated(plain: dict[str, Any], adapter: TypeAdapter[T] | SchemaValidator) -> T:
    """Return the message with these plain values.

    Raises:
        ProtocolError: `message/...`, with the message's `ref` if it has one.
    """
    try:
        message: T = adapter.validate_python(plain)
        return message
    except ValidationError as error:
        # No local variable holds the error, because an error in a frame of its own traceback is a
        # reference cycle.
        raise _refused(error, plain) from None


def _unpack_json(payload: str) -> Any:
    from robotouille.domain.json_files import parse_json

    try:
        return parse_json(payload, "message")
    except FileError as error:
        raise ProtocolError("message/malformed", error.faults[0].message) from None


def _too_many(limit: int) -> ProtocolError:
    return ProtocolError("message/malformed", f"more than {limit:,} values in one message")


class _Tally:
    """Count of the values in a long message while it is decoded, as a hook of MessagePack."""

    def __init__(self) -> None:
        self._count = 0

    def add(self, inner: T) -> T:
        self._count += 1 + len(inner)  # type: ignore[arg-type]
        if self._count > MAX_SERVER_ITEMS:
            raise _too_many(MAX_SERVER_ITEMS)
        return inner


def _unpack_msgpack(payload: bytes, limit: int) -> Any:
    # A value needs at least a byte, so shorter messages need no count.
    hook = _Tally().add if len(payload) > MAX_SERVER_ITEMS else None
    try:
        plain = msgpack.unpackb(
            payload,
            strict_map_key=True,
            max_str_len=limit,
            max_bin_len=0,
            max_ext_len=0,
            max_array_len=MAX_LIST if limit == MAX_CLIENT_BYTES else MAX_SERVER_ITEMS,
            max_map_len=MAX_FIELDS if limit == MAX_CLIENT_BYTES else 10_000,
            list_hook=hook,
            object_hook=hook,
        )
    except RecursionError:
        raise ProtocolError("message/malformed", "nested too deeply") from None
    except (ValueError, TypeError, msgpack.UnpackException, UnicodeDecodeError) as error:
        reason = str(error) or type(error).__name__
        raise ProtocolError("message/malformed", f"not MessagePack: {reason}") from None
    return plain


def _check_items(value: Any) -> None:
    # This is checked before validation, which would build an error for every invalid value.
    waiting, found = [value], 0
    while waiting:
        inner = waiting.pop()
        if isinstance(inner, dict):
            if len(inner) > MAX_FIELDS:
                message = f"{len(inner):,} fields in one object; the limit is {MAX_FIELDS}"
                raise ProtocolError("message/malformed", message)
            inner = inner.values()
        elif not isinstance(inner, list):
            continue
        found += len(inner)
        if found > MAX_ITEMS:
            raise _too_many(MAX_ITEMS)
        waiting.extend(inner)


def _check_depth(value: Any) -> None:
    level = [value]
    for _ in range(MAX_DEPTH):
        inner: list[Any] = []
        for item in level:
            if isinstance(item, dict):
                inner.extend(item.values())
            elif isinstance(item, list):
                inner.extend(item)
        if not inner:
            return
        level = inner
    raise ProtocolError("message/malformed", f"nested more than {MAX_DEPTH} levels deep")


def _refused(error: ValidationError, plain: dict[Any, Any]) -> ProtocolError:
    ref = plain.get("ref")
    refused = _fault(error, plain)
    refused.ref = ref if type(ref) is int and 0 <= ref < 2**31 else None
    return refused


def _fault(error: ValidationError, plain: dict[Any, Any]) -> ProtocolError:
    first = _nearest(error.errors(include_url=False, include_input=False, include_context=False))
    # For a field of several types, pydantic adds the type of the failed alternative. Types that
    # only have limits are called `constrained-...`, which means nothing to a reader.
    location = [str(part) for part in first["loc"] if not str(part).startswith("constrained-")]
    if first["type"] in ("union_tag_invalid", "union_tag_not_found"):
        found = str(plain.get("type"))[:40]
        return ProtocolError("message/unknown-type", f"no message type {found!r}", "type")
    field = ".".join(location[1:]) or "type"
    if first["type"] == "extra_forbidden":
        return ProtocolError("message/unknown-field", "unknown field", field)
    if first["type"] == "missing":
        return ProtocolError("message/missing-field", "this field is required", field)
    return ProtocolError("message/invalid-field", first["msg"], field)


def _nearest(errors: list[ErrorDetails]) -> ErrorDetails:
    """Return the first error, or for a value of several types that of the type it has."""
    field = errors[0]["loc"][:2]
    of_its_type = (e for e in errors if e["loc"][:2] == field and not e["type"].endswith("_type"))
    return next(of_its_type, errors[0])


MSGPACK = Codec("robotouille.v1.msgpack", text=False)
JSON = Codec("robotouille.v1.json", text=True)
SUBPROTOCOLS = (MSGPACK.name, JSON.name)


def codec_for(subprotocol: str | None) -> Codec:
    """Return the codec of a negotiated subprotocol; JSON if the client asked for none."""
    return MSGPACK if subprotocol == MSGPACK.name else JSON
