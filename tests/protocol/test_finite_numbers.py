"""Messages in both directions and both encodings refuse NaN and Infinity."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, get_args

import msgpack
import pytest
from pydantic import BaseModel, ValidationError
from tools.message_examples import EXAMPLES

from robotouille.errors import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MSGPACK
from robotouille_server import ServerSettings

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
