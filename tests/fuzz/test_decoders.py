"""Any bytes decode to a message, or to an error with a documented code whose reply can be sent."""

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
from tests.support.fuzzing.adversary import Adversary
from tests.support.fuzzing.hostile_inputs import HOSTILE_INPUTS
from tests.support.fuzzing.specimens import MESSAGE_KINDS
from tests.support.fuzzing.targets import message_targets
from tests.support.thorough import thorough

TARGETS = message_targets()
kinds = pytest.mark.parametrize("kind", MESSAGE_KINDS)


@kinds
@thorough(300)
@given(data=st.binary(max_size=300))
def test_any_bytes_are_decoded_or_refused(kind: str, data: bytes) -> None:
    TARGETS[kind](data)


@kinds
@thorough(500)
@given(chance=st.randoms())
def test_faulty_messages_are_decoded_or_refused(kind: str, chance: random.Random) -> None:
    TARGETS[kind](HOSTILE_INPUTS[kind](Adversary(chance)))


@kinds
def test_hostile_inputs_trigger_every_error(kind: str) -> None:
    adversary = Adversary(1)
    met = Counter(TARGETS[kind](HOSTILE_INPUTS[kind](adversary)) for _ in range(3000))
    wrong = ["unknown-type", "missing-field", "invalid-field", "malformed"]
    if kind.startswith("client"):  # Clients ignore unknown fields of newer servers.
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
def test_invalid_number_is_named_in_the_error(text: str, field: str) -> None:
    """Languages disagree on integers above 2^53, and booleans are not numbers."""
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
        assert refused.value.ref is None
