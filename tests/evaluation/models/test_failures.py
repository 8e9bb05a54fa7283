"""Keys are nowhere in what endpoints say."""

from __future__ import annotations

import pytest

from robotouille_evaluation.models.failures import refusal, secrets_in, without_key


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
def test_keys_are_struck_out(text: str) -> None:
    assert "xyz" not in without_key(text, "tops3cret-xyz")
    assert "xyz" not in str(refusal(401, {}, text, "tops3cret-xyz", 0))


def test_what_is_a_secret_in_an_environment() -> None:
    named = {"A_KEY": "0123456789", "my_token": "tok-en-012345", "CLIENT_SECRET": " 87654321 "}
    others = {"HOME": "/home/somebody", "KEY_COUNT": "7", "TOKENIZERS_PARALLELISM": "false"}
    assert secrets_in({**named, **others}) == ("tok-en-012345", "0123456789", "87654321")


def test_hexadecimal_keys_are_struck_out() -> None:
    assert without_key(f"key {'0af9' * 8}, not 0af9", None) == "key [key], not 0af9"


def test_words_without_keys_stay() -> None:
    assert without_key("the task-oriented sky-high pot", None) == "the task-oriented sky-high pot"


def test_an_endless_reason_is_cut() -> None:
    assert len(str(refusal(500, {}, "why " * 10_000, None, 0))) < 400


@pytest.mark.parametrize("body", ["*" * 10**6, "x" * 10**6, "sk-" * 10**5])
def test_a_long_reason_takes_no_time(body: str) -> None:
    assert len(str(refusal(500, {}, body, "tops3cret-xyz", 0))) < 400


def test_other_shapes_of_errors() -> None:
    assert str(refusal(400, {}, '{"error": "no"}', None, 0)) == "refused: status 400: no"
    assert str(refusal(422, {}, '{"detail": "bad"}', None, 0)).endswith("{'detail': 'bad'}")
    assert str(refusal(500, {}, "", None, 0)) == "server: status 500: no reason given"
    assert str(refusal(307, {}, "gone", None, 0)) == "endpoint: status 307: gone"
