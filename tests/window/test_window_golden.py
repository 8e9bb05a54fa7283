"""Pictures of kitchens and menu screens match their golden files."""

from __future__ import annotations

from types import ModuleType

import pytest
from tests.support import golden_pictures, golden_screens
from tests.support.golden_pictures import TOLERANCE, distance
from tests.support.samples import quick_sample


@pytest.mark.parametrize("name", quick_sample(list(golden_pictures.PICTURES), 6))
def test_the_picture_is_unchanged(name: str) -> None:
    found = distance(golden_pictures.GOLDEN / f"{name}.jpg", golden_pictures.PICTURES[name]())
    assert found < TOLERANCE, "review it, then run: python -m tests.support.golden_pictures"


@pytest.mark.parametrize("name", quick_sample(list(golden_screens.PICTURES), 2))
def test_the_screen_is_unchanged(name: str) -> None:
    found = distance(golden_screens.GOLDEN / f"{name}.jpg", golden_screens.PICTURES[name]())
    assert found < TOLERANCE, "review it, then run: python -m tests.support.golden_screens"


@pytest.mark.parametrize("golden", [golden_pictures, golden_screens])
def test_golden_pictures_are_complete_and_small(golden: ModuleType) -> None:
    files = {path.stem: path for path in golden.GOLDEN.glob("*")}
    assert files.keys() == golden.PICTURES.keys()
    assert sum(path.stat().st_size for path in files.values()) < 1_100_000
