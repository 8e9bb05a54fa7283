"""PUBLISH packets of MQTT 5: their size, and properties that clients choose."""

from __future__ import annotations

from paho.mqtt.properties import VariableByteIntegers

from robotouille.errors import RobotouilleError
from robotouille_server.mqtt.messages import MAX_PROPERTY_BYTES

QOS_BITS = 0x06
RESPONSE_TOPIC, CORRELATION_DATA = 0x08, 0x09
_VARIABLE_BYTE_INTEGER = 0x0B
_FIXED_SIZES = {0x01: 1, 0x02: 4, 0x23: 2}
_STRINGS = {0x03: 1, RESPONSE_TOPIC: 1, CORRELATION_DATA: 1, 0x26: 2}
"""Number of strings in each of these properties. 0x26 is a user property: a name and a value."""

_PUBLISH_HEAD_BYTES = 1 + 4 + 2 + 2 + 2
"""First byte, identifier, and the longest encodings of the lengths of packet, topic and properties.
The properties have 259 bytes at most."""


class PacketError(RobotouilleError):
    """Packet that is invalid, or has too many properties."""


def publish_bytes(topic: str, payload: bytes, correlation: bytes | None = None) -> int:
    """Return the size of a PUBLISH packet, or up to six bytes more."""
    properties = 0 if correlation is None else len(correlation) + 3
    return _PUBLISH_HEAD_BYTES + len(topic.encode()) + properties + len(payload)


def packet_id(first: int, body: bytes | bytearray) -> int:
    """Return the identifier of a PUBLISH packet, or 0 for QoS 0.

    Args:
        first: The packet's first byte.
        body: The packet without its first byte and length.

    Raises:
        PacketError: The packet is invalid.
    """
    return _integer(body, 2 + _integer(body, 0)) if first & QOS_BITS else 0


def without_unused_properties(first: int, body: bytes | bytearray) -> bytearray:
    """Return the body of a PUBLISH packet with the response topic and correlation data only.

    paho parses properties in quadratic time: 10,000 empty ones take a second. This takes 2 ms at
    most.

    Args:
        first: The packet's first byte.
        body: The packet without its first byte and length.

    Raises:
        PacketError: The packet is invalid or its properties are longer than `MAX_PROPERTY_BYTES`.
    """
    start = 2 + _integer(body, 0) + (2 if first & QOS_BITS else 0)
    length, size = _variable_byte_integer(body, start)
    if length > MAX_PROPERTY_BYTES:
        raise PacketError(f"{length:,} bytes of properties")
    at, end = start + size, start + size + length
    if end > len(body):
        raise PacketError("the properties exceed the packet")
    kept = bytearray()
    while at < end:
        following = _property_end(body, at)
        if body[at] in (RESPONSE_TOPIC, CORRELATION_DATA):
            kept += body[at:following]
        at = following
    if at != end:
        raise PacketError("the last property exceeds the properties")
    size_of_kept: bytes = VariableByteIntegers.encode(len(kept))  # type: ignore[no-untyped-call]
    return bytearray(body[:start]) + size_of_kept + kept + body[end:]


def _property_end(body: bytes | bytearray, at: int) -> int:
    kind, at = body[at], at + 1
    if kind == _VARIABLE_BYTE_INTEGER:
        return at + _variable_byte_integer(body, at)[1]
    if kind in _FIXED_SIZES:
        return at + _FIXED_SIZES[kind]
    if kind not in _STRINGS:
        raise PacketError(f"unknown property {kind}")
    for _ in range(_STRINGS[kind]):
        at += 2 + _integer(body, at)
    return at


def _integer(body: bytes | bytearray, at: int) -> int:
    if at + 2 > len(body):
        raise PacketError("the packet is too short")
    return int.from_bytes(body[at : at + 2], "big")


def _variable_byte_integer(body: bytes | bytearray, at: int) -> tuple[int, int]:
    """Return the value and its size."""
    value = 0
    for size, byte in enumerate(body[at : at + 4], 1):
        value |= (byte & 127) << 7 * (size - 1)
        if byte < 128:
            return value, size
    raise PacketError("invalid length")
