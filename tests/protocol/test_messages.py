"""What messages hold: enumerations, read strictly from clients and leniently from servers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from robotouille.episode import Absence, Clock, Controller, PauseReason, Phase, Reason
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK, Codec
from robotouille.protocol.error_codes import ErrorCode

EXAMPLES = {
    kind: entry["example"]
    for kind, entry in json.loads(
        (Path(__file__).parents[2] / "docs/messages.json").read_text("utf-8")
    )["messages"].items()
}
SENT = [str(model.model_fields["type"].default) for model in messages.SERVER_MESSAGES]


def received(codec: Codec, **plain: Any) -> Any:
    return codec.decode_server(codec.pack(plain))


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
@pytest.mark.parametrize("kind", SENT)
def test_what_was_decoded_is_encoded_as_it_was(codec: Codec, kind: str) -> None:
    example = EXAMPLES[kind]
    message = codec.decode_server(codec.pack(example))
    again = codec.decode_server(codec.encode(message))
    assert again == message
    plain = message.model_dump(mode="json", exclude_unset=True)
    assert plain == example


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
def test_values_that_are_known_are_members(codec: Codec) -> None:
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
def test_values_of_a_newer_server_stay_as_they_came(codec: Codec) -> None:
    roster = {**EXAMPLES["roster"], "phase": "rehearsed", "pause": {"reason": "fire"}}
    roster["seats"] = [{"player": "robot1", "controller": "ghost"}]
    message = received(codec, **roster)
    found = (message.phase, message.pause.reason, message.seats[0].controller)
    assert found == ("rehearsed", "fire", "ghost")
    assert received(codec, **{**EXAMPLES["error"], "code": "kitchen/fire"}).code == "kitchen/fire"
    assert codec.decode_server(codec.encode(message)) == message


@pytest.mark.parametrize("codec", [JSON, MSGPACK])
def test_the_rules_and_the_outcome_of_a_newer_server_may_hold_more(codec: Codec) -> None:
    rules = {**EXAMPLES["snapshot"]["clock"], "clock": "sundial", "weather": [1, {"rain": True}]}
    snapshot = received(codec, **{**EXAMPLES["snapshot"], "clock": rules})
    assert snapshot.clock == rules
    outcome = {**EXAMPLES["ended"]["outcome"], "reason": "bored", "applause": 3}
    assert received(codec, **{**EXAMPLES["ended"], "outcome": outcome}).outcome == outcome


def test_what_is_no_text_is_not_taken_for_a_value() -> None:
    with pytest.raises(ValidationError):
        messages.Roster.model_validate({**EXAMPLES["roster"], "phase": 3})


@pytest.mark.parametrize(
    ("field", "value"), [("clock", "sundial"), ("absence", "vanish"), ("timing", "soon")]
)
def test_a_client_may_only_say_what_is_known(field: str, value: str) -> None:
    with pytest.raises(ValidationError, match="Input should be"):
        messages.client_messages.validate_python({"type": "create", field: value})


def test_a_member_goes_over_the_wire_as_its_value() -> None:
    pause = messages.Pause(reason=PauseReason.OPERATOR)
    roster = messages.Roster(phase=Phase.PAUSED, pause=pause, seats=[])
    plain = '{"type":"roster","phase":"paused","pause":{"reason":"operator"},"seats":[]}'
    assert JSON.encode(roster) == plain
    rejected = messages.Rejected(seq=1, step=2, action="a", reasons=[], code=ErrorCode.ACTION_STALE)
    assert json.loads(JSON.encode(rejected))["code"] == "action/stale"
