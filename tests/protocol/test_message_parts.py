"""What messages are made of: who writes which part, and which of several seats one may ask for."""

from __future__ import annotations

import pytest

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.message_parts import FromServer, Message
from robotouille.world.unmet import Unmet, UnmetKind

CODECS = pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=repr)


def test_what_a_newer_server_says_is_left_out_and_what_a_client_says_is_refused() -> None:
    for message in messages.CLIENT_MESSAGES:
        assert message.model_config["extra"] == "forbid"
    for message in messages.SERVER_MESSAGES:
        assert issubclass(message, FromServer)
        assert message.model_config["extra"] == "ignore"
    assert issubclass(messages.Seen, Message)
    assert issubclass(messages.SeatAnswer, FromServer)


def test_a_reason_comes_back_as_it_was() -> None:
    unmet = Unmet(UnmetKind.TURN, "it is robot2's turn", objects=("robot2",))
    assert messages.Why.of(unmet).value("it is robot2's turn") == unmet


def test_an_answer_of_a_seat_has_what_a_snapshot_has_of_the_first() -> None:
    answer = messages.SeatAnswer(seat="robot2")
    assert (answer.seq, answer.step, answer.reasons) == (0, 0, [])


@CODECS
@pytest.mark.parametrize("seats", ["all", ["robot2"], ["robot2", "robot1"], []], ids=str)
def test_several_seats_can_be_asked_for(codec: Codec, seats: object) -> None:
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
def test_what_asks_for_seats_that_cannot_be_names_that_field(
    codec: Codec, fields: dict[str, object]
) -> None:
    plain = {"type": "join", "episode": "x", **fields}
    with pytest.raises(ProtocolError) as caught:
        codec.decode_client(codec.pack(plain))
    assert (caught.value.code, caught.value.field) == ("message/invalid-field", "seats")


def test_whoever_has_one_seat_says_what_earlier_versions_said() -> None:
    """A server of before would refuse a field that it does not know."""
    assert JSON.encode(messages.Join(episode="x")) == '{"type":"join","episode":"x"}'
    act = messages.Act(seq=1, action=None)
    assert JSON.encode(act) == '{"type":"act","seq":1,"action":null}'
