"""Properties of PUBLISH packets, compared with paho's reading of them."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from paho.mqtt._packet import decode_publish
from paho.mqtt.enums import MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from robotouille_server.mqtt.messages import MAX_PROPERTY_BYTES
from robotouille_server.mqtt.packets import PacketError, packet_id, without_unused_properties
from tests.mqtt.lying import text

words = st.text(st.characters(codec="utf-8", exclude_characters="\0\ufeff"), max_size=20)
VALUES = {
    "PayloadFormatIndicator": st.integers(0, 1),
    "MessageExpiryInterval": st.integers(0, 2**32 - 1),
    "ContentType": words,
    "ResponseTopic": st.text("abc/", max_size=20),
    "CorrelationData": st.binary(max_size=20),
    "SubscriptionIdentifier": st.integers(1, 268_435_455),
    "TopicAlias": st.integers(1, 65_535),
    "UserProperty": st.tuples(words, words),
}
properties = st.fixed_dictionaries({}, optional=VALUES)


def body_of(section: bytes, qos: int, payload: bytes) -> bytes:
    return text("commands") + (b"\1\2" if qos else b"") + section + payload


@given(properties, st.integers(0, 1), st.binary(max_size=50))
def test_response_topic_and_correlation_data_are_kept(
    values: dict[str, object], qos: int, payload: bytes
) -> None:
    given = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
    for name, value in values.items():
        setattr(given, name, value)
    first = 0x30 | qos << 1
    body = body_of(given.pack(), qos, payload)  # type: ignore[no-untyped-call]
    read = decode_publish(first, without_unused_properties(first, body), MQTTProtocolVersion.MQTTv5)
    expected = {
        name: value.hex() if isinstance(value, bytes) else value
        for name, value in values.items()
        if name in ("ResponseTopic", "CorrelationData")
    }
    assert read.properties is not None
    assert read.properties.json() == expected  # type: ignore[no-untyped-call]
    assert (read.topic, read.payload) == (b"commands", payload)
    assert packet_id(first, body) == read.mid == (0x0102 if qos else 0)


@given(st.binary(max_size=60), st.integers(0, 1))
def test_any_bytes_are_read_or_refused(body: bytes, qos: int) -> None:
    for read in (packet_id, without_unused_properties):
        with suppress(PacketError):
            read(0x30 | qos << 1, body)


def test_long_properties_are_refused() -> None:
    count = MAX_PROPERTY_BYTES // 5
    for more, refused in ((0, False), (1, True)):
        section = b"\x26\0\0\0\0" * (count + more)
        length = bytes([len(section) & 127 | 128, len(section) >> 7])
        body = body_of(length + section, 0, b"{}")
        if refused:
            with pytest.raises(PacketError, match=r"2,050 bytes of properties"):
                without_unused_properties(0x30, body)
        else:
            assert without_unused_properties(0x30, body) == body_of(b"\0", 0, b"{}")
