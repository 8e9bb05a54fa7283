"""Whatever bytes come, they are read as an answer or as an error of ours."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille_evaluation.models.answers import MAX_ANSWER_BYTES, read_answer
from robotouille_evaluation.models.model import ModelError, ModelErrorKind
from robotouille_evaluation.models.prices import Prices
from tests.support.openai_server import completion, stream, tool_call

JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["choices", "message", "content", "usage", "text", "finish_reason", "delta",
                 "error", "tool_calls", "prompt_tokens", "completion_tokens", "refusal"]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)  # fmt: skip
TYPES = st.sampled_from(["application/json", "text/event-stream", "text/html", ""])


def read_or_refuse(content_type: str, body: bytes) -> None:
    try:
        answer = read_answer(content_type, body, Prices(1, 2))
    except ModelError:
        return
    assert len(answer.text.encode()) <= MAX_ANSWER_BYTES and answer.text.strip()
    assert answer.usage.prompt_tokens >= 0 and answer.usage.completion_tokens >= 0


@given(TYPES, st.binary(max_size=200))
def test_any_bytes(content_type: str, body: bytes) -> None:
    read_or_refuse(content_type, body)


@given(JSON_VALUES)
def test_any_json(value: object) -> None:
    body = json.dumps(value).encode()
    read_or_refuse("application/json", body)
    read_or_refuse("text/event-stream", b"data: " + body + b"\n\ndata: [DONE]\n\n")


@given(JSON_VALUES, st.sampled_from(["content", "usage", "finish_reason", "tool_calls"]))
def test_any_value_in_a_completion(value: object, where: str) -> None:
    whole = completion("Action: Wait")
    choice = whole["choices"][0]  # type: ignore[index]
    place = {"usage": whole, "finish_reason": choice}.get(where, choice["message"])
    place[where] = value
    read_or_refuse("application/json; charset=utf-8", json.dumps(whole).encode())


@given(st.text(min_size=1).filter(lambda text: text.strip()))
def test_texts_come_through(text: str) -> None:
    body = json.dumps(completion(text)).encode()
    assert read_answer("application/json", body).text == text
    assert read_answer("text/event-stream", stream(*text).body).text == text


def test_a_streamed_tool_call() -> None:
    piece = {"choices": [{"delta": {"tool_calls": [{"id": "1"}]}, "finish_reason": "tool_calls"}]}
    body = f"data: {json.dumps(piece)}\n\ndata: [DONE]\n\n".encode()
    for kind, bytes_ in (("text/event-stream", body), ("application/json", tool_call().body)):
        with pytest.raises(ModelError, match="tool call") as caught:
            read_answer(kind, bytes_)
        assert caught.value.kind is ModelErrorKind.EMPTY


def test_an_error_in_a_stream() -> None:
    with pytest.raises(ModelError, match="overloaded"):
        read_answer("text/event-stream", b'data: {"error": {"message": "overloaded"}}\n\n')
