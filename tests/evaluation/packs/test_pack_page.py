"""Table of differences in docs/packs.md."""

from __future__ import annotations

import pytest

from tests.support.pages import DOCS
from tests.support.published import CHECKOUT, NEEDED, PUBLISHED
from tests.support.scripts import script_module
from tests.support.sources import ROOT

pytest.importorskip("yaml")

MORE = PUBLISHED.parent / "upstream" / "problems"


@NEEDED
@pytest.mark.slow
def test_the_table_of_differences_is_current() -> None:
    text = (DOCS / "packs.md").read_text(encoding="utf-8")
    current = script_module(ROOT / "tools/pack_differences.py").page(text, CHECKOUT, MORE)
    assert text == current, "run: python tools/pack_differences.py CHECKOUT PROBLEMS"
