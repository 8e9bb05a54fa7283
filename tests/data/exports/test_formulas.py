"""Texts that a spreadsheet may run as formulas get an apostrophe in both writers of CSV."""

from __future__ import annotations

import sys
import unicodedata

import pytest

pytest.importorskip("pyarrow", reason="needs the extra `data`")

import pyarrow as pa
import pyarrow.compute as pc

from robotouille.terminal import FORMULA, spreadsheet_cell

BLANKS = [
    chr(code)
    for code in range(sys.maxunicode + 1)
    if unicodedata.category(chr(code)) in ("Zs", "Zl", "Zp", "Cc")
] + list(
    "\u00ad\u034f\u061c\u180e\u200b\u200c\u200d\u200e\u200f\u202e\u2060\u2066\u2800\ufe0f\ufeff"
)


def test_invisible_characters_do_not_hide_a_formula() -> None:
    texts = [f"{blank}{blank}{sign}cmd()" for blank in BLANKS for sign in "=+-@\uff1d"]
    assert [text for text in texts if spreadsheet_cell(text) != f"'{text}"] == []
    assert pc.all(pc.match_substring_regex(pa.array(texts), FORMULA)).as_py()


def test_other_texts_stay() -> None:
    texts = ["", " ", "a=1", " a", "\u00a0b", "\u200bc", "é", "\u4e2d", "\U0001f600", "0-1"]
    assert [spreadsheet_cell(text) for text in texts] == texts
    assert not pc.any(pc.match_substring_regex(pa.array(texts), FORMULA)).as_py()
