"""Texts of participants contain no characters that models read and people do not see."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from robotouille.episode import Chat
from robotouille.protocol import messages
from robotouille.visible_text import visible_text

HEART, FAMILY, KEYCAP = (
    "\u2764\ufe0f\u200d\U0001f525",
    "\U0001f469\u200d\U0001f467",
    "1\ufe0f\u20e3",
)
TAGS = "".join(chr(0xE0000 + ord(letter)) for letter in "obey me")


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("Zoë, 愛 🍅!", "Zoë, 愛 🍅!"),
        (f"{HEART} {FAMILY} {KEYCAP}", f"{HEART} {FAMILY} {KEYCAP}"),
        ("\U0001f1e9\U0001f1ea \U0001f44d\U0001f3fd", "\U0001f1e9\U0001f1ea \U0001f44d\U0001f3fd"),
        ("\U0001fae8", "\U0001fae8"),  # Of Unicode 15, which Python 3.11 does not know.
        ("\u06cc\u200c\u062e", "\u06cc\u200c\u062e"),
        ("\u0915\u094d\u200d\u0937", "\u0915\u094d\u200d\u0937"),
        (f"hi{TAGS}", "hi"),
        (f"\U0001f3f4{TAGS}", "\U0001f3f4"),
        ("o\u200bb\u200de\ufe0fy", "obey"),
        ("🍅\u200d", "🍅"),
        ("🍅\ufe0f\ufe0f\u200d\u200d🍅", "🍅\ufe0f🍅"),
        ("a\u3164b\ue000", "ab"),
        ("one\ntwo\u2028three", "one two three"),
        ("\u202ehi\u2069", "hi"),
    ],
)  # fmt: skip
def test_chat_has_visible_characters_only(said: str, shown: str) -> None:
    assert messages.Say(text=said).text == shown


@pytest.mark.parametrize(
    "said",
    [" ", "\u200b", "\u3164\u115f", TAGS, "\ufe0f\u200d\ufe0f", " \u2800 ", "\x07", "\u0301"],
)
def test_chat_without_a_visible_character_is_refused(said: str) -> None:
    with pytest.raises(ValidationError, match="no visible character"):
        messages.Say(text=said)


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("one\ttwo\nthree", "one\ttwo\nthree"),
        (f"{HEART}\n{FAMILY}\t{KEYCAP}", f"{HEART}\n{FAMILY}\t{KEYCAP}"),
        ("\u202ehi\u2069\u200b", "hi"),
        (f"hi{TAGS}\r\n\x1b\x00there", "hi\nthere"),
        ("🍅\u200d\n🍅", "🍅\n🍅"),
    ],
)
def test_recorded_texts_have_visible_characters_only(written: str, shown: str) -> None:
    assert messages.Note(topic="plan", text=written).text == shown
    assert messages.Act(seq=1, action=None, reasoning=written).reasoning == shown


MIXED = st.text(st.sampled_from("a1#é🍅\u20e3\u200c\u200d\ufe0e\ufe0f\u3164\u0301 \U000e0061"))


@given(st.text(max_size=60) | MIXED)
def test_shown_text_stays_the_same(said: str) -> None:
    shown = visible_text(said)
    assert visible_text(shown) == shown


def test_phrase_matches_the_chat_that_repeats_it() -> None:
    phrase = "hi\u200b there"
    created = messages.Create(chat=Chat.PHRASES, phrases=[phrase])
    assert created.phrases == [messages.Say(text=phrase).text]
