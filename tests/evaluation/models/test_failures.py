"""Keys are nowhere in what endpoints say."""

from __future__ import annotations

import pytest

from robotouille_evaluation.models.failures import refusal, without_key


@pytest.mark.parametrize(
    "text",
    [
        "Incorrect API key provided: sk-proj-abc***xyz.",
        "Authorization: Bearer abcdef-xyz",
        "key-0123456789xyz is not valid",
        "you sent tops3cret-xyz",
        "you sent AIza*******xyz",
    ],
)
def test_keys_are_struck_out(text: str) -> None:
    assert "xyz" not in without_key(text, "tops3cret-xyz")
    assert "xyz" not in str(refusal(401, {}, text, "tops3cret-xyz", 0))


def test_words_without_keys_stay() -> None:
    assert without_key("the task-oriented sky-high pot", None) == "the task-oriented sky-high pot"


def test_an_endless_reason_is_cut() -> None:
    assert len(str(refusal(500, {}, "why " * 10_000, None, 0))) < 400


def test_other_shapes_of_errors() -> None:
    assert str(refusal(400, {}, '{"error": "no"}', None, 0)) == "refused: status 400: no"
    assert str(refusal(422, {}, '{"detail": "bad"}', None, 0)).endswith("{'detail': 'bad'}")
    assert str(refusal(500, {}, "", None, 0)) == "server: status 500: no reason given"
    assert str(refusal(307, {}, "gone", None, 0)) == "endpoint: status 307: gone"
