"""Base classes and nested objects of messages, and the seats that `join` may request."""

from __future__ import annotations

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.world.unmet import Unmet, UnmetKind

CODECS = pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=repr)


def test_a_reason_survives_the_round_trip() -> None:
    unmet = Unmet(UnmetKind.TURN, "it is robot2's turn", objects=("robot2",))
    assert messages.Why.of(unmet).value("it is robot2's turn") == unmet


@CODECS
@pytest.mark.parametrize("seats", ["all", ["robot2"], ["robot2", "robot1"], []], ids=str)
def test_join_accepts_several_seats(codec: Codec, seats: object) -> None:
    join = messages.Join.model_validate({"episode": "x", "seats": seats})
    assert codec.decode_client(codec.encode(join)) == join


@CODECS
@pytest.mark.parametrize(
    "fields",
    [
        {"seats": ["robot1", "robot1"]},
        {"seats": ["robot1"], "seat": "robot2"},
        {"seats": "all", "role": "spectator"},
        {"seats": [f"robot{n}" for n in range(17)]},
        {"seats": "some"},
        {"seats": [""]},
        {"seats": [["robot1"]]},
        {"seats": 2},
        {"seats": None},
    ],
    ids=str,
)
def test_invalid_seats_are_refused_with_the_field_name(
    codec: Codec, fields: dict[str, object]
) -> None:
    plain = {"type": "join", "episode": "x", **fields}
    with pytest.raises(ProtocolError) as caught:
        codec.decode_client(codec.pack(plain))
    assert (caught.value.code, caught.value.field) == ("message/invalid-field", "seats")


def test_clients_with_one_seat_omit_the_newer_fields() -> None:
    """Earlier servers refuse fields that they do not know."""
    assert JSON.encode(messages.Join(episode="x")) == '{"type":"join","episode":"x"}'
    act = messages.Act(seq=1, action=None)
    assert JSON.encode(act) == '{"type":"act","seq":1,"action":null}'
