"""Participants' names: visible, short and distinct."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille.protocol.participant_names import (
    MAX_NAME_LENGTH,
    distinct_name,
    likeness,
    proper_name,
)


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("ada", "ada"),
        ("  Ada \t  Lovelace\n", "Ada Lovelace"),
        ("Zoë 愛 🍅", "Zoë 愛 🍅"),
        ("Zoe\u0308", "Zoë"),
        ("ａｄａ", "ada"),
        ("a\u200bd\u00ada\ufeff", "ada"),
        ("\u202eada\u2066\u2069", "ada"),
        ("ada\x1b[31m\x07\x9b", "ada[31m"),
        ("ada\u2028bob\x85eve", "ada bob eve"),
        ("ada\u3164\u2800\ufe0f\U000e0101", "ada"),
        ("ada\u00a0\u3000 bob", "ada bob"),
        ("\ufdfa" * 4, "صلى الله عليه وسلمصلى الله عليه وسلمصلى"),
        ("", ""),
        (" \u3164\u200b\u202e ", ""),
        ("\u0301\u0302", ""),
    ],
)
def test_name_keeps_visible_characters_only(said: str, shown: str) -> None:
    assert proper_name(said) == shown


DEFAULT_IGNORABLE = (
    (0xAD, 0xAD), (0x34F, 0x34F), (0x61C, 0x61C), (0x115F, 0x1160), (0x17B4, 0x17B5),
    (0x180B, 0x180F), (0x200B, 0x200F), (0x202A, 0x202E), (0x2060, 0x206F), (0x3164, 0x3164),
    (0xFE00, 0xFE0F), (0xFEFF, 0xFEFF), (0xFFA0, 0xFFA0), (0xFFF0, 0xFFF8), (0x1BCA0, 0x1BCA3),
    (0x1D173, 0x1D17A), (0xE0000, 0xE0FFF),
)  # fmt: skip
"""Ranges of the Unicode property Default_Ignorable_Code_Point (DerivedCoreProperties.txt)."""


def test_default_ignorable_characters_are_removed() -> None:
    for first, last in DEFAULT_IGNORABLE:
        for point in range(first, last + 1):
            assert proper_name(f"a{chr(point)}da") == "ada", hex(point)


@given(st.text(max_size=60))
def test_names_are_short_printable_and_stable(said: str) -> None:
    name = proper_name(said)
    assert len(name) <= MAX_NAME_LENGTH
    assert name.isprintable()
    assert name == " ".join(name.split())
    assert proper_name(name) == name


@pytest.mark.parametrize(
    ("one", "other"), [("ada", "ADA"), ("Straße", "STRASSE"), ("Ελλάς", "ΕΛΛΆΣ"), ("ſam", "Sam")]
)
def test_likeness_ignores_letter_case(one: str, other: str) -> None:
    assert likeness(proper_name(one)) == likeness(proper_name(other))


def test_taken_name_gets_the_first_free_number() -> None:
    taken: set[str] = set()
    given_names = ["ada", "Ada", "bob", "ada 3", "ADA", "ada"]
    shown = []
    for name in given_names:
        shown.append(distinct_name(name, taken.__contains__))
        taken.add(likeness(shown[-1]))
    assert shown == ["ada", "Ada 2", "bob", "ada 3", "ADA 4", "ada 5"]


def test_numbered_name_stays_short() -> None:
    long = "n" * MAX_NAME_LENGTH
    assert distinct_name(long, {long}.__contains__) == "n" * (MAX_NAME_LENGTH - 2) + " 2"
