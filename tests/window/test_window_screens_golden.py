"""The screens of the menu look as they did when somebody last looked at them."""

from __future__ import annotations

import pytest
from tests.support.golden_pictures import TOLERANCE, distance
from tests.support.golden_screens import GOLDEN, PICTURES
from tests.support.samples import first_quickly


@pytest.mark.parametrize("name", first_quickly(list(PICTURES), 5))
def test_it_looks_the_same(name: str) -> None:
    found = distance(GOLDEN / f"{name}.jpg", PICTURES[name]())
    assert found < TOLERANCE, "look, then: python -m tests.support.golden_screens"


def test_all_screens_are_golden() -> None:
    files = {path.stem: path for path in GOLDEN.glob("*")}
    assert files.keys() == PICTURES.keys()
    assert sum(path.stat().st_size for path in files.values()) < 1_000_000
