"""Reading responses of endpoints: any JSON, errors by status, costs, and removed secrets."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.models import ModelError, Prices
from robotouille_evaluation.models.prices import listed_cost
from robotouille_evaluation.models.responses import (
    MAX_ANSWER_BYTES,
    error_of_status,
    read_completion,
    read_json,
    secrets_in,
    without_key,
)
from tests.support.openai_server import completion

FIELDS = [
    "choices", "message", "content", "usage", "text", "finish_reason", "error", "tool_calls",
    "prompt_tokens", "completion_tokens", "refusal",
]  # fmt: skip
JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(FIELDS), inner, max_size=4)
    ),
    max_leaves=12,
)


def read_or_raise(body: str) -> None:
    try:
        answer = read_completion(read_json(body), Prices(1, 2).cost)
    except ModelError:
        return
    assert len(answer.text.encode()) <= MAX_ANSWER_BYTES and answer.text.strip()
    assert answer.usage.prompt_tokens >= 0 and answer.usage.completion_tokens >= 0


@given(st.text(max_size=200))
def test_any_text_is_read_or_raises_a_model_error(body: str) -> None:
    read_or_raise(body)


@given(JSON_VALUES)
def test_any_json_is_read_or_raises_a_model_error(value: object) -> None:
    read_or_raise(json.dumps(value))


@given(JSON_VALUES, st.sampled_from(["content", "usage", "finish_reason", "tool_calls"]))
def test_any_value_in_a_completion_is_read_or_raises(value: object, where: str) -> None:
    whole = completion("Action: Wait")
    choice = whole["choices"][0]  # type: ignore[index]
    place = {"usage": whole, "finish_reason": choice}.get(where, choice["message"])
    place[where] = value
    read_or_raise(json.dumps(whole))


@given(st.text(min_size=1).filter(lambda text: text.strip()))
def test_every_text_is_read_unchanged(text: str) -> None:
    assert read_completion(completion(text)).text == text


@pytest.mark.parametrize(
    "text",
    [
        "Incorrect API key provided: sk-proj-abc***xyz.",
        "Authorization: Bearer abcdef-xyz",
        "key-0123456789xyz is not valid",
        "you sent tops3cret-xyz",
        "you sent AIza*******xyz",
        "you sent AIzaSyA0123456789_xyz",
        "you sent gsk_0123456789xyz",
        "you sent hf_0123456789xyz",
        "you sent sk_live_0123456789xyz",
    ],
)
def test_keys_are_removed_from_messages(text: str) -> None:
    assert "xyz" not in without_key(text, "tops3cret-xyz")
    assert "xyz" not in str(error_of_status(401, text, "tops3cret-xyz"))


def test_hexadecimal_keys_are_removed_and_other_words_stay() -> None:
    assert without_key(f"key {'0af9' * 8}, not 0af9", None) == "key [key], not 0af9"
    assert without_key("the task-oriented sky-high pot", None) == "the task-oriented sky-high pot"


def test_secrets_of_an_environment() -> None:
    named = {"A_KEY": "0123456789", "my_token": "tok-en-012345", "CLIENT_SECRET": " 87654321 "}
    others = {"HOME": "/home/ada", "KEY_COUNT": "7", "TOKENIZERS_PARALLELISM": "false"}
    assert secrets_in({**named, **others}) == ("tok-en-012345", "0123456789", "87654321")


@pytest.mark.parametrize("body", ["why " * 10_000, "*" * 10**6, "x" * 10**6, "sk-" * 10**5])
def test_long_messages_are_cut_without_delay(body: str) -> None:
    assert len(str(error_of_status(500, body, "tops3cret-xyz"))) < 400


@pytest.mark.parametrize(
    ("status", "body", "expected"),
    [
        (400, '{"error": "no"}', "refused: status 400: no"),
        (422, '{"detail": "bad"}', "refused: status 422: {'detail': 'bad'}"),
        (500, "", "server: status 500: no reason given"),
        (307, "gone", "endpoint: status 307: gone"),
    ],
)
def test_error_messages_come_from_any_shape_of_body(status: int, body: str, expected: str) -> None:
    assert str(error_of_status(status, body, None)) == expected


def test_prices_of_an_option() -> None:
    assert Prices.parse("2.50/10") == Prices(2.5, 10)
    assert Prices(2.5, 10).cost(1_000_000, 100_000) == 3.5


@pytest.mark.parametrize("text", ["", "1", "1/2/3", "a/b", "-1/2", "nan/1", "1/inf"])
def test_invalid_prices_are_refused(text: str) -> None:
    with pytest.raises(WrongArgumentError, match=r"2\.50/10"):
        Prices.parse(text)


def test_list_prices_depend_on_endpoint_and_cache() -> None:
    pytest.importorskip("genai_prices")
    url = "https://api.openai.com/v1"
    full = listed_cost("gpt-4o", url, 1000, 100, 0)
    cached = listed_cost("gpt-4o", url, 1000, 100, 500)
    assert full is not None and cached is not None and 0 < cached < full < 0.1
    assert listed_cost("gpt-4o", "http://127.0.0.1:8000/v1", 1000, 100, 0) is None
    assert listed_cost("unheard-of", url, 1000, 100, 0) is None
