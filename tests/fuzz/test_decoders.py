"""Whatever bytes come, a message comes out of them or an error with a documented code, and the
answer can be sent."""

from __future__ import annotations

import json
import random
from collections import Counter

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import ProtocolError
from robotouille.protocol.codec import JSON, MSGPACK
from tests.support.fuzzing.hostility import Adversary
from tests.support.fuzzing.offerings import OFFERINGS
from tests.support.fuzzing.specimens import MESSAGE_KINDS, client_messages, server_messages
from tests.support.fuzzing.targets import message_targets
from tests.support.thorough import thorough

TARGETS = message_targets()
kinds = pytest.mark.parametrize("kind", MESSAGE_KINDS)


@kinds
def test_valid_messages_are_read(kind: str) -> None:
    for message in client_messages() if kind.startswith("client") else server_messages():
        text = kind.endswith("json")
        payload = json.dumps(message).encode() if text else msgpack.packb(message)
        assert TARGETS[kind](payload) == "read", message


@kinds
@thorough(300)
@given(data=st.binary(max_size=300))
def test_any_bytes(kind: str, data: bytes) -> None:
    TARGETS[kind](data)


@kinds
@thorough(500)
@given(chance=st.randoms())
def test_messages_with_something_wrong(kind: str, chance: random.Random) -> None:
    TARGETS[kind](OFFERINGS[kind](Adversary(chance)))


@kinds
def test_what_is_offered_meets_every_refusal(kind: str) -> None:
    adversary = Adversary(1)
    met = Counter(TARGETS[kind](OFFERINGS[kind](adversary)) for _ in range(3000))
    wrong = ["unknown-type", "missing-field", "invalid-field", "malformed"]
    if kind.startswith("client"):  # What a newer server sends besides is left out.
        wrong.append("unknown-field")
    assert met.keys() >= {"read", *(f"message/{word}" for word in wrong)}, met


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ('{"type":"list","ref":true}', "ref"),
        ('{"type":"act","seq":true,"action":null}', "seq"),
        ('{"type":"act","seq":1.0,"action":null}', "seq"),
        ('{"type":"act","seq":1,"action":null,"basis":1e400}', "basis"),
        ('{"type":"act","seq":1,"action":' + "9" * 4000 + "}", "action"),
        ('{"type":"act","seq":1,"action":null,"basis":' + "9" * 4000 + "}", "basis"),
        ('{"type":"create","step_rate":1e400}', "step_rate"),
        ('{"type":"create","seed":-1}', "seed"),
    ],
)
def test_numbers_that_are_none_are_named(text: str, field: str) -> None:
    """Above 2^53 no two languages agree on a number; a truth value is none."""
    plain = json.loads(text)
    for codec in (JSON, MSGPACK):
        try:
            payload = text if codec is JSON else msgpack.packb(plain)
        except OverflowError:
            continue
        with pytest.raises(ProtocolError) as refused:
            codec.decode_client(payload)
        assert refused.value.code == "message/invalid-field"
        assert refused.value.field.startswith(field)


def test_a_truth_value_as_reference_is_not_repeated() -> None:
    with pytest.raises(ProtocolError) as refused:
        JSON.decode_client('{"type":"list","ref":true}')
    assert refused.value.ref is None
