"""Codecs: encodings, limits, error codes, and no NaN or Infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any, get_args

import msgpack
import pytest
from pydantic import BaseModel, ValidationError
from tools.message_examples import EXAMPLES

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import (
    JSON,
    MAX_CLIENT_BYTES,
    MAX_DEPTH,
    MAX_FIELDS,
    MAX_ITEMS,
    MSGPACK,
    SUBPROTOCOLS,
    Codec,
    codec_for,
)
from robotouille.protocol.messages.values import MAX_REASON, MAX_REASONS
from robotouille_server import ServerSettings

CODECS = [JSON, MSGPACK]
HELLO: dict[str, Any] = {"type": "hello", "protocol": 1, "name": "ada"}


def fault(codec: Codec, payload: bytes | str) -> ProtocolError:
    with pytest.raises(ProtocolError) as error:
        codec.decode_client(payload)
    return error.value


def payload(codec: Codec, plain: Any) -> bytes | str:
    return json.dumps(plain) if codec.text else bytes(msgpack.packb(plain))


def test_subprotocol_selects_the_codec_and_json_is_the_default() -> None:
    assert [codec_for(name) for name in (*SUBPROTOCOLS, None)] == [MSGPACK, JSON, JSON]


@pytest.mark.parametrize("codec", CODECS)
def test_defaults_are_omitted(codec: Codec) -> None:
    message = messages.Hello(protocol=1, name="ada")
    assert codec.encode(message) == codec.pack(HELLO)
    assert codec.decode_client(codec.encode(message)) == message


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("count", [1, 15, 16, 40])
def test_separately_encoded_fields_join_to_one_message(codec: Codec, count: int) -> None:
    plain = {f"field{i}": [i, "ä", None] for i in range(count)}
    half = count // 2
    items = list(plain.items())
    parts = [codec.pack_fields(dict(part)) for part in (items[:half], items[half:]) if part]
    assert codec.join(parts) == codec.pack(plain)


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize(
    ("plain", "code", "field"),
    [
        ([], "message/malformed", ""),
        ({}, "message/unknown-type", "type"),
        ({"type": "sing"}, "message/unknown-type", "type"),
        ({**HELLO, "more": 1}, "message/unknown-field", "more"),
        ({"type": "hello", "protocol": 1}, "message/missing-field", "name"),
        ({**HELLO, "protocol": "1"}, "message/invalid-field", "protocol"),
        ({**HELLO, "seen": {"episode": "e", "step": -1}}, "message/invalid-field", "seen.step"),
        ({f"field{i}": i for i in range(MAX_FIELDS + 1)}, "message/malformed", ""),
        ({**HELLO, "name": [[1, 2]] * (MAX_ITEMS // 3)}, "message/malformed", ""),
    ],
)
def test_faults_have_a_code_and_a_field(codec: Codec, plain: Any, code: str, field: str) -> None:
    error = fault(codec, payload(codec, plain))
    assert (error.code, error.field) == (code, field)


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize(
    ("action", "field", "expected"),
    [
        ("x" * 2001, "action", "at most 2000 characters"),
        (-1, "action", "greater than or equal to 0"),
        ({"name": "move", "args": ["x"] * 17}, "action.NamedAction.args", "at most 16 items"),
        ({"name": "move", "args": ["x" * 65]}, "action.NamedAction.args.0", "at most 64"),
    ],
)
def test_invalid_action_is_refused_with_its_limit(
    codec: Codec, action: Any, field: str, expected: str
) -> None:
    error = fault(codec, payload(codec, {"type": "act", "seq": 1, "action": action}))
    assert (error.code, error.field) == ("message/invalid-field", field)
    assert expected in error.message


@pytest.mark.parametrize("codec", CODECS)
def test_error_repeats_the_ref_of_the_request(codec: Codec) -> None:
    plain = {"type": "list", "ref": 7, "more": 1}
    assert fault(codec, payload(codec, plain)).ref == 7
    assert fault(codec, payload(codec, {**plain, "ref": "7"})).ref is None


@pytest.mark.parametrize("codec", CODECS)
def test_sizes_frames_and_depth_are_limited(codec: Codec) -> None:
    large = "x" * (MAX_CLIENT_BYTES + 1)
    assert fault(codec, large if codec.text else large.encode()).code == "message/too-large"
    assert fault(codec, b"{}" if codec.text else "{}").code == "message/frame"
    deep: Any = 1
    for _ in range(MAX_DEPTH + 1):
        deep = [deep]
    assert fault(codec, payload(codec, {**HELLO, "name": deep})).code in (
        "message/malformed",
        "message/invalid-field",
    )


@pytest.mark.parametrize("codec", [MSGPACK, JSON])
def test_unknown_fields_of_a_newer_server_are_ignored(codec: Codec) -> None:
    seat = {"player": "robot1", "mood": "good"}
    plain = {"type": "roster", "phase": "running", "seats": [seat], "weather": {"rain": True}}
    read = codec.decode_server(codec.pack(plain))
    assert isinstance(read, messages.Roster)
    assert read.seats[0].player == "robot1"
    assert not hasattr(read, "weather")


ENDLESS = (math.inf, -math.inf, math.nan)


def holds_float(annotation: Any) -> bool:
    return annotation is float or any(map(holds_float, get_args(annotation)))


def floats(models: tuple[type[BaseModel], ...]) -> Iterator[tuple[type[BaseModel], str]]:
    """Yield the fields of these messages that can contain a float."""
    for model in models:
        for name, field in model.model_fields.items():
            if holds_float(field.annotation):
                yield model, name


SENT = [*floats((*messages.SERVER_MESSAGES, messages.Pause))]
TAKEN = [*floats(messages.CLIENT_MESSAGES)]


@pytest.mark.parametrize(("model", "name"), SENT)
@pytest.mark.parametrize("number", ENDLESS)
def test_server_messages_refuse_infinite_numbers(
    model: type[BaseModel], name: str, number: float
) -> None:
    kind = model.model_fields["type"].default if "type" in model.model_fields else ""
    example = EXAMPLES[kind] if kind else {"reason": "absence"}
    model.model_validate({**example, name: 0.5})
    with pytest.raises(ValidationError, match="finite"):
        model.model_validate({**example, name: number})


@pytest.mark.parametrize("number", ENDLESS)
def test_json_encoding_refuses_infinite_numbers(number: float) -> None:
    """Snapshots are packed from plain values without the models."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        JSON.pack({"type": "snapshot", "clock": {"step_rate": number}})


@pytest.mark.parametrize("name", [name for _, name in TAKEN])
@pytest.mark.parametrize("number", ENDLESS)
def test_msgpack_decoding_refuses_infinite_numbers(name: str, number: float) -> None:
    with pytest.raises(ProtocolError) as caught:
        MSGPACK.decode_client(msgpack.packb({"type": "create", name: number}))
    assert (caught.value.code, caught.value.field) == ("message/invalid-field", name)


@pytest.mark.parametrize(
    "name",
    [name for name, field in ServerSettings.model_fields.items() if holds_float(field.annotation)],
)
@pytest.mark.parametrize("text", ["inf", "nan"])
def test_settings_refuse_infinite_numbers(name: str, text: str) -> None:
    with pytest.raises(ValidationError, match="finite"):
        ServerSettings(**{name: text})


@pytest.mark.parametrize("codec", CODECS)
def test_messages_of_servers_are_limited_in_values_and_errors(codec: Codec) -> None:
    """A million errors would need gigabytes."""
    head = {"type": "episodes", "episodes": []}
    many = codec.pack({**head, "later": [[0] * 1000] * 1001})
    with pytest.raises(ProtocolError, match=r"more than 1,000,000 values in one message"):
        codec.decode_server(many)
    wrong = codec.pack({**head, "episodes": [0] * 100_000})
    with pytest.raises(ProtocolError) as caught:
        codec.decode_server(wrong)
    assert caught.value.field == "episodes.0"


@pytest.mark.parametrize("codec", CODECS)
def test_objects_of_servers_have_a_limited_number_of_names(codec: Codec) -> None:
    created = {"type": "created", "episode": "e", "code": "c", "tokens": {}}
    tokens = {f"robot{number}": 0 for number in range(10_001)}
    with pytest.raises(ProtocolError, match="message/malformed"):
        codec.decode_server(codec.pack({**created, "tokens": tokens}))


ROSTER = {"type": "roster", "phase": "running", "seats": []}
SAID = {"type": "said", "step": 0, "name": "ada", "seat": "robot1", "text": "hello"}


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize(
    ("message", "field", "most"),
    [
        (SAID, "text", 500),
        (SAID, "name", 64),
        (SAID, "seat", 64),
        (SAID, "target", 64),
        ({"type": "told", "seat": "robot1", "text": "planner 2"}, "text", 64),
        ({"type": "told", "seat": "robot1", "text": "planner 2"}, "seat", 64),
        ({"type": "notice", "text": "hello"}, "text", 2000),
        ({"type": "error", "code": "", "message": "no"}, "code", 64),
        (ROSTER, "phase", 64),
        (ROSTER, "rematch", 64),
    ],
)
def test_texts_of_servers_are_limited(
    codec: Codec, message: dict[str, Any], field: str, most: int
) -> None:
    codec.decode_server(payload(codec, {**message, field: "x" * most}))
    with pytest.raises(ProtocolError) as error:
        codec.decode_server(payload(codec, {**message, field: "x" * (most + 1)}))
    assert error.value.code == "message/invalid-field"
    assert error.value.field.partition(".")[0] == field


@pytest.mark.parametrize("field", ["name", "kind", "controller"])
def test_texts_of_seats_are_limited(field: str) -> None:
    roster = {**ROSTER, "seats": [{"player": "robot1", field: "x" * 65}]}
    with pytest.raises(ProtocolError) as error:
        MSGPACK.decode_server(payload(MSGPACK, roster))
    assert error.value.field.startswith(f"seats.0.{field}")


@pytest.mark.parametrize("codec", CODECS)
def test_long_reasons_of_a_server_are_cut(codec: Codec) -> None:
    long, cut = "x" * 100_000, "x" * MAX_REASON + "…"
    error = codec.decode_server(codec.pack({"type": "error", "code": "x", "message": long}))
    assert error == messages.Error(code="x", message=cut)
    bye = codec.decode_server(codec.pack({"type": "bye", "reason": long}))
    assert bye == messages.Bye(reason=cut)
    left = codec.decode_server(codec.pack({"type": "left", "episode": "e", "reason": long}))
    assert left == messages.Left(episode="e", reason=cut)
    row = {"type": "rejected", "seq": 1, "step": 0, "action": long, "reasons": [long[:5000]] * 1000}
    rejected = codec.decode_server(codec.pack(row))
    assert isinstance(rejected, messages.Rejected)
    assert (rejected.action, rejected.reasons) == (cut, [cut] * MAX_REASONS)
