"""The table of docs/packs.md is the one that the packs give now."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import pytest

from tests.support.pages import DOCS
from tests.support.published import CHECKOUT, NEEDED, PUBLISHED
from tests.support.sources import ROOT

pytest.importorskip("yaml")

MORE = PUBLISHED.parent / "upstream" / "problems"


def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("tool", ROOT / "tools" / "pack_differences.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@NEEDED
@pytest.mark.slow
def test_the_table_of_differences_is_current() -> None:
    text = (DOCS / "packs.md").read_text(encoding="utf-8")
    current = tool().page(text, CHECKOUT, MORE)
    assert text == current, "run: python tools/pack_differences.py CHECKOUT PROBLEMS"
