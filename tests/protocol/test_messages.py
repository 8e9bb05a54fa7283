"""Messages: enumerations, nested objects and the seats that `join` may request."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError
from tools.message_examples import EXAMPLES

from robotouille.episode import Absence, Clock, Controller, PauseReason, Phase, Reason
from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.error_codes import ErrorCode
from robotouille.world.unmet import Unmet, UnmetKind
from tests.support.fuzzing.codes import documented_codes

SENT = [str(model.model_fields["type"].default) for model in messages.SERVER_MESSAGES]


def received(codec: Codec, **plain: Any) -> Any:
    return codec.decode_server(codec.pack(plain))


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
@pytest.mark.parametrize("kind", SENT)
def test_decoded_messages_encode_unchanged(codec: Codec, kind: str) -> None:
    example = EXAMPLES[kind]
    message = codec.decode_server(codec.pack(example))
    again = codec.decode_server(codec.encode(message))
    assert again == message
    plain = message.model_dump(mode="json", exclude_unset=True)
    assert plain == example


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
def test_known_values_become_enumeration_members(codec: Codec) -> None:
    snapshot = received(codec, **EXAMPLES["snapshot"])
    assert type(snapshot.phase) is Phase
    assert type(snapshot.clock["clock"]) is Clock
    assert type(snapshot.clock["absence"]) is Absence
    assert type(snapshot.seats[0].controller) is Controller
    assert type(received(codec, **EXAMPLES["ended"]).outcome["reason"]) is Reason
    assert type(received(codec, **EXAMPLES["error"]).code) is ErrorCode
    roster = {**EXAMPLES["roster"], "phase": "paused", "pause": {"reason": "absence"}}
    message = received(codec, **roster)
    assert (message.phase, message.pause.reason) == (Phase.PAUSED, PauseReason.ABSENCE)
    assert type(message.pause.reason) is PauseReason


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
def test_unknown_values_stay_strings(codec: Codec) -> None:
    roster = {**EXAMPLES["roster"], "phase": "rehearsed", "pause": {"reason": "fire"}}
    roster["seats"] = [{"player": "robot1", "controller": "ghost"}]
    message = received(codec, **roster)
    found = (message.phase, message.pause.reason, message.seats[0].controller)
    assert found == ("rehearsed", "fire", "ghost")
    assert received(codec, **{**EXAMPLES["error"], "code": "kitchen/fire"}).code == "kitchen/fire"
    assert codec.decode_server(codec.encode(message)) == message


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
def test_rules_and_outcomes_keep_unknown_fields(codec: Codec) -> None:
    rules = {**EXAMPLES["snapshot"]["clock"], "clock": "sundial", "weather": [1, {"rain": True}]}
    snapshot = received(codec, **{**EXAMPLES["snapshot"], "clock": rules})
    assert snapshot.clock == rules
    outcome = {**EXAMPLES["ended"]["outcome"], "reason": "bored", "applause": 3}
    assert received(codec, **{**EXAMPLES["ended"], "outcome": outcome}).outcome == outcome


@pytest.mark.parametrize(
    ("field", "value"), [("clock", "sundial"), ("absence", "vanish"), ("timing", "soon")]
)
def test_unknown_values_from_a_client_are_refused(field: str, value: str) -> None:
    with pytest.raises(ValidationError, match="Input should be"):
        messages.client_messages.validate_python({"type": "create", field: value})


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


def test_documented_codes_are_the_codes_of_the_protocol() -> None:
    assert {code.value for code in ErrorCode} == documented_codes()
